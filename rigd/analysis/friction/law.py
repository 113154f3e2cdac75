"""Defines the base class of friction laws: slip and time in, friction over normal force out."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

from rigd.analysis.fitting.model import FitParameter
from rigd.analysis.friction.compiled_law import Gradient, Step
from rigd.analysis.result import FloatArray


@dataclass(frozen=True)
class LawParameter(FitParameter):
    """A parameter of a law, with its box and start, and how a report calls and explains it.

    ``advice`` is the excitation that would show it, for data that do not determine it.
    """

    symbol: str = ""
    meaning: str = ""
    advice: str = ""


class FrictionLaw(ABC):
    """A friction law, found by its entry point below ``rigd.friction_laws``.

    The first line of the docstring is its title. ``parameters`` are p; the law has ``states``
    internal states, all 0 in a body that has come to rest relaxed. ``step`` computes one sample
    (:func:`rigd.analysis.friction.step`). ``gradient`` does so with derivatives
    (:func:`rigd.analysis.friction.gradient`); without it they are differences of ``step``.
    """

    parameters: ClassVar[tuple[LawParameter, ...]]
    states: ClassVar[int] = 0
    step: ClassVar[Step]
    gradient: ClassVar[Gradient | None] = None

    @staticmethod
    @abstractmethod
    def steady(theta: FloatArray, slip_m_s: FloatArray, rolling_m_s: float) -> FloatArray:
        """Return F/F_N (n,) once a constant slip (n,) has lasted.

        ``theta`` (p,) in the units of the parameters. ``rolling_m_s`` is the speed at which the
        contact moves through the body, 0 for one that does not roll.
        """

    @classmethod
    def title(cls) -> str:
        """Return the first line of the docstring, without its full stop."""
        return (cls.__doc__ or cls.__name__).strip().splitlines()[0].rstrip(".")
