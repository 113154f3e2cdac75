"""Computes derived channels of a recording after the fact, by the formulas and kernel of the cycle.

With the stream of the cycle a group has a row at each cycle, and takes the last reading of each
channel until then, with its age, as the cycle does: it equals that of the run to the last bit, if
what it is computed from was read and recorded in every cycle. Without, it has the rows of the
slowest stream in it, to which others are brought as for an analysis (:func:`.resample.brought`).
"""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from rigd.computed.controllers.driver import CONTROLLER
from rigd.computed.derived.driver import DERIVED
from rigd.computed.derived.graph import Graph
from rigd.config.binding import bind
from rigd.config.computed.derived import ByTrial, FormulaNames, read_graph
from rigd.config.document import Document, parse_document
from rigd.config.loader import parse_constants
from rigd.config.problems import Problems, suggest
from rigd.config.source import ChannelName, DerivedSource, Source
from rigd.language.number import ExpressionError, Number, number_in
from rigd.language.syntax import Name, parse, parts
from rigd.model.channels import ECHO, STATUS_FIELD, Stream
from rigd.model.constants import Constant
from rigd.model.errors import ConfigError
from rigd.model.rows import TIME_FIELD, row_dtype
from rigd.model.units import parse_quantity, parse_unit
from rigd.record.read.resample import brought, stale_rows

if TYPE_CHECKING:
    from rigd.record.read.reader import Recording

#: The stream of the cycle itself, and a channel that it alone has.
_CYCLE: Final = "cycle"
_SCHEDULED: Final = "scheduled"
#: A reading is late after this number of usual periods of its stream, as in a file that is
#: imported. What is read in every cycle is late if it is not of the cycle.
_LATE_PERIODS: Final = 10.0
#: Periods that differ by less are the same, as a share.
_SAME_PERIOD: Final = 0.01
#: Rows that are computed at once: 6 MB with three inputs.
_BLOCK: Final = 131_072
#: What is written ``${name}``, by name: a quantity, or a word.
Values = Mapping[str, Number | str]

Times = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class _Readings:
    """The readings of a stream that are not repeated: times (n,) in ns, values (n,) by channel."""

    times: Times
    values: Mapping[str, NDArray[np.float64]]
    period_ns: float


@dataclass(frozen=True, eq=False)
class _Input:
    """An input of the graph at each row: values (n,), their times (n,) in ns, when it is late."""

    values: NDArray[np.float64]
    stamps: Times
    late_ns: int


