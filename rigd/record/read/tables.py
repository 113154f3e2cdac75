"""Builds tables with units from a recording: of a stream, of the events or of the trials.

The same columns are in a notebook and in every exported file. All values are in SI units.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from rigd.model import RecordingError, Stream
from rigd.model.channels import STATUS_FIELD
from rigd.model.rows import TIME_FIELD
from rigd.model.units import parse_unit, si_symbol
from rigd.record.events.event import NO_TRIAL, Event
from rigd.record.events.trials import Step, TrialInfo
from rigd.record.mcap.schema import EVENTS_STREAM

if TYPE_CHECKING:
    import pandas as pd

    from rigd.record.read.reader import Recording

TRIALS_TABLE: Final = "trials"
STEPS_TABLE: Final = "steps"
STEP: Final = "step"  #: column of the step's name
Column = NDArray[Any]


@dataclass(frozen=True, repr=False)
class Table:
    """Columns of equal length by name, with a unit and a description each ("" for none)."""

    name: str
    columns: Mapping[str, Column]
    units: Mapping[str, str]
    docs: Mapping[str, str]

    def __len__(self) -> int:
        return len(next(iter(self.columns.values())))

    def __getitem__(self, column: str) -> Column:
        """Return a column (n,); a KeyError names those there are."""
        if column not in self.columns:
            raise KeyError(f"{self.name} has no column {column!r}; it has {list(self.columns)}")
        return self.columns[column]

    def __repr__(self) -> str:
        columns = (
            f"{name} [{self.units[name]}]" if self.units.get(name) else name
            for name in self.columns
        )
        return f"<{self.name}: {len(self)} rows of {', '.join(columns)}>"

    def to_numpy(self) -> NDArray[np.void]:
        """Return a structured array (n,) with a field per column; texts are of dtype ``U``."""
        arrays = {
            name: column.astype(np.str_) if column.dtype == object else column
            for name, column in self.columns.items()
        }
        rows = np.empty(len(self), [(name, column.dtype) for name, column in arrays.items()])
        for name, column in arrays.items():
            rows[name] = column
        return rows

    def to_pandas(self) -> pd.DataFrame:
        """Return a DataFrame; ``attrs["units"]`` has the units by column.

        Raises:
            RecordingError: pandas, which rigd does not need otherwise, is not installed.

        """
        try:
            import pandas as pd
        except ImportError as error:
            raise RecordingError(
                "pandas is not installed", hint="`pip install pandas`, or use to_numpy()."
            ) from error
        frame = pd.DataFrame(dict(self.columns))
        frame.attrs["units"] = dict(self.units)
        return frame

    def to_arrow(self) -> Any:
        """Return a ``pyarrow.Table``; the metadata of a field are its ``unit`` and its ``doc``.

        Raises:
            RecordingError: pyarrow is not installed.

        """
        try:
            import pyarrow as pa
        except ImportError as error:
            raise RecordingError(
                "pyarrow is not installed",
                hint="`pip install 'rigd[export]'`, or use to_numpy().",
            ) from error
        arrays = [pa.array(column) for column in self.columns.values()]
        fields = [
            pa.field(
                name,
                array.type,
                metadata={"unit": self.units.get(name, ""), "doc": self.docs.get(name, "")},
            )
            for name, array in zip(self.columns, arrays, strict=True)
        ]
        return pa.Table.from_arrays(arrays, schema=pa.schema(fields))


def stream_table(
    recording: Recording,
    name: str,
    attempts: Sequence[TrialInfo],
    steps: Sequence[Step],
    start_ns: int | None = None,
    end_ns: int | None = None,
) -> Table:
    """Return the rows of a stream with ``start_ns <= t_ns < end_ns`` as a table.

    Before the channels come ``t_ns`` (ns since the Unix epoch), ``time`` (s since the recording
    began), ``trial`` (-1 outside of trials), ``trial_time`` (s since the trial began, NaN outside)
    and ``step`` ("" outside of steps), each with ``rigd_`` before it if a channel has that name.

    Raises:
        RecordingError: no such stream, or a damaged chunk.
    """
    rows = recording.read(name, start_ns, end_ns)
    return rows_table(recording.streams[name], rows, recording.start_ns, attempts, steps)


def rows_table(
    stream: Stream,
    rows: NDArray[np.void],
    begin_ns: int,
    attempts: Sequence[TrialInfo],
    steps: Sequence[Step],
) -> Table:
    """Return rows of a stream as :func:`stream_table` does; the recording began at ``begin_ns``."""
    times = np.ascontiguousarray(rows[TIME_FIELD])
    numbers, trial_time = within_trials(times, attempts)
    added: dict[str, Column] = {
        "time": (times - begin_ns) * 1e-9,
        "trial": numbers,
        "trial_time": trial_time,
        STEP: step_names(times, steps),
    }
    columns: dict[str, Column] = {TIME_FIELD: times}
    units = {TIME_FIELD: "ns"}
    for column, values in added.items():
        free = _free_name(column, stream)
        columns[free] = values
        units[free] = "s" if column in ("time", "trial_time") else ""
    fields = [channel.name for channel in stream.channels]
    if stream.has_status:
        fields.append(STATUS_FIELD)
    columns.update({field: np.ascontiguousarray(rows[field]) for field in fields})
    units.update({channel.name: channel.unit for channel in stream.channels})
    docs = {channel.name: channel.doc for channel in stream.channels}
    return Table(stream.name, columns, units, docs)


def events_table(events: Sequence[Event], start_ns: int) -> Table:
    """Return the events as a table; the details of an event are a text of JSON."""
    times = np.array([event.t_ns for event in events], np.int64)
    columns: dict[str, Column] = {
        TIME_FIELD: times,
        "time": (times - start_ns) * 1e-9,
        "trial": np.array([event.trial for event in events], np.int32),
        "kind": np.array([event.kind for event in events], object),
        "data": np.array([json.dumps(e.data, ensure_ascii=False) for e in events], object),
    }
    return Table(EVENTS_STREAM, columns, {TIME_FIELD: "ns", "time": "s"}, {})


def trials_table(attempts: Sequence[TrialInfo], start_ns: int) -> Table:
    """Return the trials as a table, an attempt in each row.

    ``start``, ``end`` (s since the recording began) and ``duration`` are NaN if the recording
    ends within the trial. A column per parameter has its values in SI (numbers), or as texts.
    """
    start = np.array([attempt.start_ns for attempt in attempts], np.int64)
    ends = np.array(
        [np.nan if attempt.end_ns is None else attempt.end_ns - start_ns for attempt in attempts]
    )
    repeats = [np.nan if attempt.repeat is None else attempt.repeat for attempt in attempts]
    columns: dict[str, Column] = {
        "number": np.array([attempt.number for attempt in attempts], np.int32),
        "repeat": np.array(repeats, np.float64),
        "complete": np.array([attempt.complete for attempt in attempts], np.bool_),
        "reason": np.array([attempt.reason for attempt in attempts], object),
        "start_ns": start,
        "start": (start - start_ns) * 1e-9,
        "end": ends.astype(np.float64) * 1e-9,
    }
    columns["duration"] = columns["end"] - columns["start"]
    units = {"start_ns": "ns", "start": "s", "end": "s", "duration": "s"}
    for name in dict.fromkeys(name for attempt in attempts for name in attempt.parameters):
        column = f"parameter_{name}" if name in columns else name
        columns[column] = _values([attempt.parameters.get(name) for attempt in attempts])
        written = next((attempt.units[name] for attempt in attempts if name in attempt.units), None)
        if written is not None:
            units[column] = si_symbol(parse_unit(written).dimension)
    return Table(TRIALS_TABLE, columns, units, {})


def steps_table(steps: Sequence[Step], start_ns: int) -> Table:
    """Return the steps as they were played as a table.

    ``start``, ``end`` (s since the recording began) and ``duration``; the end is NaN if the
    recording ends within the step. ``trial`` is -1 outside of trials.
    """
    start = np.array([step.start_ns for step in steps], np.int64)
    ends = np.array([np.nan if step.end_ns is None else step.end_ns - start_ns for step in steps])
    columns: dict[str, Column] = {
        STEP: np.array([step.name for step in steps], object),
        "trial": np.array([step.trial for step in steps], np.int32),
        "start_ns": start,
        "start": (start - start_ns) * 1e-9,
        "end": ends.astype(np.float64) * 1e-9,
    }
    columns["duration"] = columns["end"] - columns["start"]
    units = {"start_ns": "ns", "start": "s", "end": "s", "duration": "s"}
    return Table(STEPS_TABLE, columns, units, {})


def with_measures(table: Table, measures: Mapping[str, tuple[str, Mapping[int, float]]]) -> Table:
    """Return the table of trials with a column ``measure_NAME`` for each of ``measures``.

    Each has its unit and its values by number of trial; the others, and attempts that are not
    complete, have NaN.
    """
    columns, units = dict(table.columns), dict(table.units)
    for name, (unit, values) in measures.items():
        columns[f"measure_{name}"] = np.array([
            values.get(int(number), np.nan) if complete else np.nan
            for number, complete in zip(table["number"], table["complete"], strict=True)
        ], np.float64)  # fmt: skip
        units[f"measure_{name}"] = unit
    return Table(table.name, columns, units, table.docs)


def concatenated(tables: Sequence[Table]) -> Table:
    """Return the rows of tables with the same columns as one table; at least one is given."""
    first = tables[0]
    columns = {
        name: np.concatenate([table.columns[name] for table in tables]) for name in first.columns
    }
    return Table(first.name, columns, first.units, first.docs)


def within_trials(
    times: NDArray[np.int64], attempts: Sequence[TrialInfo]
) -> tuple[NDArray[np.int32], NDArray[np.float64]]:
    """Return the number of the trial at each time in ns, and the time in s since it began.

    -1 and NaN outside of trials; the start of a trial is inclusive, its end exclusive.
    """
    numbers = np.full(len(times), NO_TRIAL, np.int32)
    since = np.full(len(times), np.nan)
    low, high = _bounds(times)
    for trial in attempts:
        if trial.start_ns > high or (trial.end_ns is not None and trial.end_ns <= low):
            continue
        inside = times >= trial.start_ns
        if trial.end_ns is not None:
            inside &= times < trial.end_ns
        numbers[inside] = trial.number
        since[inside] = (times[inside] - trial.start_ns) * 1e-9
    return numbers, since


def step_names(times: NDArray[np.int64], steps: Sequence[Step]) -> NDArray[np.object_]:
    """Return the name of the step at each time in ns; "" outside of steps."""
    names = np.full(len(times), "", object)
    low, high = _bounds(times)
    for step in steps:
        if step.start_ns > high or (step.end_ns is not None and step.end_ns <= low):
            continue
        inside = times >= step.start_ns
        if step.end_ns is not None:
            inside &= times < step.end_ns
        names[inside] = step.name
    return names


def _bounds(times: NDArray[np.int64]) -> tuple[int, int]:
    return (int(times.min()), int(times.max())) if len(times) else (0, -1)


def _free_name(column: str, stream: Stream) -> str:
    taken = any(channel.name == column for channel in stream.channels)
    return f"rigd_{column}" if taken else column


def _values(given: Sequence[object]) -> Column:
    """Return a parameter's values: numbers as float64 (NaN for none), else as texts."""
    numbers = all(
        item is None or (isinstance(item, int | float) and not isinstance(item, bool))
        for item in given
    )
    if numbers:
        return np.array([np.nan if item is None else item for item in given], np.float64)
    return np.array(["" if item is None else str(item) for item in given], object)
