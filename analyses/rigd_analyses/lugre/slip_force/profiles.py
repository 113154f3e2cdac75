"""Computes profile likelihoods of V_s, mu_c, mu_s and of the Stribeck effect.

The profiles go along and across the ridge of V_s.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rigd.analysis.fitting.fit import Fit, fit
from rigd.analysis.fitting.profile import ProfileScan, axis, scan
from rigd.analysis.result import FloatArray, Profile
from rigd_analyses.lugre.model import PARAMETERS, RATIO, V_S, LugreModel
from rigd_analyses.lugre.quantities import PROFILED, Quantity

GRID_POINTS = 19
POLISH_ROUNDS = 3
POLISH_GAIN = 1e-6  #: a relative gain in cost too small to move any verdict
#: Widest range of a profile, as factors of the estimate; an end beyond it counts as open.
FRICTION_FACTORS = (0.05, 20.0)
RATIO_GRID = np.concatenate([np.linspace(0.0, 0.5, 11), np.geomspace(0.6, 4.0, 7)])
ORIGINS = 4  #: points of the V_s ridge from which the other profiles start, beside the optima
OTHER_OPTIMUM = 1e-4  #: relative difference in cost from which two fits are different optima


@dataclass(frozen=True)
class Scans:
    """Profiles of V_s, mu_c, mu_s (logarithms) and of ln(mu_s/mu_c)."""

    speed: ProfileScan
    coulomb: ProfileScan
    static: ProfileScan
    ratio: ProfileScan

    @property
    def accepted(self) -> FloatArray:
        """Return the natural parameters (m, 6) of all points that any of the profiles accepts."""
        scans = (self.speed, self.coulomb, self.static, self.ratio)
        return np.concatenate([found.accepted for found in scans])


def polish(model: LugreModel, best: Fit) -> Fit:
    """Return the best fit found by walking along the V_s ridge, on which plain steps are slow."""
    speed = PROFILED[0]
    direction = np.array(speed.direction, dtype=np.float64)
    for _ in range(POLISH_ROUNDS):
        found = scan(model, best, direction, _grid(speed, best.theta), inflation=1.0)
        lowest = found.thetas[int(np.argmin(found.statistic))]
        better = fit(model, lowest, weights=best.weights)
        if not better.cost < best.cost * (1.0 - POLISH_GAIN):
            break
        best = replace(better, start=best.start)
    return best


def scan_all(model: LugreModel, best: Fit, fits: Sequence[Fit], inflation: float) -> Scans:
    """Return the four profiles that decide on V_s, mu_c, mu_s and the Stribeck effect.

    They set out from every optimum in ``fits``, and those of friction also from points along the
    accepted ridge of V_s, so that both ends of the ridge are seen by all.
    """
    optima = _optima(fits)
    speed = _scan(PROFILED[0], model, best, optima, inflation)
    ridge = speed.accepted[np.linspace(0, len(speed.accepted) - 1, ORIGINS).astype(int)]
    origins = [*optima, *ridge]
    ratio_grid = np.unique(np.append(RATIO_GRID, best.theta[RATIO]))
    return Scans(
        speed,
        _scan(PROFILED[1], model, best, origins, inflation),
        _scan(PROFILED[2], model, best, origins, inflation),
        scan(model, best, axis(6, RATIO), ratio_grid, inflation=inflation, others=origins),
    )


def speed_on_bound(found: ProfileScan, end: float | None, bound: float) -> bool:
    """Whether an end of an interval is there only because V_s may not pass its own ``bound``."""
    if end is None:
        return False
    nearest = int(np.argmin(np.abs(found.values - end)))
    return math.isclose(found.thetas[nearest, V_S], bound, rel_tol=1e-6)


def profiles(scans: Scans) -> tuple[Profile, ...]:
    """Return the profiles for a report, in units."""
    logs = zip(PROFILED, (scans.speed, scans.coulomb, scans.static), strict=True)
    out = [
        Profile(
            q.name, q.unit, np.exp(s.values), s.statistic, s.threshold,
            _exp(s.low), _exp(s.high),
        )
        for q, s in logs
    ]  # fmt: skip
    r = scans.ratio
    ratio = Profile(
        "ln(mu_s/mu_c)", "1", r.values, r.statistic, r.threshold, r.low, r.high, log_axis=False
    )
    return (*out, ratio)


def _scan(
    quantity: Quantity,
    model: LugreModel,
    best: Fit,
    others: Sequence[FloatArray],
    inflation: float,
) -> ProfileScan:
    direction = np.array(quantity.direction, dtype=np.float64)
    grid = _grid(quantity, best.theta)
    return scan(model, best, direction, grid, inflation=inflation, others=others)


def _optima(fits: Sequence[Fit]) -> list[FloatArray]:
    """Return the end points of the fits (best first), one for each different cost."""
    kept: list[Fit] = []
    for item in fits:
        if not kept or item.cost > kept[-1].cost * (1.0 + OTHER_OPTIMUM):
            kept.append(item)
    return [item.theta for item in kept]


def _grid(quantity: Quantity, theta: FloatArray) -> FloatArray:
    """Return the logarithms to profile, the estimate among them."""
    value = quantity.value(theta)
    if quantity.name == "V_s":
        points = np.linspace(
            math.log(PARAMETERS[V_S].low), math.log(PARAMETERS[V_S].high), GRID_POINTS
        )
    else:
        near = np.linspace(-0.3, 0.3, 13)
        far = np.log([FRICTION_FACTORS[0], 0.1, 0.2, 0.4, 0.6, 1.6, 2.5, 5.0, 10.0, 20.0])
        points = math.log(value) + np.concatenate([near, far])
    return np.unique(np.append(points, math.log(value)))


def _exp(value: float | None) -> float | None:
    return None if value is None else math.exp(value)
