"""Joins all streams of a recording into one table with a common time base."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from rigd.model import RecordingError
from rigd.model.channels import STATUS_FIELD
from rigd.model.rows import TIME_FIELD
from rigd.record.tables import STEP, Column, Table, step_names, within_trials

if TYPE_CHECKING:
    from rigd.record.reader import Recording

JOINED_TABLE: Final = "joined"
#: A value is held for so many periods of its stream, so that a gap stays one.
HELD_PERIODS: Final = 2
#: 2 GB with 50 columns: more is a mistake in the rate.
_MAX_ROWS: Final = 5_000_000


def joined_table(recording: Recording, streams: Sequence[str], rate_hz: float) -> Table:
    """Return the channels of ``streams`` at regular times, ``rate_hz`` a second.

    Each value is the last sample at or before its time: no value is interpolated. It is NaN before
    the first sample of its stream and if the last sample is older than two periods of the stream. A
    stream that is faster than ``rate_hz`` loses samples, unfiltered.

    Raises:
        RecordingError: no such stream, a damaged chunk, an invalid rate, or too many rows.
    """
    if not 0 < rate_hz < np.inf:
        raise RecordingError(f"a rate of {rate_hz:g} Hz is none", hint="Give --joined 100, in Hz.")
    spans = [span for name in streams if (span := recording.span_ns(name)) is not None]
    start_ns = min((first for first, _ in spans), default=recording.start_ns)
    end_ns = max((last for _, last in spans), default=start_ns)
    count = int((end_ns - start_ns) * 1e-9 * rate_hz) + 1 if spans else 0
    if count > _MAX_ROWS:
        raise RecordingError(
            f"{rate_hz:g} Hz over {(end_ns - start_ns) * 1e-9:.0f} s are {count} rows",
            hint=f"A joined table has {_MAX_ROWS} at most: choose a lower rate.",
        )
    times = start_ns + np.rint(np.arange(count) * (1e9 / rate_hz)).astype(np.int64)
    attempts = [trial.info for trial in recording.trials]
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
        rows, stream = recording.read(name), recording.streams[name]
        at, held = _last_before(np.ascontiguousarray(rows[TIME_FIELD]), times)
        for channel in stream.channels:
            column = f"{name}.{channel.name}"
            columns[column] = _held(rows[channel.name], at, held)
            units[column], docs[column] = channel.unit, channel.doc
        if stream.has_status:
            columns[f"{name}.{STATUS_FIELD}"] = _held(rows[STATUS_FIELD], at, held)
    return Table(JOINED_TABLE, columns, units, docs)


def _last_before(
    samples: NDArray[np.int64], times: NDArray[np.int64]
) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Return the position of the last sample at or before each time, and whether it is fresh."""
    if not len(samples):
        return np.zeros(len(times), np.intp), np.zeros(len(times), np.bool_)
    order = np.argsort(samples, kind="stable")
    at = np.searchsorted(samples[order], times, side="right") - 1
    there = at >= 0
    at = order[np.maximum(at, 0)]
    if len(samples) > 1:
        period_ns = float(np.median(np.diff(samples[order])))
        there &= times - samples[at] <= HELD_PERIODS * period_ns
    else:
        there &= times == samples[at]
    return at, there


def _held(values: Column, at: NDArray[np.intp], held: NDArray[np.bool_]) -> Column:
    """Return the values as float64, NaN if none is held; a status word fits exactly."""
    if not len(values):
        return np.full(len(at), np.nan)
    return np.where(held, values[at].astype(np.float64), np.nan)
