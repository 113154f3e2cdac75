"""Writes recordings as tables for other programs: Parquet, CSV or MATLAB, one file per stream.

The package :mod:`rigd.record` does not import this module, because pyarrow and scipy take 0.4 s to
import, and neither the recorder nor ``rigd info`` needs them.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, Literal

import numpy as np
import pyarrow.csv as pa_csv
import pyarrow.parquet as pa_parquet
import scipy.io

from rigd.model import RecordingError
from rigd.record.joined import JOINED_TABLE, joined_table
from rigd.record.reader import Recording
from rigd.record.schema import EVENTS_STREAM
from rigd.record.tables import STEP, TRIALS_TABLE, Table, events_table, with_measures

Format = Literal["parquet", "csv", "mat"]
#: Longest name of a field that MATLAB 7 files can hold (``long_field_names`` of scipy).
MAX_MAT_NAME: Final = 63
_MAT_HEADER_BYTES: Final = 128


def export(
    recording: Recording,
    folder: Path,
    format: Format,
    *,
    streams: Iterable[str] | None = None,
    joined_hz: float | None = None,
    overwrite: bool = False,
    measures: Mapping[str, tuple[str, Mapping[int, float]]] = MappingProxyType({}),
) -> list[Path]:
    """Write each stream, and the events, to ``folder`` as a table of its own; return the files.

    The columns are those of :mod:`rigd.record.tables`. A NaN stays NaN. ``streams`` None: all, with
    events. ``joined_hz``: the streams in one table instead, at that rate
    (:mod:`rigd.record.joined`). The table of the trials is always written; ``measures`` are
    further columns of it: see :func:`rigd.record.tables.with_measures`.

    Raises:
        RecordingError: no such stream, a file exists (unless ``overwrite``), or it cannot be
            written. Files written before the error stay.
    """
    chosen = [*recording.streams, EVENTS_STREAM] if streams is None else list(streams)
    for name in chosen:
        if name != EVENTS_STREAM:
            recording.count(name)  # raises if there is no such stream
    names = chosen
    if joined_hz is not None:
        names = [_free_name(JOINED_TABLE, recording), *({EVENTS_STREAM} & set(chosen))]
    names = [*names, _free_name(TRIALS_TABLE, recording)]
    write, targets = _WRITERS[format], {name: _target(folder, name, format) for name in names}
    # The table of the trials exists if another stream was exported before; it must be the same.
    existing = [str(path) for name, path in targets.items() if path.exists() and name in names[:-1]]
    if existing and not overwrite:
        raise _exists(*existing)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, path in targets.items():
            # Written under another name and then renamed: a half table never has the final name.
            beside = path.with_name(path.name + ".part")
            table = _table(recording, name, chosen, joined_hz)
            if name == names[-1]:
                table = with_measures(table, measures)
            write(table, recording, beside)
            if path.exists() and not overwrite and not _same(beside, path):
                beside.unlink()
                raise _exists(str(path))
            beside.replace(path)
    except OSError as error:
        raise RecordingError(f"cannot export to {folder}: {error}") from error
    return list(targets.values())


def _exists(*paths: str) -> RecordingError:
    more = f", as do {len(paths) - 1} more" if len(paths) > 1 else ""
    return RecordingError(
        f"{paths[0]} exists already{more}", hint="Choose another --output, or give --overwrite."
    )


def _same(new: Path, old: Path) -> bool:
    """Return whether two tables are the same, but for the date that begins a MATLAB file."""
    skipped = _MAT_HEADER_BYTES if old.suffix == ".mat" else 0
    return new.read_bytes()[skipped:] == old.read_bytes()[skipped:]


def _table(
    recording: Recording, name: str, chosen: Sequence[str], joined_hz: float | None
) -> Table:
    if name == EVENTS_STREAM:
        return events_table(recording.all_events, recording.start_ns)
    if name in recording.streams:
        return recording[name]
    if joined_hz is not None and name == _free_name(JOINED_TABLE, recording):
        streams = [item for item in chosen if item != EVENTS_STREAM]
        return joined_table(recording, streams, joined_hz)
    return recording.trials.table


def _free_name(name: str, recording: Recording) -> str:
    """Return the name of a table, with ``rigd_`` in front if a stream has that name."""
    return f"rigd_{name}" if name in recording.streams else name


def _target(folder: Path, name: str, format: Format) -> Path:
    return folder / f"{name.replace('/', '.')}.{format}"


def _write_parquet(table: Table, recording: Recording, path: Path) -> None:
    pa_parquet.write_table(_arrow(table, recording, with_units=False), path)


def _write_csv(table: Table, recording: Recording, path: Path) -> None:
    pa_csv.write_csv(_arrow(table, recording, with_units=True), path)


def _arrow(table: Table, recording: Recording, *, with_units: bool) -> Any:
    """Return an Arrow table; units in the names for CSV, which has no other place for them."""
    plain = table.to_arrow()
    if with_units:
        plain = plain.rename_columns([
            f"{name} [{table.units[name]}]" if table.units.get(name) else name
            for name in table.columns
        ])  # fmt: skip
    about = {f"rigd.{name}": json.dumps(values) for name, values in recording.metadata.items()}
    return plain.replace_schema_metadata(about)


def _write_mat(table: Table, recording: Recording, path: Path) -> None:
    names = {column: _mat_name(table, column) for column in table.columns}
    content: dict[str, Any] = {names[column]: values for column, values in table.columns.items()}
    if STEP in table.columns:
        # A text in each row would take a cell each: the rows have numbers into the list of texts.
        texts, numbers = np.unique(table.columns[STEP].astype(str), return_inverse=True)
        shift = 0 if "" in texts else 1
        content["step_names"] = np.array([text for text in texts if text], object)
        content[STEP] = (numbers + shift).astype(np.int32)
    content["units"] = {names[column]: unit for column, unit in table.units.items()}
    content["recording"] = recording.path.name
    # The name ends in .part, to which scipy would add .mat.
    scipy.io.savemat(str(path), content, appendmat=False, long_field_names=True, oned_as="column")


def _mat_name(table: Table, column: str) -> str:
    """Return the name of a column as MATLAB takes it.

    Raises:
        RecordingError: it is too long.

    """
    name = column.replace(".", "_").replace("/", "_")
    if len(name) > MAX_MAT_NAME:
        raise RecordingError(
            f"{table.name}.{name}: MATLAB takes names of {MAX_MAT_NAME} letters at most",
            hint="Export to parquet or csv instead.",
        )
    return name


_WRITERS: Final[Mapping[Format, Callable[[Table, Recording, Path], None]]] = {
    "parquet": _write_parquet,
    "csv": _write_csv,
    "mat": _write_mat,
}
