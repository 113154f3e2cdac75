"""Small models with closed forms, for the estimators that every analysis shares."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from rigd.analysis.fitting.model import (
    FitParameter,
    Model,
    NormalEquations,
    Scaling,
    stacked_normal_equations,
)

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Curve:
    """A toy model for the estimators: y(t) given by a function, derivatives written by hand."""

    parameters: tuple[FitParameter, ...]
    predict: Callable[[FloatArray], FloatArray]
    derivative: Callable[[FloatArray], FloatArray]
    measured: FloatArray
    trial_slices: tuple[slice, ...]

    @property
    def mask(self) -> FloatArray:
        """Return ones: every sample counts."""
        return np.ones_like(self.measured)

    def residuals(self, theta: FloatArray) -> FloatArray:
        """Return prediction minus measurement."""
        return self.predict(theta) - self.measured

    def jacobian(self, theta: FloatArray) -> FloatArray:
        """Return d(residuals)/d(theta)."""
        return self.derivative(theta)

    def cost(self, theta: FloatArray, weights: FloatArray | None = None) -> float:
        """Return half the weighted squares."""
        return self.normal_equations(theta, weights).cost

    def normal_equations(
        self, theta: FloatArray, weights: FloatArray | None = None
    ) -> NormalEquations:
        """Return dense normal equations."""
        w = self.mask if weights is None else weights
        return stacked_normal_equations(self.residuals(theta), self.jacobian(theta), w)


def _decay(measured: FloatArray, t: FloatArray) -> Curve:
    """Return y = a exp(-k t), a and k fitted in logarithms."""
    return Curve(
        (FitParameter("a", "N", 1e-3, 1e3, 1.0), FitParameter("k", "1/s", 1e-3, 1e3, 1.0)),
        lambda p: np.asarray(p[0] * np.exp(-p[1] * t)),
        lambda p: np.stack([np.exp(-p[1] * t), -p[0] * t * np.exp(-p[1] * t)], axis=1),
        measured,
        (slice(0, len(t)),),
    )


def _line(measured: FloatArray, t: FloatArray, trials: int = 1) -> Curve:
    """Return y = a + b t, linear parameters, split into ``trials`` equal trials."""
    size = len(t) // trials
    return Curve(
        (
            FitParameter("a", "N", -100.0, 100.0, 0.0, Scaling.LINEAR),
            FitParameter("b", "N/s", -100.0, 100.0, 0.0, Scaling.LINEAR),
        ),
        lambda p: np.asarray(p[0] + p[1] * t),
        lambda p: np.stack([np.ones_like(t), t], axis=1),
        measured,
        tuple(slice(i * size, (i + 1) * size) for i in range(trials)),
    )


@pytest.fixture(scope="session")
def decay() -> Callable[..., Model]:
    """Return the maker of the exponential toy model: ``decay(measured, t)``."""
    return _decay


@pytest.fixture(scope="session")
def line() -> Callable[..., Model]:
    """Return the maker of the straight-line toy model: ``line(measured, t, trials)``."""
    return _line
