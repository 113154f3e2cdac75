"""Defines what a rig family brings to the output-error estimator: a system, simulated by trials."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

from rigd.analysis.fitting.model import FitParameter
from rigd.analysis.output_error.innovations import Deviations
from rigd.analysis.result import FloatArray
from rigd.model.errors import DataError


class Diverged(DataError):
    """The simulation of one trial (its number from 0) leaves the numbers."""

    def __init__(self, trial: int, label: str = "") -> None:
        super().__init__(
            f"{label or f'trial {trial + 1}'}: its simulation leaves the numbers, from every start",
            hint="a constant or a signal is far from what the rig has: compare both with the rig "
            "(`rigd report FILE` shows signals, `rigd identify FILE --set` corrects constants)",
        )
        self.trial = trial


@dataclass(frozen=True)
class Unknown:
    """A fitted value; ``u`` is its standard uncertainty in the coordinate of the fit.

    ``u`` is infinite for a free parameter. ``wording`` names a constant for a person.
    """

    parameter: FitParameter
    u: float = math.inf
    wording: str = ""

    def pull(self, value: float) -> float:
        """Return by how many of its uncertainties ``value`` (natural) is above what is stated."""
        return (self.parameter.scaled(value) - self.parameter.scaled(self.parameter.start)) / self.u


@dataclass(frozen=True)
class Output:
    """One output of a system."""

    name: str
    unit: str


class System(Protocol):
    """Trials of a rig that can be simulated from their measured input."""

    @property
    def shared(self) -> tuple[Unknown, ...]:
        """Return the (p,) unknowns that all trials have in common."""

    @property
    def local(self) -> tuple[Unknown, ...]:
        """Return the (l,) unknowns that each trial has for itself."""

    @property
    def outputs(self) -> tuple[Output, ...]:
        """Return the (m,) outputs."""

    @property
    def measured(self) -> tuple[FloatArray, ...]:
        """Return the measured outputs of each trial, (n, m)."""

    def simulate(self, trial: int, shared: FloatArray, local: FloatArray) -> FloatArray:
        """Return the outputs (n, m) of one trial; parameters in natural units."""

    def linearise(
        self, trial: int, shared: FloatArray, local: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the outputs (n, m) and their derivatives (n, m, p + l) to natural parameters."""

    def deviations(self, trial: int, shared: FloatArray, local: FloatArray) -> Deviations:
        """Return how noise of input and sensors moves the outputs of one trial."""


@dataclass(frozen=True, eq=False)
class Around:
    """A system made of another one; what it does not change is that of ``system``."""

    system: System

    @property
    def shared(self) -> tuple[Unknown, ...]:
        """Return the unknowns that all trials have in common."""
        return self.system.shared

    @property
    def local(self) -> tuple[Unknown, ...]:
        """Return the unknowns that each trial has for itself."""
        return self.system.local

    @property
    def outputs(self) -> tuple[Output, ...]:
        """Return the outputs."""
        return self.system.outputs

    @property
    def measured(self) -> tuple[FloatArray, ...]:
        """Return the measured outputs of each trial."""
        return self.system.measured


@dataclass(frozen=True, eq=False)
class SomeTrials(Around):
    """Some of the trials of a system; itself a :class:`System`."""

    trials: tuple[int, ...]

    @property
    def measured(self) -> tuple[FloatArray, ...]:
        """Return the measured outputs of these trials."""
        return tuple(self.system.measured[k] for k in self.trials)

    def simulate(self, trial: int, shared: FloatArray, local: FloatArray) -> FloatArray:
        """Return the outputs of one of these trials."""
        return self.system.simulate(self.trials[trial], shared, local)

    def linearise(
        self, trial: int, shared: FloatArray, local: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the outputs of one of these trials and their derivatives."""
        return self.system.linearise(self.trials[trial], shared, local)

    def deviations(self, trial: int, shared: FloatArray, local: FloatArray) -> Deviations:
        """Return how noise moves the outputs of one of these trials."""
        return self.system.deviations(self.trials[trial], shared, local)
