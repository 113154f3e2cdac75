"""Defines laws without a memory: the friction follows the slip at once."""

from __future__ import annotations

import numpy as np

from rigd.analysis.fitting.model import Scaling
from rigd.analysis.friction import FrictionLaw, LawParameter, step
from rigd.analysis.result import FloatArray
from rigd_analyses.lugre.laws.bristle import (
    COULOMB,
    FRICTION,
    STRIBECK_SPEED,
    VISCOUS,
    stribeck,
)
from rigd_analyses.lugre.laws.lugre import RATIO, stribeck_curve

WIDER = "It needs a wider range of slip."


@step
def _coulomb(
    state: FloatArray, theta: FloatArray, between: float, slip: float, rolling: float, dt: float
) -> float:
    return float(theta[0] * np.sign(slip) + theta[1] * slip)


@step
def _stribeck(
    state: FloatArray, theta: FloatArray, between: float, slip: float, rolling: float, dt: float
) -> float:
    g = stribeck(slip, theta[0], theta[1], np.expm1(theta[2]))[0]
    return float(g * np.sign(slip) + theta[3] * slip)


@step
def _magic(
    state: FloatArray, theta: FloatArray, between: float, slip: float, rolling: float, dt: float
) -> float:
    x = theta[2] * slip
    return float(theta[0] * np.sin(theta[1] * np.arctan(x - theta[3] * (x - np.arctan(x)))))


class CoulombViscous(FrictionLaw):
    """Coulomb and viscous friction: F/F_N = mu sign(V) + sigma_2 V."""

    parameters = (FRICTION, VISCOUS)
    step = _coulomb

    @staticmethod
    def steady(theta: FloatArray, slip_m_s: FloatArray, rolling_m_s: float) -> FloatArray:
        """Return the law itself."""
        return np.asarray(theta[0] * np.sign(slip_m_s) + theta[1] * slip_m_s)


class Stribeck(FrictionLaw):
    """Stribeck curve with viscous friction: F/F_N = g(V) sign(V) + sigma_2 V."""

    parameters = (STRIBECK_SPEED, COULOMB, RATIO, VISCOUS)
    step = _stribeck

    @staticmethod
    def steady(theta: FloatArray, slip_m_s: FloatArray, rolling_m_s: float) -> FloatArray:
        """Return the law itself."""
        return np.asarray(stribeck_curve(theta, slip_m_s) * np.sign(slip_m_s) + theta[3] * slip_m_s)


class MagicFormula(FrictionLaw):
    """Magic Formula of the slip: F/F_N = D sin(C arctan(B V - E (B V - arctan B V))).

    H. B. Pacejka, Tire and Vehicle Dynamics, 3rd ed., Eq. 4.6, with the slip speed in place of the
    slip ratio, and no offsets.
    """

    parameters = (
        LawParameter("D", "1", 1e-3, 10.0, 0.3, symbol="D", meaning="peak", advice=WIDER),
        LawParameter("C", "1", 0.1, 3.0, 1.3, symbol="C", meaning="shape", advice=WIDER),
        LawParameter("B", "s/m", 0.1, 1e4, 30.0, symbol="B", meaning="stiffness", advice=WIDER),
        LawParameter(
            "E", "1", -10.0, 1.0, 0.0, Scaling.LINEAR, symbol="E", meaning="curvature",
            advice=WIDER,
        ),
    )  # fmt: skip
    step = _magic

    @staticmethod
    def steady(theta: FloatArray, slip_m_s: FloatArray, rolling_m_s: float) -> FloatArray:
        """Return the law itself."""
        x = theta[2] * slip_m_s
        return np.asarray(
            theta[0] * np.sin(theta[1] * np.arctan(x - theta[3] * (x - np.arctan(x))))
        )
