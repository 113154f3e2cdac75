"""Computes the reported quantities and their gradients from the fitted coordinates."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rigd.analysis.result import FloatArray
from rigd_analyses.lugre.model import MU_C, RATIO, SIGMA_0, SIGMA_1, SIGMA_2, V_S


@dataclass(frozen=True)
class Quantity:
    """A reported quantity: ``value(theta)`` and ``gradient(theta)`` (6,) to natural parameters.

    ``direction`` is the combination of scaled coordinates that a profile can hold to hold the
    logarithm of this quantity; None if there is none. ``index`` is the fitted coordinate that
    the quantity is, None for a combination.
    """

    name: str
    symbol: str
    unit: str
    meaning: str
    value: Callable[[FloatArray], float]
    gradient: Callable[[FloatArray], FloatArray]
    direction: tuple[float, ...] | None = None
    index: int | None = None

    def log(self, theta: FloatArray) -> FloatArray:
        """Return the logarithm of the value, (1,): minus infinity if it is 0, as at mu_s = mu_c."""
        value = self.value(theta)
        return np.array([math.log(value) if value > 0.0 else -math.inf])

    def log_gradient(self, theta: FloatArray) -> FloatArray:
        """Return the gradient of the logarithm, (1, 6)."""
        return np.asarray(self.gradient(theta)[None, :] / self.value(theta))


def _unit(*entries: tuple[int, float]) -> FloatArray:
    row = np.zeros(6)
    for index, value in entries:
        row[index] = value
    return row


def height(theta: FloatArray) -> float:
    """Return mu_s - mu_c."""
    return float(theta[MU_C] * math.expm1(theta[RATIO]))


def height_gradient(theta: FloatArray) -> FloatArray:
    """Return d(mu_s - mu_c)/d(theta), (6,)."""
    return _unit((MU_C, math.expm1(theta[RATIO])), (RATIO, _mu_s(theta)))


def _mu_s(theta: FloatArray) -> float:
    return float(theta[MU_C] * math.exp(theta[RATIO]))


def _plain(index: int) -> Callable[[FloatArray], float]:
    return lambda theta: float(theta[index])


def _plain_gradient(index: int) -> Callable[[FloatArray], FloatArray]:
    return lambda theta: _unit((index, 1.0))


STRIBECK_SPEED = Quantity(
    "V_s", "V_s", "m/s", "slip at which the Stribeck effect has fallen to 1/e",
    _plain(V_S), _plain_gradient(V_S), (1, 0, 0, 0, 0, 0),
)  # fmt: skip
COULOMB = Quantity(
    "mu_c", "μ_c", "1", "normalised Coulomb friction, g far above V_s",
    _plain(MU_C), _plain_gradient(MU_C), (0, 1, 0, 0, 0, 0),
)  # fmt: skip
STATIC = Quantity(
    "mu_s", "μ_s", "1", "normalised static friction, g at zero slip",
    _mu_s, lambda t: _unit((MU_C, _mu_s(t) / t[MU_C]), (RATIO, _mu_s(t))), (0, 1, 1, 0, 0, 0),
)  # fmt: skip
STIFFNESS = Quantity(
    "sigma_0", "σ_0", "1/m", "normalised bristle stiffness", _plain(SIGMA_0),
    _plain_gradient(SIGMA_0), index=SIGMA_0,
)  # fmt: skip
DAMPING = Quantity(
    "sigma_1", "σ_1", "s/m", "normalised bristle damping", _plain(SIGMA_1),
    _plain_gradient(SIGMA_1), index=SIGMA_1,
)  # fmt: skip
VISCOUS = Quantity(
    "sigma_2", "σ_2", "s/m", "normalised viscous friction", _plain(SIGMA_2),
    _plain_gradient(SIGMA_2), index=SIGMA_2,
)  # fmt: skip
TOTAL_DAMPING = Quantity(
    "sigma_1+sigma_2", "σ_1 + σ_2", "s/m", "force per slip speed right after a jump of the slip",
    lambda t: float(t[SIGMA_1] + t[SIGMA_2]), lambda t: _unit((SIGMA_1, 1.0), (SIGMA_2, 1.0)),
)  # fmt: skip

PROFILED = (STRIBECK_SPEED, COULOMB, STATIC)
BY_COVARIANCE = (STIFFNESS, DAMPING, VISCOUS)
