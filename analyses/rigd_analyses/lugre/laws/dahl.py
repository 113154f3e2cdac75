"""Defines Dahl's law, with and without viscous friction.

P. R. Dahl, "Solid friction damping of mechanical vibrations", AIAA Journal 14(12), 1976, with the
exponent 1; all over the normal force.
"""

from __future__ import annotations

import numpy as np

from rigd.analysis.friction import FrictionLaw, gradient, step
from rigd.analysis.result import FloatArray
from rigd_analyses.lugre.laws.bristle import FRICTION, STIFFNESS, VISCOUS, relax


@step
def _dahl(
    state: FloatArray, theta: FloatArray, between: float, slip: float, rolling: float, dt: float
) -> float:
    state[0] = relax(state[0], theta[0], theta[1], between, dt)[0]
    return float(state[0])


@gradient
def _dahl_gradient(
    state: FloatArray, sensitivity: FloatArray, theta: FloatArray,
    between: float, slip: float, rolling: float, dt: float, row: FloatArray,
) -> float:  # fmt: skip
    state[0], e, by_g, by_stiffness = relax(state[0], theta[0], theta[1], between, dt)
    row[0] = sensitivity[0, 0] = e * sensitivity[0, 0] + by_g
    row[1] = sensitivity[0, 1] = e * sensitivity[0, 1] + by_stiffness
    return float(state[0])


@step
def _dahl_viscous(
    state: FloatArray, theta: FloatArray, between: float, slip: float, rolling: float, dt: float
) -> float:
    state[0] = relax(state[0], theta[0], theta[1], between, dt)[0]
    return float(state[0] + theta[2] * slip)


@gradient
def _dahl_viscous_gradient(
    state: FloatArray, sensitivity: FloatArray, theta: FloatArray,
    between: float, slip: float, rolling: float, dt: float, row: FloatArray,
) -> float:  # fmt: skip
    state[0], e, by_g, by_stiffness = relax(state[0], theta[0], theta[1], between, dt)
    row[0] = sensitivity[0, 0] = e * sensitivity[0, 0] + by_g
    row[1] = sensitivity[0, 1] = e * sensitivity[0, 1] + by_stiffness
    row[2] = slip
    return float(state[0] + theta[2] * slip)


class Dahl(FrictionLaw):
    """Dahl: a bristle that yields at one force.

    dz/dt = sigma_0 (V - |V| z / mu), F/F_N = z.
    """

    parameters = (FRICTION, STIFFNESS)
    states = 1
    step = _dahl
    gradient = _dahl_gradient

    @staticmethod
    def steady(theta: FloatArray, slip_m_s: FloatArray, rolling_m_s: float) -> FloatArray:
        """Return mu in the direction of the slip."""
        return np.asarray(theta[0] * np.sign(slip_m_s))


class DahlViscous(FrictionLaw):
    """Dahl with viscous friction.

    dz/dt = sigma_0 (V - |V| z / mu), F/F_N = z + sigma_2 V.
    """

    parameters = (FRICTION, STIFFNESS, VISCOUS)
    states = 1
    step = _dahl_viscous
    gradient = _dahl_viscous_gradient

    @staticmethod
    def steady(theta: FloatArray, slip_m_s: FloatArray, rolling_m_s: float) -> FloatArray:
        """Return mu in the direction of the slip, plus sigma_2 V."""
        return np.asarray(theta[0] * np.sign(slip_m_s) + theta[2] * slip_m_s)
