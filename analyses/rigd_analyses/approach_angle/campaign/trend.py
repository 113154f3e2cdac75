"""Fits two functions of the approach angle to friction: the paper's straight line, and the demand.

The demand is the force that mere rolling needs.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.stats import t as student

from rigd_analyses.approach_angle.raw.run_data import FloatArray
from rigd_analyses.approach_angle.result import DemandFit, LineFit, Trend

MIN_SETS = 3  #: two angles make a line without any doubt about it, and no trend


def trend(
    source: str,
    sets: Sequence[str],
    alpha_rad: Sequence[float],
    mu: Sequence[float],
    u: Sequence[float] | None = None,
) -> Trend | None:
    """Return line and demand form through (angle, mu), or None with less than three angles.

    Both are plain least squares: the scatter of the sets about the line is many times what each
    is uncertain by, and it is what the interval of the slope must hold. If the scatter is small
    by chance, as three sets allow, what the standard uncertainties ``u`` of the maxima make of the
    line is larger, and taken instead.
    """
    alpha, value = np.array(alpha_rad, dtype=np.float64), np.array(mu, dtype=np.float64)
    if np.unique(alpha).size < MIN_SETS:
        return None
    angle = np.degrees(alpha)
    each = None if u is None else np.array(u, dtype=np.float64)
    line, demand = _line(angle, value, each), _demand(alpha, value)
    return Trend(
        source=source,
        sets=tuple(sets),
        angle_deg=angle,
        mu=value,
        u=each,
        line=line,
        demand=demand,
        sentence=_sentence(line, demand, alpha),
    )


def _line(angle: FloatArray, mu: FloatArray, u: FloatArray | None) -> LineFit:
    n = angle.size
    basis = np.column_stack([np.ones(n), angle])
    q = np.linalg.lstsq(basis, mu, rcond=None)[0]
    rest = mu - basis @ q
    dof = n - 2
    inverse = np.linalg.inv(basis.T @ basis)
    scatter = np.sqrt(float(rest @ rest) / dof * np.diag(inverse))
    propagated = np.zeros(2)
    if u is not None:
        propagated = np.sqrt((inverse @ basis.T) ** 2 @ u**2)  # JCGM 100:2008, 5.1.2
    intercept_u, slope_u = (float(x) for x in np.maximum(scatter, propagated))
    half = max(float(student.ppf(0.975, dof)) * float(scatter[1]), 1.96 * float(propagated[1]))
    spread = float(np.sum((mu - np.mean(mu)) ** 2))
    return LineFit(
        slope_per_deg=float(q[1]),
        slope_u=slope_u,
        slope_low=float(q[1]) - half,
        slope_high=float(q[1]) + half,
        intercept=float(q[0]),
        intercept_u=intercept_u,
        r_squared=1.0 - float(rest @ rest) / spread if spread > 0.0 else float("nan"),
        rms=math.sqrt(float(np.mean(rest**2))),
        dof=dof,
    )


def _demand(alpha: FloatArray, mu: FloatArray) -> DemandFit:
    basis = np.column_stack([1.0 / np.cos(alpha), np.tan(alpha)])
    q = np.linalg.lstsq(basis, mu, rcond=None)[0]
    rest = mu - basis @ q
    return DemandFit(float(q[0]), float(q[1]), math.sqrt(float(np.mean(rest**2))))


def _sentence(line: LineFit, demand: DemandFit, alpha: FloatArray) -> str:
    both = (
        f"A straight line leaves {line.rms:.3f} rms; the force that mere rolling would ask for, "
        f"({demand.a:.3f} + {demand.b:.3f} sin α)/cos α, leaves {demand.rms:.3f}"
    )
    by_chance = line.dof < 2  # either form has two parameters: one of them may fit three points
    if by_chance or 0.5 < demand.rms / max(line.rms, 1e-300) < 2.0:
        return (
            f"{both}. {alpha.size} maxima alone cannot separate a friction limit that rises "
            "with the angle from a demand that does; the difference is whether the wheel slid in "
            "the runs they come from."
        )
    better = "demand form" if demand.rms < line.rms else "line"
    return f"{both}. The {better} describes these {alpha.size} maxima better."
