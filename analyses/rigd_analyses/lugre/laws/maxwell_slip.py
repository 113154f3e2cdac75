"""Defines the generalised Maxwell-slip law with four elements.

F. Al-Bender, V. Lampaert and J. Swevers, "The generalized Maxwell-slip model: a novel model for
friction simulation and compensation", IEEE Transactions on Automatic Control 50(11), 2005. Each
element i holds the share 1/4 of the friction. It sticks, dF_i/dt = k_i V, until its force reaches
s(V)/4, and then slips, dF_i/dt = sign(V) C (1/4 - F_i/s(V)), until the slip reverses. s(V) is the
Stribeck curve of the LuGre law. The paper leaves the elements free; here the stiffnesses k_i are a
geometric series, so that two parameters determine where friction yields.
"""

from __future__ import annotations

import numpy as np

from rigd.analysis.friction import FrictionLaw, LawParameter, step
from rigd.analysis.result import FloatArray
from rigd_analyses.lugre.laws.bristle import (
    COULOMB,
    STIFFNESS,
    STRIBECK_SPEED,
    VISCOUS,
    stribeck,
)
from rigd_analyses.lugre.laws.lugre import RATIO, stribeck_curve

ELEMENTS = 4
SPREAD = LawParameter(
    "spread", "1", 1.0, 30.0, 2.0, symbol="k_i/k_i+1",
    meaning="stiffness of an element over that of the next",
    advice="It needs slip that begins or reverses within the recording.",
)  # fmt: skip
ATTRACTION = LawParameter(
    "C", "1/s", 0.1, 1e4, 30.0, symbol="C",
    meaning="how fast the force of a slipping element follows s(V)",
    advice="It needs slip that changes while it lasts.",
)  # fmt: skip


@step
def _maxwell_slip(
    state: FloatArray, theta: FloatArray, between: float, slip: float, rolling: float, dt: float
) -> float:
    sign = np.sign(between)
    share = 1.0 / ELEMENTS
    yielding = stribeck(between, theta[0], theta[1], np.expm1(theta[2]))[0]
    # The stiffnesses add up to sigma_0.
    stiffness = theta[3] * (1.0 - theta[4]) / (1.0 - theta[4] ** ELEMENTS)
    if theta[4] < 1.0 + 1e-9:
        stiffness = theta[3] * share
    force = theta[6] * slip
    for i in range(ELEMENTS):
        if sign == 0.0 or dt == 0.0:
            pass
        elif state[ELEMENTS + i] == sign:
            goal = sign * share * yielding
            state[i] = goal + (state[i] - goal) * np.exp(-theta[5] * dt / yielding)
        else:
            state[i] += stiffness * between * dt
            state[ELEMENTS + i] = 0.0
            if sign * state[i] >= share * yielding:
                state[i] = sign * share * yielding
                state[ELEMENTS + i] = sign
        force += state[i]
        stiffness *= theta[4]
    return float(force)


class MaxwellSlip(FrictionLaw):
    """Generalised Maxwell slip: four elements that stick and slip one after the other."""

    parameters = (STRIBECK_SPEED, COULOMB, RATIO, STIFFNESS, SPREAD, ATTRACTION, VISCOUS)
    #: Forces of the elements, and the direction in which each slips, 0 while it sticks.
    states = 2 * ELEMENTS
    step = _maxwell_slip

    @staticmethod
    def steady(theta: FloatArray, slip_m_s: FloatArray, rolling_m_s: float) -> FloatArray:
        """Return s(V) in the direction of the slip, plus sigma_2 V: all elements slip."""
        curve = stribeck_curve(theta, slip_m_s)
        return np.asarray(curve * np.sign(slip_m_s) + theta[6] * slip_m_s)
