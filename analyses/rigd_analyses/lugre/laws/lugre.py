"""Defines the LuGre law with four and with six parameters, and with the relaxation of a wheel.

C. Canudas de Wit et al., "A new model for control of systems with friction", IEEE Transactions on
Automatic Control 40(3), 1995; normalised as in the paper (Eqs. 4 and 5, corrected Eq. 6):

    dz/dt = sigma_0 (V - |V| z / g(V))
    F/F_N = z + sigma_1 (V - |V| z / g(V)) + sigma_2 V
"""

from __future__ import annotations

import numpy as np

from rigd.analysis.fitting.model import Scaling
from rigd.analysis.friction import FrictionLaw, LawParameter, gradient, step
from rigd.analysis.result import FloatArray
from rigd_analyses.lugre.laws.bristle import (
    COULOMB,
    DAMPING,
    FRICTION,
    STIFFNESS,
    STRIBECK_SPEED,
    VISCOUS,
    relax,
    stribeck,
)

#: ln(mu_s/mu_c) >= 0 keeps static friction at or above Coulomb friction, and makes "no Stribeck
#: effect" a bound that can be reached and recognised.
RATIO = LawParameter(
    "ln(mu_s/mu_c)", "1", 0.0, 4.0, 0.2, Scaling.LINEAR, symbol="ln(μ_s/μ_c)",
    meaning="logarithm of static over Coulomb friction",
    advice="It needs the same test both far below and far above V_s.",
)  # fmt: skip
RELAXATION = LawParameter(
    "kappa", "1/m", 1e-3, 1e3, 1.0, symbol="κ",
    meaning="share of the deflection that leaves the contact per metre rolled",
    advice="It needs the same slip at different rolling speeds.",
)  # fmt: skip


@step
def _lugre(
    state: FloatArray, theta: FloatArray, between: float, slip: float, rolling: float, dt: float
) -> float:
    rise = np.expm1(theta[2])
    yielding = stribeck(between, theta[0], theta[1], rise)[0]
    z = state[0] = relax(state[0], yielding, theta[3], between, dt)[0]
    g = stribeck(slip, theta[0], theta[1], rise)[0]
    return float(z + theta[4] * (slip - abs(slip) * z / g) + theta[5] * slip)


@gradient
def _lugre_gradient(
    state: FloatArray, sensitivity: FloatArray, theta: FloatArray,
    between: float, slip: float, rolling: float, dt: float, row: FloatArray,
) -> float:  # fmt: skip
    rise = np.expm1(theta[2])
    curve = stribeck(between, theta[0], theta[1], rise)
    state[0], e, by_g, by_stiffness = relax(state[0], curve[0], theta[3], between, dt)
    for i in range(3):
        sensitivity[0, i] = e * sensitivity[0, i] + by_g * curve[1 + i]
    sensitivity[0, 3] = e * sensitivity[0, 3] + by_stiffness
    curve = stribeck(slip, theta[0], theta[1], rise)
    z, g, speed = state[0], curve[0], abs(slip)
    hold, direct = 1.0 - theta[4] * speed / g, theta[4] * speed * z / (g * g)
    for i in range(3):
        row[i] = hold * sensitivity[0, i] + direct * curve[1 + i]
    row[3] = hold * sensitivity[0, 3]
    row[4] = slip - speed * z / g
    row[5] = slip
    return float(z + theta[4] * row[4] + theta[5] * slip)


@step
def _lugre_4(
    state: FloatArray, theta: FloatArray, between: float, slip: float, rolling: float, dt: float
) -> float:
    mu = theta[0]
    z = state[0] = relax(state[0], mu, theta[1], between, dt)[0]
    return float(z + theta[2] * (slip - abs(slip) * z / mu) + theta[3] * slip)


@gradient
def _lugre_4_gradient(
    state: FloatArray, sensitivity: FloatArray, theta: FloatArray,
    between: float, slip: float, rolling: float, dt: float, row: FloatArray,
) -> float:  # fmt: skip
    mu, speed = theta[0], abs(slip)
    state[0], e, by_g, by_stiffness = relax(state[0], mu, theta[1], between, dt)
    z = state[0]
    sensitivity[0, 0] = e * sensitivity[0, 0] + by_g
    sensitivity[0, 1] = e * sensitivity[0, 1] + by_stiffness
    hold = 1.0 - theta[2] * speed / mu
    row[0] = hold * sensitivity[0, 0] + theta[2] * speed * z / (mu * mu)
    row[1] = hold * sensitivity[0, 1]
    row[2] = slip - speed * z / mu
    row[3] = slip
    return float(z + theta[2] * row[2] + theta[3] * slip)


