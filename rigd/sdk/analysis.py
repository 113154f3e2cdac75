"""Defines what an analysis declares, for example to `rigd check`, without loading its numerics."""

from __future__ import annotations

from abc import ABC
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import ClassVar, Final, Literal

#: The options of ``rigd identify`` that an analysis may take. ``calibration``: a file instead of
#: the calibration in a recording; ``by_recording``: a separate result for each recording;
#: ``starts``, ``seed`` and ``robust``: how parameters are fitted; ``law``: the friction law to fit;
#: ``compare``: which of the laws the data support; ``joint``: groups share the rig's constants;
#: ``model``: a saved model whose parameters are taken as known, with their intervals.
OptionName = Literal[
    "starts", "seed", "robust", "calibration", "by_recording", "method", "law", "compare", "joint",
    "model",
]  # fmt: skip


#: The unit of a signal that may have any.
ANY_UNIT: Final = "any"
_OR: Final = " or "


def choices(unit: str) -> tuple[str, ...]:
    """Return the units of a signal that may be of several kinds: ``N or N m`` are two."""
    return tuple(unit.split(_OR))


@dataclass(frozen=True)
class Calibratable:
    """A value that a calibration may hold: its unit, its meaning, and what measures it."""

    unit: str
    doc: str
    procedure: str = ""  #: the shipped procedure that measures it; "" if none does
    sign: Literal["positive", "not negative", "any"] = "not negative"


@dataclass(frozen=True)
class Needs:
    """The inputs that the plan of a procedure must give, and those that it may give.

    ``signals`` and ``optional_signals`` map names to units; a channel must have a unit of the same
    kind, of one of the kinds for ``N or N m``, or any for ``ANY_UNIT``. ``constant_units`` maps
    constants to units likewise, "1" for a plain number; one that is not in it may have any.
    ``references`` are results that a plan may give published values of.
    """

    signals: Mapping[str, str]
    constants: tuple[str, ...] = ()
    trial_parameters: tuple[str, ...] = ()
    references: tuple[str, ...] = ()
    optional_signals: Mapping[str, str] = field(default_factory=dict)
    optional_constants: tuple[str, ...] = ()
    calibrated: tuple[str, ...] = ()  #: values that the rig's calibration must have
    calibrated_with: Mapping[str, tuple[str, ...]] = field(default_factory=dict)  #: of a signal
    calibrated_if_known: tuple[str, ...] = ()  #: values that are used if they are known
    constant_units: Mapping[str, str] = field(default_factory=dict)

    def calibration(self, signals: Mapping[str, str]) -> tuple[str, ...]:
        """Return the calibrated values that an evaluation of ``signals`` uses."""
        further = (self.calibrated_with.get(signal, ()) for signal in signals)
        return (*self.calibrated, *(name for names in further for name in names))


class DeclaredAnalysis(ABC):
    """The declarations of an analysis; its author derives from :class:`rigd.analysis.Analysis`."""

    needs: ClassVar[Needs]
    #: Values that calibrations may hold, by name; analyses of one family declare the same ones.
    calibratable: ClassVar[Mapping[str, Calibratable]] = MappingProxyType({})
    #: Calibrated values that a recording of this kind measures.
    measures: ClassVar[tuple[str, ...]] = ()
    options: ClassVar[tuple[OptionName, ...]] = ()
