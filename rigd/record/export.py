"""Recordings as tables for other programs: Parquet, CSV or MATLAB, one file per stream.

Not part of the package's public list: pyarrow and scipy take 0.4 s to import, which neither the
recorder nor ``rigd info`` should pay.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pa_parquet
import scipy.io
from numpy.typing import NDArray

from rigd.model import RecordingError, Stream
from rigd.model.channels import STATUS_FIELD
from rigd.model.rows import TIME_FIELD
from rigd.record.events import NO_TRIAL, Event
from rigd.record.info import TrialInfo, trials
from rigd.record.reader import Recording
from rigd.record.schema import EVENTS_STREAM

Format = Literal["parquet", "csv", "mat"]
#: Longest name of a field that MATLAB 7 files can hold (``long_field_names`` of scipy).
MAX_MAT_NAME: Final = 63

Column = NDArray[Any] | Sequence[str]


@dataclass(frozen=True)
class Table:
    """One stream, or the events, as columns of equal length with a unit each ("" for none)."""

    name: str
    columns: Mapping[str, Column]
    units: Mapping[str, str]
    docs: Mapping[str, str]


def export(
    recording: Recording,
    folder: Path,
    format: Format,
    *,
    streams: Iterable[str] | None = None,
    overwrite: bool = False,
) -> list[Path]:
    """Write each stream, and the events, to ``folder`` as a table of its own; return the files.

    Every table has ``t_ns`` (ns since the Unix epoch), ``time`` (s since the recording began)
    and ``trial`` (-1 outside of trials). A NaN stays one. ``streams`` None: all, with events.

    Raises:
        RecordingError: no such stream, a file exists (unless ``overwrite``), or it cannot be
            written. Files written before the error stay.

    """
    events = recording.events()
    attempts = trials(events)
    names = [*recording.streams, EVENTS_STREAM] if streams is None else list(streams)
    write, targets = _WRITERS[format], {name: _target(folder, name, format) for name in names}
    existing = [str(path) for path in targets.values() if path.exists()]
    if existing and not overwrite:
        raise RecordingError(
            f"{', '.join(existing)} exists already", hint="Choose another folder, or overwrite."
        )
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, path in targets.items():
            if name == EVENTS_STREAM:
                table = events_table(events, recording.start_ns)
            else:
                table = stream_table(recording, name, attempts)
            # Beside and then renamed, so that no half table looks like a whole one.
            beside = path.with_name(path.name + ".part")
            write(table, recording, beside)
            beside.replace(path)
    except OSError as error:
        raise RecordingError(f"cannot export to {folder}: {error}") from error
    return list(targets.values())


def stream_table(recording: Recording, name: str, attempts: Sequence[TrialInfo]) -> Table:
    """Return the rows of a stream as columns.

    Raises:
        RecordingError: no such stream, or a damaged chunk.

    """
    rows = recording.read(name)
    stream = recording.streams[name]
    times = np.ascontiguousarray(rows[TIME_FIELD])
    columns: dict[str, Column] = {
        TIME_FIELD: times,
        **_unless_taken("time", (times - recording.start_ns) * 1e-9, stream),
        **_unless_taken("trial", trial_numbers(times, attempts), stream),
    }
    fields = [channel.name for channel in stream.channels]
    if stream.has_status:
        fields.append(STATUS_FIELD)
    columns.update({field: np.ascontiguousarray(rows[field]) for field in fields})
    units = {TIME_FIELD: "ns", "time": "s"}
    units.update({channel.name: channel.unit for channel in stream.channels})
    docs = {channel.name: channel.doc for channel in stream.channels}
    return Table(name, columns, units, docs)


def events_table(events: Sequence[Event], start_ns: int) -> Table:
    """Return the events as columns; what belongs to one is a text of JSON."""
    times = np.array([event.t_ns for event in events], np.int64)
    columns: dict[str, Column] = {
        TIME_FIELD: times,
        "time": (times - start_ns) * 1e-9,
        "trial": np.array([event.trial for event in events], np.int32),
        "kind": [event.kind for event in events],
        "data": [json.dumps(event.data, ensure_ascii=False) for event in events],
    }
    return Table(EVENTS_STREAM, columns, {TIME_FIELD: "ns", "time": "s"}, {})


def trial_numbers(times: NDArray[np.int64], attempts: Sequence[TrialInfo]) -> NDArray[np.int32]:
    """Return the number of the trial at each time, in ns; start inclusive, end exclusive."""
    numbers = np.full(len(times), NO_TRIAL, np.int32)
    for trial in attempts:
        inside = times >= trial.start_ns
        if trial.end_ns is not None:
            inside &= times < trial.end_ns
        numbers[inside] = trial.number
    return numbers


def _unless_taken(name: str, column: Column, stream: Stream) -> dict[str, Column]:
    """Return the added column under its name, or ``rigd_`` before it where a channel has that."""
    taken = any(channel.name == name for channel in stream.channels)
    return {f"rigd_{name}" if taken else name: column}


def _target(folder: Path, name: str, format: Format) -> Path:
    return folder / f"{name.replace('/', '.')}.{format}"


def _write_parquet(table: Table, recording: Recording, path: Path) -> None:
    pa_parquet.write_table(_arrow(table, recording, with_units=False), path)


def _write_csv(table: Table, recording: Recording, path: Path) -> None:
    pa_csv.write_csv(_arrow(table, recording, with_units=True), path)


def _arrow(table: Table, recording: Recording, *, with_units: bool) -> Any:
    """Return an Arrow table; units in the names for CSV, which has no other place for them."""
    arrays = [pa.array(column) for column in table.columns.values()]
    fields = []
    for name, array in zip(table.columns, arrays, strict=True):
        unit, doc = table.units.get(name, ""), table.docs.get(name, "")
        shown = f"{name} [{unit}]" if with_units and unit else name
        fields.append(pa.field(shown, array.type, metadata={"unit": unit, "doc": doc}))
    about = {f"rigd.{name}": json.dumps(values) for name, values in recording.metadata.items()}
    return pa.Table.from_arrays(arrays, schema=pa.schema(fields, metadata=about))


def _write_mat(table: Table, recording: Recording, path: Path) -> None:
    for name in table.columns:
        if len(name) > MAX_MAT_NAME:
            raise RecordingError(
                f"{table.name}.{name}: MATLAB takes names of {MAX_MAT_NAME} letters at most",
                hint="Export to parquet or csv instead.",
            )
    columns = {
        name: np.array(column, object) if isinstance(column, list) else column
        for name, column in table.columns.items()
    }
    content = {**columns, "units": dict(table.units), "recording": recording.path.name}
    # The name ends in .part, to which scipy would add .mat.
    scipy.io.savemat(str(path), content, appendmat=False, long_field_names=True, oned_as="column")


_WRITERS: Final[Mapping[Format, Callable[[Table, Recording, Path], None]]] = {
    "parquet": _write_parquet,
    "csv": _write_csv,
    "mat": _write_mat,
}
