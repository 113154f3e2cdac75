"""Writes recordings as tables for other programs: Parquet, CSV, MATLAB, HDF5, ASAM MDF 4.

The package :mod:`rigd.record` does not import this package, because what it needs takes 0.4 s to
import (asammdf 1 s), and neither the recorder nor ``rigd info`` needs them.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import Final, Literal

from rigd.model import RecordingError
from rigd.record.export.part import Measures, Origin, Part, free_name, origin, parts
from rigd.record.mcap.schema import EVENTS_STREAM
from rigd.record.read.joined_table import TimeBase
from rigd.record.read.reader import Recording
from rigd.record.read.tables import STEPS_TABLE, TRIALS_TABLE

Format = Literal["parquet", "csv", "mat", "hdf5", "mdf4"]
Write = Callable[[Path, Sequence[Part], Origin], None]
#: Bytes of a file's name, which gets 5 more while it is written.
_LONGEST_NAME: Final = 250
_MAT_HEADER_BYTES: Final = 128


@dataclass(frozen=True)
class FileFormat:
    """How a format is written: by a function ``MODULE:NAME``, imported when it is needed.

    ``together``: all tables in one file. ``described``: a further file describes the tables.
    """

    suffixes: tuple[str, ...]  #: the first is written, the others are as good
    writer: str
    together: bool = False
    described: bool = False

    @property
    def write(self) -> Write:
        """The function that writes."""
        return _function(self.writer)


FORMATS: Final[dict[Format, FileFormat]] = {
    "parquet": FileFormat((".parquet",), "arrow:write_parquet"),
    "csv": FileFormat((".csv",), "arrow:write_csv", described=True),
    "mat": FileFormat((".mat",), "mat:write_mat"),
    "hdf5": FileFormat((".h5", ".hdf5"), "hdf5:write_hdf5", together=True),
    "mdf4": FileFormat((".mf4",), "mdf4:write_mdf4", together=True),
}
#: Beside CSV tables: their metadata, and the descriptions of their columns.
DESCRIPTION: Final = "metadata.json"


def export(
    recording: Recording,
    target: Path,
    format: Format,
    *,
    streams: Iterable[str] | None = None,
    base: TimeBase | None = None,
    trials: Collection[int] | None = None,
    overwrite: bool = False,
    measures: Measures = MappingProxyType({}),
) -> list[Path]:
    """Write each stream, and the events, as a table of its own; return the files.

    ``target`` is the folder of the tables, or the file of ``hdf5`` and ``mdf4``. The columns are
    those of :mod:`rigd.record.read.tables`, bit for bit as recorded. ``streams`` None: all, with
    events. ``base``: the streams in one table instead, at these times
    (:mod:`rigd.record.read.joined_table`). ``trials``: only the rows of these, by number; None: all
    rows. The tables of trials and steps are always written; ``measures`` are further columns of the
    trials: see :func:`rigd.record.read.tables.with_measures`. Rows are written in batches: memory
    does not grow with the recording, but for ``mat``.

    Raises:
        RecordingError: no such stream, two of one file name, a file exists (unless ``overwrite``),
            or it cannot be written: then no file is new or changed.
    """
    kind = FORMATS[format]
    chosen = [*recording.streams, EVENTS_STREAM] if streams is None else list(streams)
    tables = parts(recording, chosen, base, measures, trials)
    files: dict[Path, tuple[Write, list[Part]]] = {}
    if kind.together:
        files[target] = kind.write, tables
    else:
        for part in tables:
            path = target / f"{part.name.replace('/', '.')}{kind.suffixes[0]}"
            if len(path.name.encode()) > _LONGEST_NAME:
                raise RecordingError(
                    f"{part.name!r} is longer than the name of a file may be",
                    hint="Export to hdf5 or mdf4 instead, or other streams alone by --stream.",
                )
            if path in files:
                raise RecordingError(
                    f"{files[path][1][0].name!r} and {part.name!r} would both be {path.name}",
                    hint="Export to hdf5 or mdf4 instead, or one of them alone by --stream.",
                )
            files[path] = kind.write, [part]
        if kind.described:
            files[target / DESCRIPTION] = _function("arrow:describe_csv"), tables
    # These exist if another stream was exported before; what they contain must be the same.
    shared = {free_name(name, recording) for name in (TRIALS_TABLE, STEPS_TABLE)}
    repeated = [
        path
        for path, (_, held) in files.items()
        if path.name == DESCRIPTION or {part.name for part in held} <= shared
    ]
    existing = [path for path in files if path.exists() and path not in repeated]
    if existing and not overwrite:
        raise _exists(*existing)
    _write(files, origin(recording, base, trials), repeated, target, overwrite=overwrite)
    return list(files)


def _write(
    files: Mapping[Path, tuple[Write, Sequence[Part]]],
    about: Origin,
    repeated: Collection[Path],
    target: Path,
    *,
    overwrite: bool,
) -> None:
    """Write every file under another name, then rename all: a half table has no final name."""
    beside = {path: path.with_name(path.name + ".part") for path in files}
    try:
        for path, (write, tables) in files.items():
            path.parent.mkdir(parents=True, exist_ok=True)
            write(beside[path], tables, about)
        for path in repeated:
            if path.exists() and not overwrite and not _same(beside[path], path):
                raise _exists(path)
        for path, part in beside.items():
            part.replace(path)
    except OSError as error:
        reason = error.strerror or str(error)
        raise RecordingError(
            f"cannot export to {target}: {reason}",
            hint="The disk may be full, the folder not yours, or a file open in another program.",
        ) from error
    finally:
        for part in beside.values():
            with suppress(OSError):
                part.unlink(missing_ok=True)


def _exists(*paths: Path) -> RecordingError:
    more = f", as do {len(paths) - 1} more" if len(paths) > 1 else ""
    return RecordingError(
        f"{paths[0]} exists already{more}", hint="Choose another --output, or give --overwrite."
    )


def _same(new: Path, old: Path) -> bool:
    """Return whether two files are the same, but for the date that begins a MATLAB file."""
    skipped = _MAT_HEADER_BYTES if old.suffix == ".mat" else 0
    return new.read_bytes()[skipped:] == old.read_bytes()[skipped:]


def _function(name: str) -> Write:
    module, _, function = name.partition(":")
    found: Write = getattr(import_module(f"rigd.record.export.{module}"), function)
    return found