@step
def _rolling(
    state: FloatArray, theta: FloatArray, between: float, slip: float, rolling: float, dt: float
) -> float:
    rise = np.expm1(theta[2])
    loss = theta[6] * abs(rolling)
    rate = theta[3] * abs(between) / stribeck(between, theta[0], theta[1], rise)[0] + loss
    if rate > 0.0:
        goal = theta[3] * between / rate
        state[0] = goal + (state[0] - goal) * np.exp(-rate * dt)
    z = state[0]
    rate = theta[3] * abs(slip) / stribeck(slip, theta[0], theta[1], rise)[0] + loss
    return float(z + theta[4] * (slip - rate * z / theta[3]) + theta[5] * slip)


@gradient
def _rolling_gradient(
    state: FloatArray, sensitivity: FloatArray, theta: FloatArray,
    between: float, slip: float, rolling: float, dt: float, row: FloatArray,
) -> float:  # fmt: skip
    rise, stiffness, turning = np.expm1(theta[2]), theta[3], abs(rolling)
    curve = stribeck(between, theta[0], theta[1], rise)
    rate = stiffness * abs(between) / curve[0] + theta[6] * turning
    if rate > 0.0:
        goal, e = stiffness * between / rate, np.exp(-rate * dt)
        # What z gains by a faster rate, through the goal and through the decay.
        by_rate = -(1.0 - e) * goal / rate - (state[0] - goal) * e * dt
        by_g = -by_rate * stiffness * abs(between) / curve[0] ** 2
        state[0] = goal + (state[0] - goal) * e
        for i in range(7):
            sensitivity[0, i] *= e
        for i in range(3):
            sensitivity[0, i] += by_g * curve[1 + i]
        sensitivity[0, 3] += (1.0 - e) * goal / stiffness + by_rate * abs(between) / curve[0]
        sensitivity[0, 6] += by_rate * turning
    curve = stribeck(slip, theta[0], theta[1], rise)
    z, speed = state[0], abs(slip)
    bending = speed / curve[0] + theta[6] * turning / stiffness  # the rate over sigma_0
    for i in range(7):
        row[i] = (1.0 - theta[4] * bending) * sensitivity[0, i]
    for i in range(3):
        row[i] += theta[4] * z * speed / curve[0] ** 2 * curve[1 + i]
    row[3] += theta[4] * z * theta[6] * turning / stiffness**2
    row[4] = slip - bending * z
    row[5] = slip
    row[6] -= theta[4] * z * turning / stiffness
    return float(z + theta[4] * row[4] + theta[5] * slip)


class Lugre(FrictionLaw):
    """LuGre: a bristle with damping, which yields at a force with a Stribeck effect."""

    parameters = (STRIBECK_SPEED, COULOMB, RATIO, STIFFNESS, DAMPING, VISCOUS)
    states = 1
    step = _lugre
    gradient = _lugre_gradient

    @staticmethod
    def steady(theta: FloatArray, slip_m_s: FloatArray, rolling_m_s: float) -> FloatArray:
        """Return g in the direction of the slip, plus sigma_2 V."""
        g = stribeck_curve(theta, slip_m_s)
        return np.asarray(g * np.sign(slip_m_s) + theta[5] * slip_m_s)


class Lugre4(FrictionLaw):
    """LuGre without a Stribeck effect: mu_s = mu_c = mu."""

    parameters = (FRICTION, STIFFNESS, DAMPING, VISCOUS)
    states = 1
    step = _lugre_4
    gradient = _lugre_4_gradient

    @staticmethod
    def steady(theta: FloatArray, slip_m_s: FloatArray, rolling_m_s: float) -> FloatArray:
        """Return mu in the direction of the slip, plus sigma_2 V."""
        return np.asarray(theta[0] * np.sign(slip_m_s) + theta[3] * slip_m_s)


class LugreRolling(FrictionLaw):
    """LuGre of a rolling wheel: bristles leave the contact as it rolls.

    dz/dt = sigma_0 (V - |V| z / g(V)) - kappa |u| z, with u the speed of the rim: the average
    lumped model of C. Canudas de Wit et al., "Dynamic friction models for road/tire longitudinal
    interaction", Vehicle System Dynamics 39(3), 2003.
    """

    parameters = (*Lugre.parameters, RELAXATION)
    states = 1
    step = _rolling
    gradient = _rolling_gradient

    @staticmethod
    def steady(theta: FloatArray, slip_m_s: FloatArray, rolling_m_s: float) -> FloatArray:
        """Return the force at which the bristles bend as fast as they yield and leave."""
        rate = theta[3] * np.abs(slip_m_s) / stribeck_curve(theta, slip_m_s)
        rate = rate + theta[6] * abs(rolling_m_s)
        bent = np.divide(theta[3] * slip_m_s, rate, out=np.zeros_like(slip_m_s), where=rate > 0.0)
        return np.asarray(bent + theta[5] * slip_m_s)


def stribeck_curve(theta: FloatArray, slip_m_s: FloatArray) -> FloatArray:
    """Return g(V) (n,), dimensionless, at ``slip_m_s`` (corrected Eq. 6)."""
    rise = np.expm1(theta[2])
    decay = np.exp(-np.sqrt(np.abs(slip_m_s) / theta[0]))
    return np.asarray(theta[1] * (1.0 + rise * decay))
