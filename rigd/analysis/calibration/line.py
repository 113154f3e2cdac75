"""Fits a straight line to few points and computes its uncertainty from the residuals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import norm, t

from rigd.analysis.result import FloatArray

#: Points that a line and its uncertainty need: two for the line, one that could contradict it.
LEAST_POINTS = 3


@dataclass(frozen=True, eq=False)
class Line:
    """y = ``offset`` + ``slope`` x by ordinary least squares, with standard uncertainties.

    These come from the residuals with n - 2 degrees of freedom, and are widened as these are few:
    value ± 1.96 u holds the truth in 95 of 100 cases (Student's t). ``covariance`` is that of
    offset and slope.
    """

    slope: float
    offset: float
    u_slope: float
    u_offset: float
    covariance: float
    fitted: FloatArray  #: (n,) at the points
    residuals: FloatArray  #: (n,) measured minus fitted

    @property
    def worst(self) -> float:
        """The largest residual by magnitude."""
        return float(np.max(np.abs(self.residuals)))


def straight_line(x: FloatArray, y: FloatArray) -> Line:
    """Return the line through (n,) ``x`` and ``y``.

    Raises:
        ValueError: fewer than :data:`LEAST_POINTS` points, or all at one ``x``.
    """
    if len(x) < LEAST_POINTS or np.ptp(x) == 0.0:
        raise ValueError(f"{len(x)} points at {len(np.unique(x))} places give no line")
    middle = float(np.mean(x))
    spread = float(np.sum((x - middle) ** 2))
    slope = float(np.sum((x - middle) * y)) / spread
    offset = float(np.mean(y)) - slope * middle
    fitted = offset + slope * x
    residuals = y - fitted
    freedom = len(x) - 2
    variance = float(residuals @ residuals) / freedom
    variance *= float(t.ppf(0.975, freedom) / norm.ppf(0.975)) ** 2
    return Line(
        slope,
        offset,
        float(np.sqrt(variance / spread)),
        float(np.sqrt(variance * (1.0 / len(x) + middle**2 / spread))),
        -middle * variance / spread,
        fitted,
        residuals,
    )


def returns(x: FloatArray, y: FloatArray, scale: float, unit: str, decimals: int = 2) -> str:
    """Return in words by how much ``scale`` ``y`` (n,) differ between visits to the same ``x``.

    Readings on the way up alone, or at one place again and again, show neither drift nor
    hysteresis.
    """
    steps = np.sign(np.diff(x))
    if not ((steps > 0).any() and (steps < 0).any()) or len(np.unique(x)) == len(x):
        return (
            "nothing was read on the way up and on the way down: a drift, which moves the slope, "
            "and hysteresis are not seen"
        )
    most = max(float(np.ptp(y[x == item])) for item in np.unique(x))
    return f"up and down differ by at most {scale * most:.{decimals}f} {unit}"
