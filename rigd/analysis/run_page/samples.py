"""Reads and thins the samples of a run; at any time, memory holds one piece of one stream."""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rigd.analysis.report.trace import COLUMNS, thin
from rigd.analysis.run_page.bounds import recorded_in_parts
from rigd.analysis.run_page.paths import LARGEST, BodyPath, path_of
from rigd.model.channels import STATUS_FIELD, Channel, Stream
from rigd.model.poses import Pose, poses_of
from rigd.model.rows import TIME_FIELD
from rigd.model.units import parse_unit
from rigd.record import Recording, Step
from rigd.record.read.resample import stale_rows

FloatArray = NDArray[np.float64]

#: Rows of a stream that are in memory at once: 100 MB of 12 channels.
PIECE_ROWS: Final = 1_000_000
#: Points of all paths of a body in a plane, and of one at least.
PATH_POINTS: Final = 6_000
LEAST_PATH_POINTS: Final = 40
#: So many usual intervals without a row are a time in which the stream was not recorded.
HOLE_PERIODS: Final = 10
#: A stream of the engine about its own cycle, no device: its content is given in words.
CYCLE: Final = "cycle"


@dataclass(frozen=True)
class Attempt:
    """One attempt at a trial, or the whole recording if no trial began; ns since 1970."""

    index: int
    start_ns: int
    end_ns: int

    @property
    def seconds(self) -> float:
        """How long it took."""
        return (self.end_ns - self.start_ns) * 1e-9


@dataclass(frozen=True, eq=False)
class Trace:
    """A channel in one attempt: (n,) s since it began, (n,) values in its display unit."""

    t_s: FloatArray
    values: FloatArray


@dataclass(eq=False)
class Band:
    """The least and greatest value of a channel in each time column, over several attempts."""

    low: FloatArray
    high: FloatArray

    @classmethod
    def empty(cls) -> Band:
        """Return a band that nothing has entered."""
        return cls(np.full(COLUMNS, math.nan), np.full(COLUMNS, math.nan))

    def enter(self, columns: NDArray[np.intp], values: FloatArray) -> None:
        """Take in ``values`` (n,) that stand in ``columns`` (n,), ascending."""
        first = np.flatnonzero(np.diff(columns, prepend=-1))
        at = columns[first]
        self.low[at] = np.fmin(self.low[at], np.fmin.reduceat(values, first))
        self.high[at] = np.fmax(self.high[at], np.fmax.reduceat(values, first))


@dataclass(frozen=True)
class SharedTime:
    """The time that all attempts have in common; it begins at the event ``since`` in each of them.

    ``origins_s`` is when, in s after the attempt began; ``seconds`` is how long it lasts at most.
    """

    since: str
    origins_s: Mapping[int, float]
    seconds: float

    @property
    def column_s(self) -> float:
        """The width of a band's column in s."""
        return self.seconds / COLUMNS


@dataclass
class Samples:
    """The samples read: traces of the attempts to draw, bands by group, extremes, stale rows.

    Channels are named ``device.channel``, their values are in their display units. Traces count
    from the beginning of their attempt, bands from that of the shared time. The paths in a plane
    are by body, then by attempt.
    """

    time: SharedTime
    traces: dict[int, dict[str, Trace]] = field(default_factory=dict)
    bands: dict[int, dict[str, Band]] = field(default_factory=dict)
    extremes: dict[str, tuple[float, float]] = field(default_factory=dict)
    stale: dict[int, int] = field(default_factory=dict)
    paths: dict[str, dict[int, BodyPath]] = field(default_factory=dict)


def shared_time(
    attempts: Sequence[Attempt], played: Sequence[Step], during: Collection[str]
) -> SharedTime:
    """Return the shared time of ``attempts``.

    If a stream was recorded during named steps only (``during``), what matters happens in them:
    the time is that from the first of them to the end of the last. Before them a person may have
    taken any time.
    """
    longest = max((attempt.seconds for attempt in attempts), default=0.0) or 1.0
    origins: dict[int, float] = {}
    seconds, name = 0.0, ""
    for attempt in attempts:
        inside = [
            step
            for step in played
            if step.name in during and attempt.start_ns <= step.start_ns < attempt.end_ns
        ]
        if not inside:
            continue
        name = name or inside[0].name
        origins[attempt.index] = (inside[0].start_ns - attempt.start_ns) * 1e-9
        last_ns = min(inside[-1].end_ns or attempt.end_ns, attempt.end_ns)
        seconds = max(seconds, (last_ns - inside[0].start_ns) * 1e-9)
    if seconds <= 0.0:
        return SharedTime("the trial began", {attempt.index: 0.0 for attempt in attempts}, longest)
    return SharedTime(f"{name!r} began", origins, seconds)


