"""The friction curve g(V_r) with its band, on the slip that the data visited and nowhere else."""

from __future__ import annotations

import numpy as np

from rigd.identify.lugre.model import SIGMA_1, SIGMA_2, LugreModel, friction, friction_gradient
from rigd.identify.lugre.spread import Spread
from rigd.identify.result import Curve, FloatArray
from rigd.model.errors import DataError

POINTS = 60
SLIDING = 0.5  #: share of g at which the bristle counts as sliding
#: The lowest and highest shares of the used samples are noise of the slip, not visited slip.
TRIM = 0.01
RESOLVED = 10.0  #: slip below this many standard deviations of its noise is not resolved


def visited_range(model: LugreModel, theta: FloatArray, noise_m_s: float) -> tuple[float, float]:
    """Return the slip range in m/s that the used samples cover while the bristle slides.

    A bristle bent less than half way (|z| < g/2) feels its stiffness, hardly g. The range begins
    where the slip stands out of ``noise_m_s``, its standard deviation.

    Raises:
        DataError: no trial slides, or none at a slip that the sensors resolve.
    """
    bristle_only = theta.copy()
    bristle_only[[SIGMA_1, SIGMA_2]] = 0.0
    slip = np.concatenate([t.slip_m_s for t in model.trials])
    bent = np.abs(model.predict(bristle_only)) >= SLIDING * friction(theta, slip)
    used = np.abs(slip[(model.mask > 0.0) & bent])
    if used.size == 0:
        raise DataError(
            "no trial bends the bristle half way to sliding: nothing is known about friction",
            hint="record trials with more current",
        )
    low, high = (float(x) for x in np.quantile(used, [TRIM, 1.0 - TRIM]))
    if high <= RESOLVED * noise_m_s:
        raise DataError(
            f"the slip reaches {1e3 * high:.2g} mm/s while the sensors resolve "
            f"{1e3 * RESOLVED * noise_m_s:.2g} mm/s: nothing is known about friction",
            hint="record trials with more current, or encoders with finer counts",
        )
    return max(low, RESOLVED * noise_m_s), high


def friction_curve(spread: Spread, visited: tuple[float, float]) -> Curve:
    """Return g on ``visited`` with its 95 % band (pointwise)."""
    slip = np.geomspace(visited[0], visited[1], POINTS)

    def log_g(theta: FloatArray) -> FloatArray:
        return np.asarray(np.log(friction(theta, slip)))

    centre = friction(spread.theta, slip)
    gradient = friction_gradient(spread.theta, slip) / centre[:, None]
    low, high, _ = spread.interval(log_g, gradient)
    return Curve(
        name="friction_curve",
        x_name="V_r",
        x_unit="m/s",
        y_name="g",
        y_unit="1",
        x=slip,
        y=centre,
        low=np.exp(low),
        high=np.exp(high),
        note=f"Visited slip: {1e3 * visited[0]:.1f} to {1e3 * visited[1]:.1f} mm/s; beyond it the "
        "curve would be extrapolation and is not drawn. Band: 95 %, pointwise.",
    )
