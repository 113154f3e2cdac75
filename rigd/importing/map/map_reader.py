"""Reads a map: its units and quantities, its plan of an identification, and what contradicts."""

from __future__ import annotations

import re
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from rigd.analysis.plan import check_plan, find_analysis
from rigd.config.binding import bind
from rigd.config.document import Document, KeyPath, parse_document, read_document
from rigd.config.problems import Problems, suggest
from rigd.config.shipped_files import find_file
from rigd.importing.map.blanks import note_blanks
from rigd.importing.map.map import (
    HAS_DATE,
    RAW,
    ChannelMap,
    ImportMap,
    ParameterMap,
    SignalMap,
    SourceMap,
    TimeMap,
    TrialsMap,
)
from rigd.importing.map.patterns import Pattern
from rigd.importing.map.zones import Zone
from rigd.importing.source import (
    ColumnSource,
    ImportSource,
    StreamSource,
    TextTableSource,
    TimeSource,
)
from rigd.language.number import number_in
from rigd.model.channels import Channel, Stream
from rigd.model.constants import Constant
from rigd.model.errors import ConfigError, RecordingError
from rigd.model.units import Quantity, Unit, parse_quantity, parse_unit
from rigd.procedure.expression import Value
from rigd.procedure.identify import read_plan
from rigd.procedure.program import IdentifyPlan
from rigd.procedure.reader import Reader
from rigd.record.mcap.schema import check_streams

#: The zero of the days of MATLAB, "January 0, 0000", and 1970-01-01 in such days (both from the
#: manual of datenum).
MATLAB_ZERO: Final = "0000-01-00"
MATLAB_EPOCH_DAYS: Final = 719_529
_DAY_NS: Final = 86_400_000_000_000


def load_map(given: str | Path) -> ImportMap:
    """Return the map in a file, or of the name of a shipped map.

    Raises:
        ConfigError: the file is missing or wrong; the error names every problem with its place.
    """
    return _read(read_document(find_file(given, "maps")))


def parse_map(text: str, path: Path) -> ImportMap:
    """Return the map in ``text``; ``path`` is its name in error messages.

    Raises:
        ConfigError: the text is wrong; the error names every problem with its place.
    """
    return _read(parse_document(text, path))


def _read(document: Document) -> ImportMap:
    problems = Problems()
    note_blanks(document, problems)
    problems.raise_any()
    source = bind(document, ImportSource, problems)
    problems.raise_any()
    if source is None:
        raise ConfigError("the map cannot be used", place=document.place(()))
    reader = _MapReader(document, problems, source)
    result = reader.read()
    problems.raise_any()
    if result is None:
        raise ConfigError("the map cannot be used", place=document.place(()))
    return result


