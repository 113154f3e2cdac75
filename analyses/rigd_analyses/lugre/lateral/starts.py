"""Finds starting values for the fit of the rollers' friction.

The load of the guide, over the friction of the rollers, falls to zero and rises again, at another
friction for each lateral speed: the fit has many optima. The speeds of the carriage alone determine
the friction of the guide in each trial to some per cent. A grid search finds the frictions of the
rollers that agree with all of these values.
"""

from __future__ import annotations

import math
from itertools import product

import numpy as np

from rigd.analysis.result import FloatArray
from rigd_analyses.lugre.lateral.coupling import DRY, VISCOUS
from rigd_analyses.lugre.lateral.speeds import lacking_force, speeds
from rigd_analyses.lugre.lateral.system import LateralSystem
from rigd_analyses.lugre.model import V_S

SPEEDS_M_S = (5e-3, 0.1)  #: V_s of starts
DRY_GRID = np.geomspace(2e-3, 0.15, 45)
VISCOUS_GRID = np.geomspace(5e-4, 0.3, 45)  #: s/m


def starts(point: FloatArray, *, known: bool) -> list[FloatArray]:
    """Return shared parameters (p,) to start from: ``point``, with some V_s if it is not known."""
    if known:
        return [point]
    found = []
    for speed in SPEEDS_M_S:
        start = point.copy()
        start[V_S] = speed
        found.append(start)
    return found


def with_rollers(system: LateralSystem, point: FloatArray) -> FloatArray:
    """Return the shared parameters ``point`` (p,) with the friction of rollers that fits best.

    A friction of the rollers that is stated stays.
    """
    first = len(system.rig.shared)
    out = point.copy()
    if math.isfinite(system.shared[first].u):
        return out
    local = np.array([item.parameter.start for item in system.local])
    lacking = []
    for trial in range(len(system.speeds)):
        traces = speeds(system, point, local, trial)
        lacking.append(lacking_force(traces.measured - traces.ignored, system.rig))
    lateral = np.array([float(np.mean(speed)) for speed in system.speeds])
    straight = system.guide_friction(point, np.zeros(1))[0]

    def misfit(dry: float, viscous: float) -> float:
        out[first + DRY], out[first + VISCOUS] = dry, viscous
        # What all trials lack alike belongs to the constants of the drive.
        return float(np.var(system.guide_friction(out, lateral) - straight + lacking))

    best = min(product(DRY_GRID, VISCOUS_GRID), key=lambda pair: misfit(*pair))
    out[first + DRY], out[first + VISCOUS] = best
    return out
