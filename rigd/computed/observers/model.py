"""Defines observers as plug-ins: what a model is given, and the filter that it makes of it.

A model is a class of the entry point group ``rigd.observers``, which a rig file names:
``observers: {NAME: {model: MODEL, ...}}``. Its numerics are in the compiled function of its
filter, which uses :mod:`rigd.computed.observers.kernel`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Protocol

from annotated_types import Gt, Le

from rigd.model.channels import Channel
from rigd.sdk import Documented, In

if TYPE_CHECKING:  # a rig file is checked without numba
    from rigd.computed.observers.kernel import Times
    from rigd.computed.observers.memory import Memory

#: A matrix as plain data, row by row.
Matrix = tuple[tuple[float, ...], ...]


class Filter(Protocol):
    """A filter with its state."""

    def step(self, t_ns: int, words: Times) -> None:
        """Compute the cycle at ``t_ns``, and write ``row`` of its memory; no allocation.

        ``words`` are those of the tables of the cycle (:class:`rigd.model.tables.Tables`).
        """
        ...


class ObserverPlan(ABC):
    """What a filter computes, as plain data: checked, and passed between processes."""

    @abstractmethod
    def filter(self, memory: Memory) -> Filter:
        """Return the filter on ``memory``; all that is slow happens here, compilation too."""


class ObserverOptions(Documented):
    """The keys of an observer besides `model`, `constants` and `reset`; the base of all options."""

    lost_after: Annotated[float, In("s"), Gt(0), Le(3600)] = 1.0
    """How long nothing may be measured, or an input not be known, before the states are NaN."""
    reset: Literal["run", "trial"] = "run"
    """When the filter begins anew: only with the run, or with every trial."""


@dataclass(frozen=True)
class Wanted:
    """A channel that the option ``key`` names, of the kind of ``unit``."""

    key: str
    channel: str
    unit: str


@dataclass(frozen=True)
class Known:
    """A constant of the rig in SI; ``u`` is its standard uncertainty, 0 if none is given."""

    value: float
    u: float = 0.0


class ObserverModel(ABC):
    """A kind of filter. Its module is imported when a rig file names it: numerics wait."""

    #: One line for a person: what it estimates.
    title: ClassVar[str] = ""
    Config: ClassVar[type[ObserverOptions]] = ObserverOptions
    #: The states that become channels, in the order of the row.
    states: ClassVar[tuple[Channel, ...]] = ()
    #: Units of the constants that it needs, by name, from the rig file or the observer itself.
    constants: ClassVar[Mapping[str, str]] = {}
    #: Those of ``constants`` that may be left out.
    optional_constants: ClassVar[frozenset[str]] = frozenset()

    @classmethod
    @abstractmethod
    def inputs(cls, options: Any) -> Sequence[Wanted]:
        """Return the channels, or setpoints as they were written, that drive the model."""

    @classmethod
    @abstractmethod
    def measured(cls, options: Any) -> Sequence[Wanted]:
        """Return the channels that correct the states."""

    @classmethod
    @abstractmethod
    def plan(cls, options: Any, constants: Mapping[str, Known], period_s: float) -> ObserverPlan:
        """Return the filter for cycles of ``period_s``.

        Raises:
            WrongEntries: values that do not fit together, with their keys in the observer.
            ConfigError: a file that the options name is wrong.
        """

    @classmethod
    def files(cls, options: Any) -> Mapping[Path, str]:
        """Return path and text of the files that options name; every recording keeps them."""
        return {}
