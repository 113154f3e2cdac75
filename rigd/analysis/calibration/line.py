"""Fits a straight line to few points and computes its uncertainty from the residuals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigd.analysis.result import FloatArray

#: Points that a line and its uncertainty need: two for the line, one that could contradict it.
LEAST_POINTS = 3


@dataclass(frozen=True, eq=False)
class Line:
    """y = ``offset`` + ``slope`` x by ordinary least squares, with standard uncertainties.

    These come from the residuals with n - 2 degrees of freedom. ``covariance`` is that of offset
    and slope.
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
    variance = float(residuals @ residuals) / (len(x) - 2)
    return Line(
        slope,
        offset,
        float(np.sqrt(variance / spread)),
        float(np.sqrt(variance * (1.0 / len(x) + middle**2 / spread))),
        -middle * variance / spread,
        fitted,
        residuals,
    )


def hysteresis(x: FloatArray, y: FloatArray) -> float:
    """Return the largest spread of ``y`` between visits to the same ``x``; 0 without any."""
    return max(float(np.ptp(y[x == item])) for item in np.unique(x))
