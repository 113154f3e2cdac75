"""Opens a file of another program as a table, by the format of the map or by its ending."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Final

from rigd.importing.source import Format, TextTableSource
from rigd.importing.tables.library_warnings import hear
from rigd.importing.tables.table import SourceTable
from rigd.model.errors import ConfigError, Place
from rigd.model.machine.extras import require

_ENDINGS: Final[dict[str, Format]] = {
    ".csv": "csv",
    ".txt": "csv",
    ".dat": "csv",
    ".asc": "csv",
    ".tsv": "csv",
    ".lvm": "csv",
    ".parquet": "parquet",
    ".pq": "parquet",
    ".h5": "hdf5",
    ".hdf5": "hdf5",
    ".hdf": "hdf5",
    ".mat": "mat",
    ".tdms": "tdms",
    ".mf4": "mdf",
    ".mdf": "mdf",
    ".npz": "numpy",
    ".npy": "numpy",
    ".jsonl": "jsonl",
    ".ndjson": "jsonl",
}


def open_table(
    path: Path, format: Format | None, text: TextTableSource, group: str | None = None
) -> SourceTable:
    """Return the table in the file at ``path``, in ``group`` if it has several.

    Raises:
        ConfigError: the format is not known, or the file is empty, damaged or of another format.
    """
    kind = format or format_of(path)
    try:
        if path.stat().st_size == 0:
            raise ConfigError("the file is empty", place=Place(str(path), 1, 1))
    except OSError as error:
        raise ConfigError(f"cannot read {path}: {error.strerror}") from error
    if group is not None and kind in ("csv", "parquet", "numpy", "jsonl"):
        raise ConfigError(f"{path}: a {kind} file has no group {group!r}", hint="remove `group:`")
    # Imported here: a file of one format needs no library of the others.
    if kind == "parquet":
        from rigd.importing.tables.parquet_table import ParquetTable

        return ParquetTable(path)
    if kind == "mat":
        from rigd.importing.tables.mat_table import open_mat

        return open_mat(path, group)
    if kind == "numpy":
        from rigd.importing.tables.numpy_table import open_numpy

        return open_numpy(path)
    if kind == "jsonl":
        from rigd.importing.tables.json_table import JsonTable

        return JsonTable(path)
    if kind != "csv":
        require("import", f"the import of {path.name}")
        opener = _opener(kind)
        hear("nptdms" if kind == "tdms" else "asammdf")
        return opener(path, group)
    from rigd.importing.tables.csv_table import CsvTable

    return CsvTable(path, text)


def format_of(path: Path) -> Format:
    """Return the format by the ending of a file's name.

    Raises:
        ConfigError: it is not known.
    """
    kind = _ENDINGS.get(path.suffix.lower())
    if kind is None:
        raise ConfigError(
            f"{path}: which format a name in {path.suffix!r} has is not known",
            hint="give `format:` in the source of the map",
        )
    return kind


def groups_in(path: Path) -> list[str | None]:
    """Return what selects the tables of a file, None for the one that needs no `group:`.

    Raises:
        ConfigError: the format is not known, or the file is damaged or of another format.
    """
    kind = format_of(path)
    if kind == "tdms":
        require("import", f"the import of {path.name}")
        from rigd.importing.tables.tdms_table import tdms_groups

        hear("nptdms")
        return [*tdms_groups(path)]
    if kind == "mdf":
        require("import", f"the import of {path.name}")
        from rigd.importing.tables.mdf_table import mdf_groups

        hear("asammdf")
        return [*mdf_groups(path)]
    if kind == "mat":
        from rigd.importing.tables.mat_table import mat_groups

        return mat_groups(path)
    return [None]


def _opener(kind: Format) -> Callable[[Path, str | None], SourceTable]:
    """Return what opens the files of a format that needs a library of the extra `import`."""
    if kind == "hdf5":
        from rigd.importing.tables.hdf5_table import open_hdf5

        return open_hdf5
    if kind == "tdms":
        from rigd.importing.tables.tdms_table import open_tdms

        return open_tdms
    from rigd.importing.tables.mdf_table import open_mdf

    return open_mdf
