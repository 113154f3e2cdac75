"""The friction curve g(V_r) with its band, on the slip that the data visited and nowhere else."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rigd.identify.lugre.model import SlipForce, friction, friction_gradient
from rigd.identify.lugre.spread import Spread
from rigd.identify.result import Curve, FloatArray

POINTS = 60
#: The lowest and highest shares of the used samples are noise of the slip, not visited slip.
TRIM = 0.005


def visited_range(trials: Sequence[SlipForce]) -> tuple[float, float]:
    """Return the slip range in m/s that the used samples cover."""
    slip = np.concatenate([np.abs(t.slip_m_s[t.mask > 0.0]) for t in trials])
    low, high = np.quantile(slip, [TRIM, 1.0 - TRIM])
    return float(low), float(high)


def friction_curve(spread: Spread, visited: tuple[float, float]) -> Curve:
    """Return g on ``visited`` with its 95 % band (pointwise)."""
    low_slip = max(visited[0], 1e-3 * visited[1])
    slip = np.geomspace(low_slip, visited[1], POINTS)

    def g(theta: FloatArray) -> FloatArray:
        return friction(theta, slip)

    low, high, _ = spread.interval(g, friction_gradient(spread.theta, slip))
    return Curve(
        name="friction_curve",
        x_name="V_r",
        x_unit="m/s",
        y_name="g",
        y_unit="1",
        x=slip,
        y=g(spread.theta),
        low=low,
        high=high,
        note=f"Visited slip: {1e3 * visited[0]:.1f} to {1e3 * visited[1]:.1f} mm/s; beyond it the "
        "curve would be extrapolation and is not drawn. Band: 95 %, pointwise.",
    )
