"""Joins all streams of a recording into one table with a common time base.

Nothing is made up: no value before the first sample of a stream, after its last, or in a gap.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import TYPE_CHECKING, Final, Literal

import numpy as np
from numpy.typing import NDArray

from rigd.model import RecordingError
from rigd.model.channels import STATUS_FIELD, Stream
from rigd.model.rows import TIME_FIELD
from rigd.record.read.reader import BATCH_ROWS
from rigd.record.read.tables import STEP, Column, Table, concatenated, step_names, within_trials

if TYPE_CHECKING:
    from rigd.record.events.trials import TrialInfo
    from rigd.record.read.reader import Recording

JOINED_TABLE: Final = "joined"
#: A value is held, or drawn to the next, for so many periods of its stream: a gap stays one.
HELD_PERIODS: Final = 2
#: 40 GB with 50 columns: more is a mistake in the rate.
_MAX_ROWS: Final = 100_000_000
#: Samples are read for so much time at once, which bounds the memory.
_SPAN_NS: Final = 60_000_000_000

Between = Literal["last", "linear"]
Times = NDArray[np.int64]


@dataclass(frozen=True)
class TimeBase:
    """The times of a joined table: regular, or those of a stream's samples.

    ``between`` is the value at a time between two samples: that of the ``last``, or on the straight
    line between both (``linear``).
    """

    rate_hz: float | None = None
    stream: str | None = None
    between: Between = "last"

    def __str__(self) -> str:
        """Return it in words, for whoever reads the table."""
        where = f"the samples of {self.stream}" if self.stream else f"{self.rate_hz:g} Hz"
        how = {
            "last": "each value is the last sample at or before its time",
            "linear": "each value is on the straight line between the samples before and after it, "
            "a status word is that of the sample before",
        }[self.between]
        return (
            f"the times of {where}; {how}; NaN outside of the samples of its stream and where "
            f"they are more than {HELD_PERIODS} periods apart; not filtered"
        )


def joined_table(recording: Recording, streams: Sequence[str], rate_hz: float) -> Table:
    """Return the channels of ``streams`` at regular times, each value the last sample.

    Raises:
        RecordingError: as :func:`joined_batches`.
    """
    base = TimeBase(rate_hz)
    return concatenated(
        [joined_head(recording, streams), *joined_batches(recording, streams, base)]
    )


def joined_head(recording: Recording, streams: Sequence[str]) -> Table:
    """Return the joined table of ``streams`` without rows."""
    return _table(recording, streams, np.empty(0, np.int64), {}, ())


def joined_batches(recording: Recording, streams: Sequence[str], base: TimeBase) -> Iterator[Table]:
    """Return the channels of ``streams`` at the times of ``base``, some rows at a time.

    A value is NaN before the first sample of its stream, after its last, in a gap that is known,
    and where samples are more than two periods of the stream apart. A stream that has more samples
    than the table has rows loses some, unfiltered.

    Raises:
        RecordingError: no such stream, a damaged chunk, an invalid rate, or too many rows.
    """
    times = _regular(recording, streams, base.rate_hz) if base.stream is None else None
    if times is None:
        times = (
            np.ascontiguousarray(rows[TIME_FIELD]) for rows in recording.batches(base.stream or "")
        )
    return _batches(recording, streams, base.between, times)


def _batches(
    recording: Recording, streams: Sequence[str], between: Between, times: Iterator[Times]
) -> Iterator[Table]:
    attempts = [trial.info for trial in recording.trials]
    periods = {name: _period_ns(recording, name) for name in streams}
    waiting: list[Table] = []
    for part in chain.from_iterable(map(_spans, times)):
        values = {name: _values(recording, name, part, periods[name], between) for name in streams}
        waiting.append(_table(recording, streams, part, values, attempts))
        if sum(map(len, waiting)) >= BATCH_ROWS:
            yield concatenated(waiting)
            waiting = []
    if waiting:
        yield concatenated(waiting)


def _regular(
    recording: Recording, streams: Sequence[str], rate_hz: float | None
) -> Iterator[Times]:
    """Return regular times from the first sample to the last, in parts."""
    rate_hz = rate_hz or 0.0
    if not 0 < rate_hz < np.inf:
        raise RecordingError(f"a rate of {rate_hz:g} Hz is none", hint="Give --rate 100, in Hz.")
    spans = [span for name in streams if (span := recording.span_ns(name)) is not None]
    start_ns = min((first for first, _ in spans), default=recording.start_ns)
    end_ns = max((last for _, last in spans), default=start_ns)
    count = int((end_ns - start_ns) * 1e-9 * rate_hz) + 1 if spans else 0
    if count > _MAX_ROWS:
        raise RecordingError(
            f"{rate_hz:g} Hz over {(end_ns - start_ns) * 1e-9:.0f} s are {count} rows",
            hint=f"A joined table has {_MAX_ROWS} at most: choose a lower rate.",
        )
    return (
        start_ns + np.rint(np.arange(at, min(at + BATCH_ROWS, count)) * (1e9 / rate_hz)).astype(int)
        for at in range(0, count, BATCH_ROWS)
    )


def _spans(times: Times) -> Iterator[Times]:
    """Cut times into parts that span a bounded time."""
    if len(times):
        parts = (times - times[0]) // _SPAN_NS
        yield from np.split(times, np.flatnonzero(np.diff(parts)) + 1)


def _period_ns(recording: Recording, stream: str) -> float:
    """Return the median period of the first samples of a stream; 0 if there are not two."""
    rows = next(recording.batches(stream), None)
    if rows is None or len(rows) < 2:
        return 0.0
    times = np.sort(rows[TIME_FIELD])
    return float(np.median(np.diff(times)))


def _values(
    recording: Recording, name: str, times: Times, period_ns: float, between: Between
) -> dict[str, Column]:
    """Return the values of a stream's fields at ``times``, as float64: status words fit exactly."""
    reach_ns = int(np.ceil(HELD_PERIODS * period_ns))
    rows = recording.read(name, int(times.min()) - reach_ns, int(times.max()) + reach_ns + 1)
    fields = _fields(recording.streams[name])
    if not len(rows):
        return {field: np.full(len(times), np.nan) for field in fields}
    rows = rows[np.argsort(rows[TIME_FIELD], kind="stable")]
    samples = np.ascontiguousarray(rows[TIME_FIELD])
    before = np.searchsorted(samples, times, side="right") - 1
    there = before >= 0
    before = np.maximum(before, 0)
    there &= times - samples[before] <= HELD_PERIODS * period_ns
    after, exact = np.minimum(before + 1, len(samples) - 1), samples[before] == times
    for gap in recording.gaps:
        if gap.stream == name:
            there &= (times <= gap.start_ns) | (times >= gap.end_ns)
    drawn = there & (after > before) & ~exact
    drawn &= samples[after] - samples[before] <= HELD_PERIODS * period_ns
    share = np.where(drawn, times - samples[before], 0) / np.where(
        drawn, samples[after] - samples[before], 1
    )
    found: dict[str, Column] = {}
    for field in fields:
        last = rows[field].astype(np.float64)
        if between == "last" or field == STATUS_FIELD:
            found[field] = np.where(there, last[before], np.nan)
            continue
        with np.errstate(invalid="ignore"):  # infinite values have no line between them
            line = last[before] + share * (last[after] - last[before])
        found[field] = np.where(exact & there, last[before], np.where(drawn, line, np.nan))
    return found


def _table(
    recording: Recording,
    streams: Sequence[str],
    times: Times,
    values: dict[str, dict[str, Column]],
    attempts: Sequence[TrialInfo],
) -> Table:
    numbers, trial_time = within_trials(times, attempts)
    columns: dict[str, Column] = {
        TIME_FIELD: times,
        "time": (times - recording.start_ns) * 1e-9,
        "trial": numbers,
        "trial_time": trial_time,
        STEP: step_names(times, recording.steps),
    }
    units = {TIME_FIELD: "ns", "time": "s", "trial_time": "s"}
    docs: dict[str, str] = {}
    for name in streams:
        stream = recording.streams[name]
        given = values.get(name, {})
        for field in _fields(stream):
            columns[f"{name}.{field}"] = given.get(field, np.empty(0))
        for channel in stream.channels:
            column = f"{name}.{channel.name}"
            units[column], docs[column] = channel.unit, channel.doc
    return Table(JOINED_TABLE, columns, units, docs)


def _fields(stream: Stream) -> list[str]:
    fields = [channel.name for channel in stream.channels]
    return [*fields, STATUS_FIELD] if stream.has_status else fields
