"""Defines the result of a calibration: values, their basis, the unknowns, reasons for refusal."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from rigd.analysis.result import FloatArray


@dataclass(frozen=True)
class Contribution:
    """One term of an uncertainty: ``u`` is its share (k = 1), in the unit of the value."""

    name: str
    u: float


@dataclass(frozen=True)
class Measured:
    """A value in SI with the terms of its standard uncertainty (GUM, JCGM 100:2008, 5.1.2)."""

    value: float
    unit: str
    budget: tuple[Contribution, ...]

    @property
    def u(self) -> float:
        """Standard uncertainty (k = 1): the terms are independent."""
        return math.hypot(*(item.u for item in self.budget))

    def shape(self) -> dict[str, object]:
        """Return the fields of the JSON object."""
        budget = {term.name: term.u for term in self.budget}
        return {"value": self.value, "u": self.u, "unit": self.unit, "budget": budget}


@dataclass(frozen=True, eq=False)
class Series:
    """Points with their fit, for a figure: (n,) each, and what the axes are."""

    title: str
    x_label: str  #: with its unit
    y_label: str
    x: FloatArray
    y: FloatArray
    fitted: FloatArray


@dataclass(frozen=True)
class CalibrationResult:
    """The outcome of one calibration.

    ``refusals`` are the reasons why it is none of its ``kind``: then nothing may be taken from it.
    ``kept`` has for values that the data do not determine the reason; ``facts`` are what a person
    will want to read beside.
    """

    title: str
    measured: Mapping[str, Measured]
    facts: tuple[str, ...] = ()
    kept: Mapping[str, str] = field(default_factory=dict)
    series: tuple[Series, ...] = ()
    refusals: tuple[str, ...] = ()
    kind: str = "calibration"


def together(title: str, results: Sequence[CalibrationResult]) -> CalibrationResult:
    """Return several results as one, which is refused if one of them is."""
    refused = tuple(f"{result.title}: {why}" for result in results for why in result.refusals)
    return CalibrationResult(
        title,
        {} if refused else {name: v for result in results for name, v in result.measured.items()},
        tuple(fact for result in results for fact in result.facts),
        {name: why for result in results for name, why in result.kept.items()},
        tuple(series for result in results for series in result.series),
        refused,
    )
