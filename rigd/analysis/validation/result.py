"""Defines the result of a validation: what a model predicts beside what was measured."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum

from rigd.analysis.plain_data import plain_object
from rigd.analysis.result import FloatArray, TrialRejection


class ModelOutcome(Enum):
    """How the recordings agree with the model."""

    CONFIRMED = "confirmed"
    CORRECTED = "confirmed with another constant"
    UNTESTED = "not tested"  #: the recordings cannot separate the model from a wrong one
    REJECTED = "rejected"


@dataclass(frozen=True)
class Deviation:
    """The root mean square of measured minus modelled ``output`` over one trial, in ``unit``.

    ``stated`` is that with all constants as the recording states them, ``rms`` that with the
    constants of the :class:`Bias` found. ``limit`` is the most that noise and uncertainties
    explain, None for an output that is not judged; ``size`` is the root mean square of what was
    measured; ``published`` is another author's value of the same cell.
    """

    output: str
    unit: str
    stated: float
    rms: float
    size: float
    limit: float | None = None
    published: float | None = None

    @property
    def passes(self) -> bool:
        """Whether it is explained; always for an output that is not judged."""
        return self.limit is None or self.rms <= self.limit


@dataclass(frozen=True, eq=False)
class OutputTrace:
    """Measured and modelled values (n,) of one output over a trial."""

    output: str
    unit: str
    measured: FloatArray
    modelled: FloatArray


@dataclass(frozen=True, eq=False)
class ValidatedTrial:
    """One trial: its conditions by name, as a person writes them, deviations and traces.

    ``t_s`` (n,) are the times of the traces. ``note`` is what a reader must know of it.
    """

    label: str
    recording: str
    conditions: Mapping[str, str]
    deviations: tuple[Deviation, ...]
    t_s: FloatArray
    traces: tuple[OutputTrace, ...]
    note: str = ""

    @property
    def passes(self) -> bool:
        """Whether all its judged outputs are explained."""
        return all(item.passes for item in self.deviations)

    def described(self, names: Iterable[str] | None = None) -> str:
        """Return the names and values of its conditions, or of ``names``; without, its label."""
        chosen = self.conditions if names is None else names
        return ", ".join(f"{name} {self.conditions[name]}" for name in chosen) or self.label

    def deviation(self, output: str) -> Deviation:
        """Return the deviation of ``output``; raise KeyError if there is none."""
        for item in self.deviations:
            if item.output == output:
                return item
        raise KeyError(output)

    def shape(self) -> dict[str, object]:
        """Return the fields of the JSON object: samples stand in the recording."""
        return {
            "label": self.label,
            "recording": self.recording,
            "conditions": dict(self.conditions),
            "passes": self.passes,
            "deviations": {item.output: item for item in self.deviations},
            "note": self.note,
        }


@dataclass(frozen=True)
class Bias:
    """A constant that the recording would have to state otherwise, in ``unit``.

    ``u`` is the standard uncertainty of ``value`` from the noise alone; ``stated_u`` that of
    ``stated``. ``sentence`` describes it, with what the motion cannot separate it from.
    """

    name: str
    unit: str
    stated: float
    stated_u: float
    value: float
    u: float
    sentence: str

    @property
    def pull(self) -> float:
        """By how many of its stated uncertainties it is off."""
        return (self.value - self.stated) / self.stated_u if self.stated_u > 0.0 else math.inf


@dataclass(frozen=True, eq=False)
class GroupValidation:
    """One model on the trials of one recording.

    ``sentence`` gives the outcome with its reason, ``findings`` what else a reader must know.
    ``left_out`` are trials that are not usable, and why.
    """

    label: str
    model: str
    outcome: ModelOutcome
    sentence: str
    trials: tuple[ValidatedTrial, ...]
    biases: tuple[Bias, ...] = ()
    findings: tuple[str, ...] = ()
    left_out: tuple[TrialRejection, ...] = ()


@dataclass(frozen=True, eq=False)
class Validation:
    """All groups; ``statements`` on how it was done, ``published`` names the values beside ours.

    ``judged`` are the outputs that decide, the most conclusive one first; ``method`` is what enters
    the model and what comes out, in some words.
    """

    model: str
    title: str
    groups: tuple[GroupValidation, ...]
    judged: tuple[str, ...]
    statements: tuple[str, ...]
    published: str = ""
    method: str = "current in, motion out"

    def to_json(self) -> dict[str, object]:
        """Return an object ready for ``json.dump(..., allow_nan=False)``."""
        return plain_object(self)


def pooled(deviations: Sequence[Deviation]) -> Deviation:
    """Return the root mean square over trials, each with the same weight.

    Raises:
        ValueError: no deviation, or of different outputs.
    """
    outputs = {(item.output, item.unit) for item in deviations}
    if len(outputs) != 1:
        raise ValueError(f"one output is pooled, not {sorted(outputs)}")
    ((output, unit),) = outputs
    limits = [item.limit for item in deviations if item.limit is not None]
    published = [item.published for item in deviations if item.published is not None]
    complete = len(published) == len(deviations)
    return Deviation(
        output,
        unit,
        _rms([item.stated for item in deviations]),
        _rms([item.rms for item in deviations]),
        _rms([item.size for item in deviations]),
        _rms(limits) if limits else None,
        _rms(published) if complete else None,
    )


def _rms(values: Sequence[float]) -> float:
    return math.sqrt(sum(value**2 for value in values) / len(values))
