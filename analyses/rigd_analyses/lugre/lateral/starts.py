"""Finds starting values for the fit in which each trial has a friction of the guide of its own.

The speed of the carriage alone determines that friction in each trial to some per cent.
"""

from __future__ import annotations

import math

import numpy as np

from rigd.analysis.result import FloatArray
from rigd_analyses.lugre.lateral.speeds import lacking_force, speeds
from rigd_analyses.lugre.lateral.system import LateralSystem
from rigd_analyses.lugre.model import V_S

SPEEDS_M_S = (5e-3, 0.1)  #: V_s of starts


def starts(system: LateralSystem) -> list[FloatArray]:
    """Return parameters (p,) of :class:`.loads.FreeLoads`, with some V_s if it is not known."""
    point = np.array([item.parameter.start for item in system.shared])
    local = np.array([item.parameter.start for item in system.local])
    stated = system.rig.constants.guide_friction.value
    of_trials = []
    for trial in range(len(system.speeds)):
        traces = speeds(system, point, local, trial)
        lacking = lacking_force(traces.measured - traces.ignored, system, trial)
        of_trials.append([*local, stated - lacking])
    straight = point[: len(system.rig.shared)]
    found = []
    for speed in SPEEDS_M_S if math.isinf(system.shared[V_S].u) else (float(point[V_S]),):
        shared = straight.copy()
        shared[V_S] = speed
        found.append(np.concatenate([shared, np.ravel(of_trials)]))
    return found
