"""Trials of a small system, not linear, whose fit takes no time."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rigd.analysis.fitting.model import FitParameter, Scaling
from rigd.analysis.output_error.estimator import OutputErrorFit, estimate
from rigd.analysis.output_error.innovations import Deviations
from rigd.analysis.output_error.system import Output, Unknown
from rigd.analysis.result import FloatArray

ROWS, BLOCK = 60, 10
NOISE = 0.05


def unknown(name: str, u: float = math.inf) -> Unknown:
    return Unknown(FitParameter(name, "1", -50.0, 50.0, 0.0, Scaling.LINEAR), u, f"the {name}")


@dataclass(frozen=True, eq=False)
class Lines:
    """Trials y = sin(t) f(own) + gain cos(t/2) + offset, f not linear; a value ``own`` per group.

    ``trials`` has (group, end of t) of each. Gain and offset are shared, stated to be 0 with the
    uncertainty 1. Without ``measured`` the trials are made with noise.
    """

    trials: tuple[tuple[int, float], ...]
    own: tuple[float, ...]
    gain: float = 0.4
    seed: int = 1
    measured: tuple[FloatArray, ...] = ()
    local: tuple[Unknown, ...] = ()
    outputs: tuple[Output, ...] = (Output("y", "1"),)

    def __post_init__(self) -> None:
        if self.measured:
            return
        rng, truth = np.random.default_rng(self.seed), np.array([*self.own, self.gain, -0.3])
        made = [self.simulate(k, truth, truth[:0]) for k in range(len(self.trials))]
        noisy = tuple(y + NOISE * rng.standard_normal(y.shape) for y in made)
        object.__setattr__(self, "measured", noisy)

    @property
    def shared(self) -> tuple[Unknown, ...]:
        own = [unknown(f"own {k}") for k in range(len(self.own))]
        return (*own, unknown("gain", 1.0), unknown("offset", 1.0))

    def linearise(
        self, trial: int, shared: FloatArray, local: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        group, end = self.trials[trial]
        t, value = np.linspace(0.0, end, ROWS), shared[group]
        by = np.zeros((ROWS, 1, len(shared)))
        by[:, 0, group] = np.sin(t) * (1.0 + 0.1 * np.cos(value))
        by[:, 0, -2], by[:, 0, -1] = np.cos(0.5 * t), 1.0
        y = np.sin(t) * (value + 0.1 * np.sin(value)) + shared[-2] * by[:, 0, -2] + shared[-1]
        return y[:, None], by

    def simulate(self, trial: int, shared: FloatArray, local: FloatArray) -> FloatArray:
        return self.linearise(trial, shared, local)[0]

    def deviations(self, trial: int, shared: FloatArray, local: FloatArray) -> Deviations:
        blank = np.zeros((ROWS, 1, 1))
        return Deviations(
            blank, blank[:, 0], blank, np.full((ROWS, 1), NOISE**2), np.zeros(1), np.eye(1)
        )


def fitted(system: Lines) -> OutputErrorFit:
    return estimate(system, [np.zeros(len(system.shared))], BLOCK)