@dataclass(frozen=True, eq=False)
class DerivedStreams:
    """The ``streams`` that ``graph`` computes from ``recording``, as ``sources`` state it."""

    recording: Recording
    graph: Graph
    streams: Mapping[str, Stream]
    sources: Mapping[str, DerivedSource]
    _rows: dict[str, NDArray[np.void]] = field(default_factory=dict)

    @cached_property
    def bases(self) -> Mapping[str, str]:
        """The stream of the recording with the times of each group."""
        return {
            group: _base(self.recording, self.inputs(group) or set(self.recording.streams))
            for group in self.streams
        }

    def inputs(self, group: str) -> set[str]:
        """Return the streams from which a group is computed."""
        return {name.partition(".")[0] for name in self._channels(group)}

    def needed(self, streams: Collection[str]) -> set[str]:
        """Return the recorded streams behind ``streams``."""
        own = set(streams) & self.streams.keys()
        return {*streams} - own | {n for g in own for n in (*self.inputs(g), self.bases[g])}

    def rows(self, group: str) -> NDArray[np.void]:
        """Return all rows of a group; they are computed once, and held in memory.

        Raises:
            RecordingError: a damaged chunk.
        """
        if group not in self._rows:
            base = self.bases[group]
            self._compute(base, [name for name, of in self.bases.items() if of == base])
        return self._rows[group]

    def _channels(self, group: str) -> list[str]:
        behind = {row for name in self.graph.groups()[group] for row in self.graph.behind(name)}
        return [
            name
            for place, name in enumerate(self.graph.inputs)
            if any(self.graph.rows[row].is_input(place) for row in behind)
        ]

    def _compute(self, base: str, groups: list[str]) -> None:
        from rigd.computed.derived.replay import Replay  # it loads numba

        graph, in_cycle = self.graph, _has_cycle(self.recording)
        times = _times(self.recording, base)
        count, begun_ns = len(times), int(times[0]) if len(times) else 0
        used = {name for group in groups for name in self._channels(group)}
        inputs = self._inputs(base, used, times, begun_ns, in_cycle=in_cycle)
        missing = _Input(np.full(1, np.nan), np.full(1, begun_ns), 0)
        sources = [inputs.get(name, missing) for name in graph.inputs]
        replay = Replay(graph, [source.late_ns for source in sources], begun_ns)
        found = {group: np.empty(count, row_dtype(self.streams[group])) for group in groups}
        for begin, end, changes in self._parts(times, in_cycle=in_cycle):
            for change, trial in changes:
                if change == "run":
                    replay.begin()
                elif change == "begin":
                    replay.begin_trial(trial)
                else:
                    replay.end_trial()
            values = np.empty((end - begin, len(sources)))
            stamps = np.empty((end - begin, len(sources)), np.int64)
            for place, source in enumerate(sources):
                values[:, place] = source.values[begin:end] if source is not missing else np.nan
                stamps[:, place] = source.stamps[begin:end] if source is not missing else begun_ns
            for group, packed in replay.rows(times[begin:end], values, stamps).items():
                if group in found:
                    dtype = found[group].dtype
                    found[group][begin:end] = np.ascontiguousarray(packed).view(dtype)[:, 0]
        self._rows.update(found)

    def _inputs(
        self, base: str, used: Collection[str], times: Times, begun_ns: int, *, in_cycle: bool
    ) -> dict[str, _Input]:
        """Return the channels ``used`` at ``times`` (n,), by the rule for this recording."""
        found: dict[str, _Input] = {}
        for stream in sorted({_of(name) for name in used}):
            names = [name for name in used if _of(name) == stream]
            own = self._readings(stream, [name.partition(".")[2] for name in names])
            if not in_cycle:
                is_base = stream == base
                found |= {name: _brought(own, name, times, is_base=is_base) for name in names}
                continue
            if not len(own.times):
                continue
            late_ns = _late_ns(own.period_ns, _period(times))
            # Setpoints are written after derived channels are computed, and controllers act then.
            before = np.searchsorted(own.times, times, "left") - 1
            is_controller = self.recording.streams[stream].source == CONTROLLER
            last = before if is_controller else np.searchsorted(own.times, times, "right") - 1
            known = last >= 0
            stamps = own.times[last] if known.all() else np.where(known, own.times[last], begun_ns)
            for name in names:
                values = own.values[name.partition(".")[2]]
                if name.endswith(ECHO):
                    found[name] = _Input(values[np.maximum(before, 0)], times, 0)
                else:
                    found[name] = _Input(np.where(known, values[last], np.nan), stamps, late_ns)
        return found

    def _readings(self, stream: str, channels: Collection[str]) -> _Readings:
        """Return times and ``channels`` of a stream, without rows that repeat a reading."""
        has_status, count = self.recording.streams[stream].has_status, 0
        times, values = [np.empty(0, np.int64)], {n: [np.empty(0)] for n in channels}
        for rows in self.recording.batches(stream):
            count += len(rows)
            if has_status:
                rows = rows[~stale_rows(rows[STATUS_FIELD])]
            times.append(rows[TIME_FIELD].astype(np.int64))
            for name in channels:
                values[name].append(rows[name].astype(np.float64))
        every = np.concatenate(times)
        span = int(every[-1] - every[0]) if len(every) > 1 else 0
        period = span / (count - 1) if count > 1 and span else np.inf
        return _Readings(every, {n: np.concatenate(v) for n, v in values.items()}, period)

    def _parts(
        self, times: Times, *, in_cycle: bool
    ) -> Iterator[tuple[int, int, list[tuple[str, int]]]]:
        """Yield begin and end of parts of ``times``, and what changes where each begins.

        In the cycle a trial begins, and ends, with the cycle after its event.
        """
        side: Final = "right" if in_cycle else "left"
        changes: dict[int, list[tuple[str, int]]] = {}
        moments = [
            (event.t_ns, "run", 0)
            for event in self.recording.all_events
            if event.kind == "run_start" and event.data.get("resumed")
        ]
        for trial in self.recording.trials:
            moments += [(trial.start_ns, "begin", trial.number), (trial.end_ns, "end", 0)]
        for t_ns, change, trial_number in sorted(moments, key=lambda item: item[0]):
            place = int(np.searchsorted(times, t_ns, side))
            changes.setdefault(place, []).append((change, trial_number))
        edges = sorted({0, len(times), *changes, *range(0, len(times), _BLOCK)})
        for begin, end in zip(edges, [*edges[1:], len(times)], strict=True):
            if begin < len(times):
                yield begin, end, changes.get(begin, [])


