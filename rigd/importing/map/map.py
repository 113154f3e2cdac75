"""Holds a checked map of ``rigd import``: what the files of another program mean."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from rigd.analysis.plan import find_analysis, of_kind
from rigd.config.document import Document
from rigd.config.source import DerivedSource
from rigd.importing.map.patterns import Pattern
from rigd.importing.map.zones import Zone
from rigd.importing.source import Format, TextTableSource
from rigd.model.channels import Channel, Stream
from rigd.model.errors import ConfigError, Place
from rigd.model.units import Quantity, Unit, parse_unit, si_symbol
from rigd.procedure.program import IdentifyPlan
from rigd.sdk.analysis import ANY_UNIT

#: What a form of times has if it has a day, as Python writes it.
HAS_DATE: Final = re.compile(r"%[aAdjbBmyYGVuUwWcx]")
#: Suffix of the channel with the reading before ``zero`` and ``scale``.
RAW: Final = "_raw"


@dataclass(frozen=True)
class ChannelMap:
    """One channel: its column, and value = (reading - zero)·scale, in SI.

    ``unit`` is that of the column, None if the file shall state it.
    """

    name: str
    column: str
    unit: Unit | None
    zero: Quantity | None
    scale: Quantity | None
    doc: str
    place: Place  #: of the column in the map

    def contradiction(self, unit: Unit) -> tuple[str, str] | None:
        """Return which key does not fit a column in ``unit``, and why; None if all fit."""
        if self.zero is not None and not self.zero.unit.same_kind(unit):
            return "zero", f"'{self.zero}' is no quantity in {unit}"
        if self.scale is not None and (self.scale.unit.offset or unit.offset):
            return "scale", "a unit with a zero of its own cannot be scaled"
        return None

    def channels(self, unit: Unit) -> tuple[Channel, ...]:
        """Return what is recorded of a column in ``unit``: the channel, and its raw reading."""
        own = si_symbol(unit.dimension)
        if self.scale is None:
            return (Channel(self.name, own, self.doc),)
        dimension = tuple(
            a + b for a, b in zip(unit.dimension, self.scale.unit.dimension, strict=True)
        )
        return (
            Channel(self.name, si_symbol(dimension), self.doc),
            Channel(f"{self.name}{RAW}", own, raw_of=self.name),
        )


@dataclass(frozen=True)
class TimeMap:
    """When samples were taken. Times are in ns, ``since_ns`` None if 0 is where a test begins."""

    column: str | None
    unit: Unit | None
    rate_hz: float | None
    since_ns: int | None
    format: str | None
    shift_ns: int
    restarts: bool
    longest_gap_ns: int | None
    place: Place
    wraps_ns: int | None = None  #: the range of its counter
    wraps_bits: int | None = None  #: the same in counts of the unit that the file states
    zone: Zone | None = None
    coarse: bool = False
    origin_s: float = 0.0  #: subtracted from each time, for a zero that ns since 1970 cannot hold

    @property
    def is_time_of_day(self) -> bool:
        """Whether times are written without a date."""
        return self.format not in (None, "iso") and not HAS_DATE.search(self.format or "")


@dataclass(frozen=True)
class SourceMap:
    """One table of samples, which becomes the stream ``name``."""

    name: str
    pattern: Pattern | None
    format: Format | None
    group: str | None
    text: TextTableSource
    time: TimeMap
    channels: tuple[ChannelMap, ...]
    sparse: bool


@dataclass(frozen=True)
class SignalMap:
    """A trial goes on while ``channel`` of the source is above ``above`` and below ``below``."""

    channel: str
    above: Quantity | None
    below: Quantity | None
    place: Place

    def check(self, unit: str) -> None:
        """Check that the channel, which is recorded in ``unit``, can be compared with both.

        Raises:
            ConfigError: it is of another kind.
        """
        for value in (self.above, self.below):
            if value is not None and not value.unit.same_kind(parse_unit(unit)):
                raise ConfigError(f"'{value}' is no quantity in {unit}", place=self.place)


@dataclass(frozen=True)
class TrialsMap:
    """Where trials begin and end."""

    source: str
    columns: tuple[str, ...] = ()
    outside: frozenset[str] = frozenset()
    gap_ns: int | None = None
    signal: SignalMap | None = None
    shortest_ns: int = 0
    steps: str | None = None
    table: Pattern | None = None
    table_key: str = ""
    table_text: TextTableSource = field(default_factory=TextTableSource)

    @property
    def is_whole_file(self) -> bool:
        """Whether nothing shows trials: a file is one."""
        return not self.columns and self.gap_ns is None and self.signal is None


@dataclass(frozen=True)
class ParameterMap:
    """A parameter of the trials: a fixed value, or where it stands; ``unit`` None for words."""

    name: str
    value: float | str | None
    column: str | None
    field: str | None
    unit: Unit | None
    place: Place


@dataclass(frozen=True, eq=False)
class ImportMap:
    """A checked map."""

    document: Document
    name: str
    title: str
    rig: str
    started_ns: int | None
    accepts_warnings: bool
    sources: Mapping[str, SourceMap]
    ignore: tuple[Pattern, ...]
    trials: TrialsMap
    parameters: Mapping[str, ParameterMap]
    derived: Mapping[str, DerivedSource]
    plan: IdentifyPlan | None

    @property
    def path(self) -> Path:
        """The file of the map."""
        return self.document.path

    def check_signals(self, streams: Mapping[str, Stream]) -> None:
        """Check that the channels of ``streams`` have the units that the plan's model works from.

        Raises:
            ConfigError: one is of another kind.
        """
        if self.plan is None:
            return
        needs = find_analysis(self.plan.model).needs
        for name, wanted in {**needs.signals, **needs.optional_signals}.items():
            stream, _, channel = self.plan.signals.get(name, "").partition(".")
            if stream not in streams or wanted == ANY_UNIT:
                continue
            known = {item.name: item.unit for item in streams[stream].channels}
            if channel in known and not of_kind(known[channel], wanted):
                raise ConfigError(
                    f"identify: the signal {name} is {stream}.{channel}, in {known[channel]}; "
                    f"the model works from {wanted}",
                    place=self.document.place(("identify", "signals", name)),
                    hint="a `scale` such as '250 N/V' makes another quantity of a reading",
                )
