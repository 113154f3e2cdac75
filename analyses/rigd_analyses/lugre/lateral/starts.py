"""Finds starting values for the fit in which each trial has a friction of the guide of its own.

The speed of the carriage alone determines that friction in each trial to some per cent.
"""

from __future__ import annotations

import math
from itertools import product

import numpy as np

from rigd.analysis.result import FloatArray
from rigd_analyses.lugre.lateral.speeds.errors import lacking_force, speeds
from rigd_analyses.lugre.lateral.system import LateralSystem
from rigd_analyses.lugre.model import MU_C, V_S

SPEEDS_M_S = (5e-3, 0.1)  #: V_s of starts
#: mu_c of starts: from 0.1 alone a fit ends far off on a floor with 0.04, where the wheel slips.
FRICTIONS = (0.04, 0.1)


def starts(system: LateralSystem) -> list[FloatArray]:
    """Return parameters (p,) of :class:`.loads.FreeLoads`, some for what is not known."""
    shared = np.array([item.parameter.start for item in system.shared])
    free = [math.isinf(system.shared[place].u) for place in (V_S, MU_C)]
    speeds_m_s = SPEEDS_M_S if free[0] else (float(shared[V_S]),)
    frictions = FRICTIONS if free[1] else (float(shared[MU_C]),)
    return [_start(system, shared, *values) for values in product(speeds_m_s, frictions)]


def _start(system: LateralSystem, shared: FloatArray, speed_m_s: float, mu_c: float) -> FloatArray:
    """Return parameters (p,) with such a V_s and mu_c, and the frictions that go with them."""
    point = shared.copy()
    point[V_S], point[MU_C] = speed_m_s, mu_c
    local = np.array([item.parameter.start for item in system.local])
    stated = system.rig.constants.guide_friction.value
    of_trials = []
    for trial in range(len(system.speeds)):
        traces = speeds(system, point, local, trial)
        lacking = lacking_force(traces.measured - traces.ignored, system, trial)
        of_trials.append([*local, stated - lacking])
    return np.concatenate([point[: len(system.rig.shared)], np.ravel(of_trials)])
