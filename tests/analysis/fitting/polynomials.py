"""Polynomials of a degree as models: the estimators' answer is known in closed form."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from rigd.analysis.fitting.model import FitParameter, Scaling
from rigd.analysis.fitting.response import ResponseModel, ResponseTrial

FloatArray = NDArray[np.float64]
SAMPLES = 100  #: of each trial


def polynomial(
    degree: int, trials: int, noise: Callable[[int], FloatArray], slope: float = 0.0
) -> ResponseModel:
    """Return the model of ``degree`` of trials that follow 1 + ``slope`` x with noise (n,)."""
    x = np.linspace(-1.0, 1.0, SAMPLES)

    def response(theta: FloatArray, at: FloatArray) -> tuple[FloatArray, FloatArray]:
        powers = np.stack([at**k for k in range(degree + 1)], axis=1)
        return np.asarray(powers @ theta), powers

    parameters = tuple(
        FitParameter(f"c{k}", "1", -100.0, 100.0, 0.5, Scaling.LINEAR) for k in range(degree + 1)
    )
    made = tuple(
        ResponseTrial(
            f"trial {k}", "", "", np.arange(SAMPLES) / 1000.0, x, 1.0 + slope * x + noise(k),
            np.ones(SAMPLES, dtype=np.bool_),
        )
        for k in range(trials)
    )  # fmt: skip
    return ResponseModel(parameters, response, made, 1.0)


def white(seed: int, sd: float = 0.1) -> Callable[[int], FloatArray]:
    """Return independent noise of trial ``k``."""
    return lambda k: sd * np.random.default_rng([seed, k]).standard_normal(SAMPLES)


def smoothed(seed: int, window: int, sd: float = 0.1) -> Callable[[int], FloatArray]:
    """Return noise of trial ``k`` that a moving mean of ``window`` samples went over."""

    def noise(k: int) -> FloatArray:
        raw = np.random.default_rng([seed, k]).standard_normal(SAMPLES + window - 1)
        return np.asarray(
            sd * np.sqrt(window) * np.convolve(raw, np.full(window, 1.0 / window), mode="valid")
        )

    return noise