class DerivedBlock(Source):
    """The part of a file with derived channels."""

    derived: dict[ChannelName, DerivedSource] = Field(default_factory=dict, max_length=64)
    """The channels by name."""


def sources_in(document: Document) -> Mapping[str, DerivedSource]:
    """Return what stands in a file below `derived`, whatever else the file has.

    Raises:
        ConfigError: a key or a value is wrong; names every problem with its place.
    """
    problems, data = Problems(), {"derived": document.get(("derived",)) or {}}
    block = bind(document, DerivedBlock, problems, data=data)
    problems.raise_any()
    return {} if block is None else block.derived


def recorded_sources(recording: Recording) -> dict[str, DerivedSource]:
    """Return how derived channels of a recording were computed, by name, as far as it states it.

    Those of a rig file, procedure or map of another version of rigd are unknown.
    """
    found: dict[str, DerivedSource] = {}
    for name in ("rig.yaml", "procedure.yaml", "import_map.yaml"):
        if (file := recording.attachments.get(name)) is not None:
            with suppress(ConfigError):
                found |= sources_in(parse_document(file.data.decode(errors="replace"), Path(name)))
    if recording.added is not None:
        found |= {**recorded_sources(recording.added.recording), **recording.added.sources}
    return found


def written(
    derived: Mapping[str, str | Mapping[str, str]],
) -> tuple[Document, Mapping[str, DerivedSource]]:
    """Return a document with what stands below `derived`, and its channels.

    A text alone is the formula.

    Raises:
        ConfigError: a key or a value is wrong.
    """
    lines = ["derived:"]
    for name, item in derived.items():
        lines.append(f"  {json.dumps(name)}:")
        keys = {"is": item} if isinstance(item, str) else item
        lines += [f"    {key}: {json.dumps(text)}" for key, text in keys.items()]
    document = parse_document("\n".join(lines), Path("derived"))
    return document, sources_in(document)