def gather(
    recording: Recording,
    attempts: Sequence[Attempt],
    time: SharedTime,
    groups: Mapping[int, int],
    draw: Mapping[int, int],
) -> Samples:
    """Return the samples of ``attempts``.

    Args:
        recording: their places.
        attempts: in the order they began.
        time: what the bands count from.
        groups: attempt to the group whose band it enters; attempts that are not in it enter none.
        draw: attempt to the number of columns that its traces have.

    Raises:
        RecordingError: a chunk cannot be read.
    """
    samples = Samples(time)
    lost: dict[str, list[int]] = {}
    for gap in recording.gaps:
        lost.setdefault(gap.stream, []).append(gap.start_ns)
    parts = recorded_in_parts(recording)
    points = max(LEAST_PATH_POINTS, PATH_POINTS // max(len(attempts), 1))
    streams = [(stream, poses_of([stream])) for stream in shown_streams(recording)]
    for attempt in attempts:
        for stream, poses in streams:
            before = recording.read(stream.name, 0, 0)  # the last row of the piece before
            for rows, share in _pieces(recording, stream.name, attempt):
                columns = share * draw.get(attempt.index, 0)
                times = np.append(before[TIME_FIELD], rows[TIME_FIELD]).astype(np.int64)
                found = holes(times) if stream.name in parts else []
                breaks = [*lost.get(stream.name, ()), *found]
                _take(samples, attempt, stream, rows, groups, columns, breaks)
                linked = np.concatenate([before, rows]) if poses else rows
                _walk(samples, attempt, poses, linked, math.ceil(share * points))
                before = rows[-1:].copy()
    return samples


def holes(times: NDArray[np.int64]) -> list[int]:
    """Return the middle of each time, in ns, in which no row of ``times`` (n,) was recorded."""
    waits = np.diff(times)
    if not waits.size:
        return []
    long = waits > HOLE_PERIODS * float(np.median(waits))
    found: list[int] = (times[:-1] + waits // 2)[long].tolist()
    return found


def shown_streams(recording: Recording) -> list[Stream]:
    """Return the streams of the devices, as they stand in the recording."""
    return [stream for stream in recording.streams.values() if stream.name != CYCLE]


def _pieces(
    recording: Recording, stream: str, attempt: Attempt
) -> Iterator[tuple[NDArray[np.void], float]]:
    """Yield the rows of a stream in an attempt, and which share of its time each piece is."""
    span = recording.span_ns(stream)
    if span is None or attempt.end_ns <= attempt.start_ns:
        return
    dense = recording.count(stream) / max(span[1] - span[0], 1)
    # Streams that are recorded during named steps only are denser there than on the whole.
    rows = min(2.0 * dense * (attempt.end_ns - attempt.start_ns), recording.count(stream))
    pieces = max(1, math.ceil(rows / PIECE_ROWS))
    edges = np.linspace(attempt.start_ns, attempt.end_ns, pieces + 1).astype(np.int64)
    for first, last in itertools.pairwise(edges.tolist()):
        found = recording.read(stream, first, last)
        if len(found):
            yield found, 1.0 / pieces


def _take(
    samples: Samples,
    attempt: Attempt,
    stream: Stream,
    rows: NDArray[np.void],
    groups: Mapping[int, int],
    columns: float,
    breaks_ns: Sequence[int],
) -> None:
    if stream.has_status:
        late = int(np.count_nonzero(stale_rows(rows[STATUS_FIELD])))
        samples.stale[attempt.index] = samples.stale.get(attempt.index, 0) + late
    since_ns = rows[TIME_FIELD].astype(np.int64) - attempt.start_ns
    t_s: FloatArray = since_ns.astype(np.float64) * 1e-9
    origin_s = samples.time.origins_s.get(attempt.index)
    grouped = attempt.index in groups and origin_s is not None
    place = np.floor((t_s - (origin_s or 0.0)) / samples.time.column_s).astype(np.intp)
    # Times ascend within a stream, also over a device that sends a block late.
    inside = slice(*np.searchsorted(place, (0, COLUMNS)))
    for channel in stream.channels:
        if channel.raw_of is not None:
            continue
        name, values = f"{stream.name}.{channel.name}", _shown(channel, rows[channel.name])
        _widen(samples.extremes, name, values)
        if grouped and place[inside].size:
            band = samples.bands.setdefault(groups[attempt.index], {})
            band.setdefault(name, Band.empty()).enter(place[inside], values[inside])
        if columns:
            trace = Trace(*thin(t_s, values, max(1, math.ceil(columns))))
            traces = samples.traces.setdefault(attempt.index, {})
            gaps_s = [(ns - attempt.start_ns) * 1e-9 for ns in breaks_ns]
            traces[name] = _joined(traces.get(name), trace, gaps_s)


def _shown(channel: Channel, values: FloatArray) -> FloatArray:
    """Return ``values`` (n,), in SI, in the unit in which people read the channel.

    Those beyond :data:`LARGEST` are NaN.
    """
    unit = parse_unit(channel.shown_in)
    values = np.where(np.abs(values) < LARGEST, values, math.nan)
    return values if unit.is_si else np.asarray((values - unit.offset) / unit.factor)


def _walk(
    samples: Samples, attempt: Attempt, poses: Sequence[Pose], rows: NDArray[np.void], points: int
) -> None:
    for pose in poses:
        path = path_of(pose, rows, points)
        if path is not None:
            paths = samples.paths.setdefault(pose.body, {})
            before = paths.get(attempt.index)
            paths[attempt.index] = path if before is None else before.then(path)


def _widen(extremes: dict[str, tuple[float, float]], name: str, values: FloatArray) -> None:
    finite = values[np.isfinite(values)]
    if finite.size:
        low, high = extremes.get(name, (math.inf, -math.inf))
        extremes[name] = (min(low, float(finite.min())), max(high, float(finite.max())))


def _joined(before: Trace | None, trace: Trace, gaps_s: Sequence[float]) -> Trace:
    """Return both traces as one: no line is drawn over what is lost or was not recorded."""
    first_s = trace.t_s[0] if before is None else before.t_s[-1]
    inside = [at for at in gaps_s if first_s <= at <= trace.t_s[-1]]
    places = np.searchsorted(trace.t_s, inside, side="right")
    trace = Trace(np.insert(trace.t_s, places, inside), np.insert(trace.values, places, math.nan))
    if before is None:
        return trace
    return Trace(
        np.concatenate([before.t_s, trace.t_s]), np.concatenate([before.values, trace.values])
    )