class _MapReader:
    """Reads one map; problems are noted."""

    def __init__(self, document: Document, problems: Problems, source: ImportSource) -> None:
        self._document = document
        self._problems = problems
        self._source = source

    def read(self) -> ImportMap | None:
        source = self._source
        sources = {name: self._stream(name, item) for name, item in source.sources.items()}
        whole = [name for name, item in sources.items() if item.pattern is None]
        if len(sources) > 1:
            for name in whole:
                self._note_key(
                    ("sources", name), f"which files have the source {name} is not stated",
                    "give `file:`, such as '{test}_force.csv', for each of several sources",
                )  # fmt: skip
        parameters = self._parameters(sources)
        trials = self._trials(sources)
        started_ns = self._moment(("started",), source.started)
        plan = None if source.identify is None else self._plan(sources, parameters)
        for name in source.derived:
            if (group := name.partition(".")[0]) in sources:
                self._note_key(
                    ("derived", name),
                    f"there is a source {group} already",
                    f"choose another name before the dot, such as '{group}_derived'",
                )
        ignore = tuple(Pattern(text) for text in source.ignore)
        if self._problems.found:
            return None
        return ImportMap(
            self._document, source.map, source.title, source.rig, started_ns,
            source.warnings == "accept", sources, ignore, trials, parameters, source.derived,
            plan,
        )  # fmt: skip

    def _note(self, path: KeyPath, message: str, hint: str | None = None) -> None:
        self._problems.add(self._document.place(path), message, hint)

    def _note_key(self, path: KeyPath, message: str, hint: str | None = None) -> None:
        self._problems.add(self._document.key_place(path), message, hint)

    def _unit(self, path: KeyPath, text: str | None) -> Unit | None:
        if text is None:
            return None
        try:
            return parse_unit(text)
        except ValueError as error:
            self._note(path, str(error))
            return None

    def _quantity(self, path: KeyPath, text: str | None) -> Quantity | None:
        if text is None:
            return None
        try:
            return parse_quantity(text)
        except ValueError as error:
            self._note(path, str(error))
            return None

    def _in(self, path: KeyPath, text: str | None, unit: str) -> float | None:
        """Return a quantity of the kind of ``unit`` in SI."""
        found, wanted = self._quantity(path, text), parse_unit(unit)
        if found is None:
            return None
        if not found.unit.same_kind(wanted):
            self._note(path, f"{text!r} is no quantity in {unit}", f"such as '1 {unit}'")
            return None
        return found.value

    def _duration_ns(self, path: KeyPath, text: str | None) -> int | None:
        """Return a time above 0 in ns."""
        found = self._in(path, text, "s")
        if found is None:
            return None
        if found <= 0:
            self._note(path, f"{text} must be above 0 s")
        return round(found * 1e9)

    def _moment(self, path: KeyPath, text: str | None) -> int | None:
        if text is None:
            return None
        try:
            moment = datetime.fromisoformat(text)
        except ValueError:
            self._note(path, f"{text!r} is no date and time", "write 2016-03-04T10:00:00Z")
            return None
        if moment.tzinfo is None:
            moment = moment.replace(tzinfo=UTC)
        since = moment - datetime(1970, 1, 1, tzinfo=UTC)
        return ((since.days * 86_400 + since.seconds) * 1_000_000 + since.microseconds) * 1000

    def _pattern(self, path: KeyPath, text: str | None) -> Pattern | None:
        if text is None:
            return None
        try:
            return Pattern(text)
        except ValueError as error:
            self._note(path, str(error))
            return None

    def _stream(self, name: str, item: StreamSource) -> SourceMap:
        path: KeyPath = ("sources", name)
        if item.text.separator == "," and item.text.decimal == ",":
            self._note((*path, "text"), "the comma cannot both part cells and begin decimals")
        channels = tuple(
            self._channel((*path, "channels", channel), channel, column)
            for channel, column in item.channels.items()
        )
        names = [
            Channel(text)
            for channel in channels
            for text in (channel.name, *([channel.name + RAW] if channel.scale else []))
        ]
        try:
            check_streams([Stream(name, tuple(names))])
        except RecordingError as error:
            self._note_key((*path, "channels"), error.message, error.hint)
        return SourceMap(
            name, self._pattern((*path, "file"), item.file), item.format, item.group, item.text,
            self._time((*path, "time"), item.time), channels, item.sparse,
        )  # fmt: skip

    def _channel(self, path: KeyPath, name: str, item: ColumnSource) -> ChannelMap:
        unit = self._unit((*path, "unit"), item.unit)
        zero = self._quantity((*path, "zero"), item.zero)
        scale = self._quantity((*path, "scale"), item.scale)
        if item.zero is not None and item.scale is None:
            self._note_key((*path, "zero"), "a zero needs a scale", "add `scale: 1`")
        found = ChannelMap(
            name, item.column, unit, zero, scale, item.doc, self._document.place((*path, "column"))
        )
        if unit is not None and (problem := found.contradiction(unit)):
            key, message = problem
            self._note((*path, key), message)
        return found

    def _time(self, path: KeyPath, item: TimeSource) -> TimeMap:
        if (item.column is None) == (item.rate is None):
            self._note_key(path, "give the column of the times, or else a rate",
                           "column: Time, or rate: 1 kHz")  # fmt: skip
        of_column = (item.unit, item.format, item.since, item.restarts, item.zone, item.wraps,
                     item.coarse)  # fmt: skip
        if item.column is None and any(of_column):
            self._note_key(
                path, "unit, format, since, restarts, zone, wraps and coarse belong to a column"
            )
        since, origin_s = item.since, 0.0
        if since == MATLAB_ZERO:
            since, origin_s = "1970-01-01", MATLAB_EPOCH_DAYS * 86_400.0
        self._check_dates(path, item)
        wraps_ns, wraps_bits = self._wraps((*path, "wraps"), item)
        unit = self._unit((*path, "unit"), item.unit)
        if unit is not None and not unit.same_kind(parse_unit("s")):
            self._note((*path, "unit"), f"{unit} is no unit of time", "such as s, ms or ns")
        rate = self._in((*path, "rate"), item.rate, "Hz")
        if rate is not None and not 1e-6 <= rate <= 1e9:
            self._note((*path, "rate"), f"{item.rate} is no rate", "such as 1 kHz")
        shift = self._in((*path, "shift"), item.shift, "s") or 0.0
        return TimeMap(
            item.column, unit, rate, self._moment((*path, "since"), since), item.format,
            round(shift * 1e9), item.restarts,
            self._duration_ns((*path, "longest_gap"), item.longest_gap),
            self._document.place((*path, "column")),
            wraps_ns, wraps_bits, self._zone(path, item), item.coarse is not None, origin_s,
        )  # fmt: skip

    def _check_dates(self, path: KeyPath, item: TimeSource) -> None:
        """Check what belongs to times that are written as dates, or as times of a day."""
        form = item.format
        if form is None:
            return
        if item.unit is not None or item.wraps is not None:
            self._note_key(path, "times that are written as dates have no unit, and no wraps")
        if form == "iso" or HAS_DATE.search(form):
            if item.since is not None:
                self._note((*path, "since"), "times that are written as dates have no `since:`",
                           "remove `since:`")  # fmt: skip
            if form != "iso" and not re.search("%[yYGcx]", form):
                self._note((*path, "format"), f"{form!r} has no year, and the file must state it")
            return
        if "%I" in form and "%p" not in form:
            self._note((*path, "format"), f"{form!r} does not tell morning from evening",
                       "write `%H` for hours up to 23, or `%I` and `%p` for AM, PM")  # fmt: skip
        if item.since is None:
            self._note((*path, "format"), "times of a day need the day of the first row",
                       "add `since: 2025-03-03` below `time:`, with that day")  # fmt: skip
        elif not re.fullmatch(r"[-0-9]+(T00:00(:00)?(Z|[-+]\d\d:\d\d)?)?", item.since):
            self._note((*path, "since"), f"{item.since!r} is no day",
                       f"write `since: {item.since[:10]}`")  # fmt: skip

    def _wraps(self, path: KeyPath, item: TimeSource) -> tuple[int | None, int | None]:
        """Return the range of a counter in ns, or else in bits, that is in counts of its unit."""
        if item.format is not None and item.since is not None:
            return _DAY_NS, None
        if item.wraps is None:
            return None, None
        if item.restarts:
            self._note(path, "a counter that wraps does not begin again in each test",
                       "remove `wraps:` or `restarts:`")  # fmt: skip
        if (bits := re.fullmatch(r"(\d{1,2}) *bits?", item.wraps)) and 0 < int(bits[1]) < 64:
            return None, int(bits[1])
        power = re.fullmatch(r"2\^(\d{1,2}) +(\S+)", item.wraps)
        text = item.wraps if power is None else f"{2 ** int(power[1])} {power[2]}"
        return self._duration_ns(path, text), None

    def _zone(self, path: KeyPath, item: TimeSource) -> Zone | None:
        if item.zone is None:
            return None
        if item.format is None and item.since is None:
            self._note((*path, "zone"), "a zone belongs to times with a date",
                       "add `since:` or `format:`, or remove `zone:`")  # fmt: skip
        if item.since is not None and re.search(r"T.*(Z|[-+]\d\d:?\d\d)$", item.since):
            self._note((*path, "since"), f"{item.since!r} states its zone, too",
                       "remove `zone:`, or the zone in `since:`")  # fmt: skip
        try:
            return Zone(item.zone)
        except ValueError as error:
            self._note((*path, "zone"), str(error), "such as `zone: Europe/Berlin` or `zone: "
                       "'+01:00'`; `pip install tzdata` brings the database")  # fmt: skip
            return None

    def _trials(self, sources: Mapping[str, SourceMap]) -> TrialsMap:
        item, path = self._source.trials, ("trials",)
        ways = [bool(item.columns), item.gaps is not None, item.signal is not None]
        if sum(ways) > 1:
            self._note_key(path, "trials are shown by columns, by gaps or by a signal: give one")
        if not item.columns and (item.outside or item.table):
            self._note_key(path, "outside and table belong to columns")
        signal, name = None, item.source or next(iter(sources))
        if item.signal is not None:
            name = item.signal.channel.partition(".")[0]
            signal = self._signal(sources)
        if name not in sources:
            self._note((*path, "source"), f"there is no source {name!r}", suggest(name, sources))
        table = item.table
        return TrialsMap(
            source=name,
            columns=tuple(item.columns),
            outside=frozenset(item.outside),
            gap_ns=self._duration_ns((*path, "gaps"), item.gaps),
            signal=signal,
            shortest_ns=self._duration_ns((*path, "shortest"), item.shortest) or 0,
            steps=item.steps,
            table=None if table is None else self._pattern((*path, "table", "file"), table.file),
            table_key="" if table is None else table.key,
            table_text=TextTableSource() if table is None else table.text,
        )

    def _signal(self, sources: Mapping[str, SourceMap]) -> SignalMap | None:
        item = self._source.trials.signal
        path: KeyPath = ("trials", "signal")
        if item is None:
            return None
        channel = item.channel.partition(".")[2]
        known = {f"{s}.{c.name}": c for s, source in sources.items() for c in source.channels}
        if item.channel not in known:
            self._note((*path, "channel"), f"there is no channel {item.channel!r}",
                       suggest(item.channel, known))  # fmt: skip
        if item.above is None and item.below is None:
            self._note_key(path, "give `above`, `below`, or both")
        low = self._quantity((*path, "above"), item.above)
        high = self._quantity((*path, "below"), item.below)
        signal = SignalMap(channel, low, high, self._document.key_place(path))
        found = known.get(item.channel)
        if found is not None and found.unit is not None:
            try:
                signal.check(found.channels(found.unit)[0].unit)
            except ConfigError as error:
                self._problems.take([error])
        return signal

    def _parameters(self, sources: Mapping[str, SourceMap]) -> dict[str, ParameterMap]:
        fields = {name for item in sources.values() if item.pattern for name in item.pattern.fields}
        found = {}
        for name, item in self._source.parameters.items():
            path: KeyPath = ("parameters", name)
            if sum(given is not None for given in (item.value, item.column, item.name)) != 1:
                self._note_key(path, "give its value, or the column or name that has it")
            unit = self._unit((*path, "unit"), item.unit)
            value: float | str | None = None
            if item.value is not None:
                value = item.value
                try:
                    given = parse_quantity(item.value)
                    value, unit = given.value, given.unit
                except ValueError as error:
                    if item.value[:1].isdigit() or item.unit is not None:
                        self._note((*path, "value"), str(error))
                if item.unit is not None:
                    self._note((*path, "unit"), "a value has its own unit")
            if item.name is not None and item.name not in fields:
                self._note((*path, "name"), f"no `file` of the sources has {{{item.name}}}",
                           suggest(item.name, fields))  # fmt: skip
            found[name] = ParameterMap(
                name, value, item.column, item.name, unit, self._document.key_place(path)
            )
        return found

    def _plan(
        self, sources: Mapping[str, SourceMap], parameters: Mapping[str, ParameterMap]
    ) -> IdentifyPlan | None:
        """Return the plan, once its model gets all that it needs."""
        identify, known = self._source.identify, len(self._problems.found)
        if identify is None:
            return None
        place = self._document.key_place(("identify",))
        base: dict[str, Value] = {}
        trial: dict[str, Value] = {}
        for name, item in parameters.items():
            value = item.value
            scope = trial if value is None else base
            if value is None and item.unit is not None:
                scope[name] = number_in(1.0, item.unit)  # its kind: each trial has its own value
            else:
                scope[name] = (
                    number_in(value, item.unit or parse_unit("1"))
                    if isinstance(value, float)
                    else str(value)
                )
        units = {name: item.unit.symbol for name, item in parameters.items() if item.unit}
        reader = Reader(self._document, self._problems, units, frozenset(trial))
        by = None if identify.reference is None else identify.reference.by
        words = [n for n, item in parameters.items() if item.unit is None]
        choices: dict[str, tuple[str, ...]] = {name: () for name in words}
        if by in words and identify.reference is not None:
            choices[by] = tuple(identify.reference.values)
        nothing: Mapping[str, Constant] = {}
        there = [f"{s}.{c.name}" for s, item in sources.items() for c in item.channels]
        there += self._source.derived
        plan = read_plan(
            reader, choices, identify, nothing, (base, {**base, **trial}), set(trial),
            has=there.__contains__,
        )  # fmt: skip
        for signal, channel in identify.signals.items():
            if channel not in there:
                self._note(("identify", "signals", signal), f"there is no channel {channel!r}",
                           suggest(channel, there))  # fmt: skip
        for index, name in enumerate(plan.group_by):
            if name not in parameters:
                path = ("identify", "group_by", index)
                self._note(path, f"there is no parameter {name!r}", suggest(name, parameters))
        if len(self._problems.found) > known:
            return None
        try:
            check_plan(plan, find_analysis(plan.model), place, tuple(parameters))
        except ConfigError as error:
            hint = error.hint and error.hint.replace(" in the procedure", "")
            self._problems.add(error.place or place, error.message, hint)
        return plan