def derived_streams(
    recording: Recording,
    document: Document,
    sources: Mapping[str, DerivedSource],
    defaults: Values | None = None,
) -> DerivedStreams | None:
    """Return the derived channels ``sources``, which stand in ``document`` below `derived`.

    Those that the recording has already, computed in the same way, are left out; None if all are.
    ``${name}`` is a parameter of the trials, ``${rig.name}`` a constant of the recorded rig; a name
    that the recording lacks has its value of ``defaults``.

    Raises:
        ConfigError: one is wrong, or exists already; names every problem with its place.
    """
    problems = Problems()
    sources = _new(recording, document, sources, problems)
    problems.raise_any()
    if not sources:
        return None
    streams = recording.streams
    constants = _constants(recording)
    channels = {f"{s.name}.{item.name}": item for s in streams.values() for item in s.channels}
    measured = frozenset(channels)
    if _has_cycle(recording):
        measured = frozenset(name for name in channels if not name.endswith(ECHO))
    period_s = 1e-9 * min(
        (_shortest_step(recording, base) for base in _bases(recording, sources)), default=1
    )
    names = FormulaNames(channels, measured, constants, period_s)
    shared, by_trial = _values(recording, constants, defaults or {})

    def named(name: str, offset: int) -> Number:
        value = shared.get(name)
        if value is None:
            known = [*shared, *by_trial.kinds]
            raise ExpressionError(f"unknown name '${{{name}}}'", offset, suggest(name, known))
        if isinstance(value, str):
            raise ExpressionError(f"{name} is a word, expected a quantity", offset)
        return value

    read = read_graph(document, sources, names, problems, named, by_trial)
    problems.raise_any()
    if read is None:
        raise ConfigError("the derived channels cannot be computed", place=document.place(()))
    found = {
        group: Stream(
            group, tuple(read.channels[name] for name in members), "computed from others",
            has_status=True, source=DERIVED,
        )
        for group, members in read.graph.groups().items()
    }  # fmt: skip
    return DerivedStreams(recording, read.graph, found, sources)


def _new(
    recording: Recording,
    document: Document,
    sources: Mapping[str, DerivedSource],
    problems: Problems,
) -> dict[str, DerivedSource]:
    """Return those of ``sources`` that the recording lacks; one that is another there is noted."""
    streams, recorded = recording.streams, recorded_sources(recording)
    missing: dict[str, DerivedSource] = {}
    for name, source in sources.items():
        group, _, channel = name.partition(".")
        stream = streams.get(group)
        if stream is None:
            missing[name] = source
            continue
        known = recorded.get(name)
        is_there = channel in {item.name for item in stream.channels}
        if is_there and known is not None and _meaning(known) == _meaning(source):
            continue
        message = f"{recording.path} has the stream {group} already"
        if is_there:
            by = "" if known is None else f", as {{{_text(known)}}}"
            message = f"{recording.path} has {name} already{by}"
        hint = f"choose another name before the dot, such as '{group}_derived'"
        problems.add(document.key_place(("derived", name)), message, hint)
    return missing


def _meaning(source: DerivedSource) -> dict[str, object]:
    return source.model_dump(by_alias=True, exclude_defaults=True, exclude={"doc"})


def _text(source: DerivedSource) -> str:
    return ", ".join(f"{key}: {value}" for key, value in _meaning(source).items())


def _of(channel: str) -> str:
    return channel.partition(".")[0]


def _has_cycle(recording: Recording) -> bool:
    stream = recording.streams.get(_CYCLE)
    return stream is not None and any(item.name == _SCHEDULED for item in stream.channels)


def _base(recording: Recording, streams: Collection[str]) -> str:
    """Return the stream with the times of a group that is computed from ``streams``."""
    if _has_cycle(recording):
        return _CYCLE
    return min(sorted(streams), key=lambda name: _rate(recording, name))


def _rate(recording: Recording, stream: str) -> float:
    """Return the usual rate of a stream in Hz; infinite with less than two rows."""
    span = recording.span_ns(stream)
    if span is None or span[0] == span[1]:
        return np.inf
    return (recording.count(stream) - 1) * 1e9 / (span[1] - span[0])


def _bases(recording: Recording, sources: Mapping[str, DerivedSource]) -> set[str]:
    """Return the streams with the times of all groups, as far as the names in formulas show."""
    own = {_of(name) for name in sources}
    direct: dict[str, set[str]] = {group: set() for group in own}
    for name, source in sources.items():
        for text in (source.formula, source.where):
            try:
                found = parts(parse(text)) if text else iter(())
                direct[_of(name)] |= {_of(node.name) for node in found if isinstance(node, Name)}
            except ExpressionError:
                pass  # it is named when the formula is read
    for _ in own:  # channels of one another
        for used in direct.values():
            used |= {name for other in used & own for name in direct[other]}
    bases = set()
    for used in direct.values():
        known = used & recording.streams.keys() or set(recording.streams)
        if known:
            bases.add(_base(recording, known))
    return bases


