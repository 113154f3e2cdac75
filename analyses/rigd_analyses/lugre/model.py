"""Defines the LuGre friction model for the estimators: slip is its input, traction its output."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rigd.analysis.friction import LawModel, SlipForce
from rigd.analysis.result import FloatArray
from rigd_analyses.lugre.laws.lugre import Lugre, stribeck_curve

V_S, MU_C, RATIO, SIGMA_0, SIGMA_1, SIGMA_2 = range(6)
PARAMETERS = Lugre.parameters


class LugreModel(LawModel):
    """Residuals F_model/F_N - F_measured/F_N of several trials, with analytic sensitivities."""

    def __init__(self, trials: Sequence[SlipForce]) -> None:
        super().__init__(Lugre, trials)


def friction(theta: FloatArray, slip_m_s: FloatArray) -> FloatArray:
    """Return g(V_r), dimensionless, at ``slip_m_s`` (corrected Eq. 6)."""
    return stribeck_curve(theta, slip_m_s)


def friction_gradient(theta: FloatArray, slip_m_s: FloatArray) -> FloatArray:
    """Return dg/d(theta), (n, 6), at ``slip_m_s``; zero to sigma_0, sigma_1, sigma_2."""
    rise = np.expm1(theta[RATIO])
    root = np.sqrt(np.abs(slip_m_s) / theta[V_S])
    decay = np.exp(-root)
    out = np.zeros((len(slip_m_s), len(theta)))
    out[:, V_S] = theta[MU_C] * rise * decay * root / (2.0 * theta[V_S])
    out[:, MU_C] = 1.0 + rise * decay
    out[:, RATIO] = theta[MU_C] * (rise + 1.0) * decay
    return out