def _times(recording: Recording, stream: str) -> Times:
    """Return the times (n,) of all rows of a stream, in ns."""
    found = [rows[TIME_FIELD].astype(np.int64) for rows in recording.batches(stream)]
    return np.concatenate([np.empty(0, np.int64), *found])


def _shortest_step(recording: Recording, stream: str) -> int:
    """Return the shortest time between two rows of a stream in ns; 1 s with less than two."""
    steps = np.diff(_times(recording, stream))
    return int(np.min(steps[steps > 0], initial=1_000_000_000))


def _period(times: Times) -> float:
    return float(times[-1] - times[0]) / (len(times) - 1) if len(times) > 1 else np.inf


def _late_ns(period_ns: float, cycle_ns: float) -> int:
    if not np.isfinite(period_ns):
        return 2**62
    if abs(period_ns / cycle_ns - 1.0) < _SAME_PERIOD:
        return 0
    return round(_LATE_PERIODS * period_ns)


def _brought(own: _Readings, name: str, times: Times, *, is_base: bool) -> _Input:
    """Return a channel at the rows of the slowest stream; where it has a gap it is NaN and late.

    ``is_base``: it is of that stream, and each of its rows stands for itself.
    """
    values, own_times = own.values[name.partition(".")[2]], own.times
    if is_base and len(own_times) == len(times):  # no row repeats a reading
        return _Input(values, times, 0)
    if not is_base:  # the mean of samples of which one is NaN is none
        own_times, values = own_times[np.isfinite(values)], values[np.isfinite(values)]
    if not len(values):
        return _Input(np.full(len(times), np.nan), times - 1, 0)
    if is_base:
        at = np.searchsorted(own_times, times).clip(0, len(own_times) - 1)
        there, found = own_times[at] == times, values[at]
    else:
        item = brought(times, own_times, values)
        there, found = item.there, item.values
    return _Input(np.where(there, found, np.nan), times - ~there, 0)


def _constants(recording: Recording) -> Mapping[str, Constant]:
    """Return the constants of the recorded rig; of another version of rigd they are unknown."""
    rig = recording.attachments.get("rig.yaml")
    if rig is None:
        return {}
    try:
        return parse_constants(rig.data.decode(errors="replace"), Path("rig.yaml"))
    except ConfigError:
        return {}


def _values(
    recording: Recording, constants: Mapping[str, Constant], defaults: Values
) -> tuple[dict[str, Number | str], ByTrial]:
    """Return what ``${name}`` stands for: what has one value in the recording, and the others."""
    shared: dict[str, Number | str] = {
        f"rig.{name}": number_in(item.value, item.unit) for name, item in constants.items()
    }
    for name, text in recording.parameters.items():
        try:
            quantity = parse_quantity(text)
            shared[name] = number_in(quantity.value, quantity.unit)
        except ValueError:
            shared[name] = text
    kinds: dict[str, Number] = {}
    values: dict[int, dict[str, float]] = {}
    for trial in recording.trials:
        for name, value in trial.parameters.items():
            if isinstance(value, bool) or not isinstance(value, int | float):
                shared.setdefault(name, str(value))
                continue
            number = number_in(float(value), parse_unit(trial.units.get(name, "1")))
            if name in recording.parameters:  # with all its digits
                shared[name] = number
                continue
            kinds.setdefault(name, number)
            values.setdefault(trial.number, {})[name] = number.value
    complete = {
        number: {name: own.get(name, np.nan) for name in kinds} for number, own in values.items()
    }
    missing = {name: value for name, value in defaults.items() if name not in kinds}
    return {**missing, **shared}, ByTrial(kinds, complete)
