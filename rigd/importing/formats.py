"""Opens a file of another program as a table, by the format of the map or by its ending."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from rigd.importing.source import Format, TextTableSource
from rigd.importing.table import SourceTable
from rigd.model.errors import ConfigError, Place

_ENDINGS: Final[dict[str, Format]] = {
    ".csv": "csv",
    ".txt": "csv",
    ".dat": "csv",
    ".asc": "csv",
    ".tsv": "csv",
    ".parquet": "parquet",
    ".pq": "parquet",
}


def open_table(path: Path, format: Format | None, text: TextTableSource) -> SourceTable:
    """Return the table in the file at ``path``.

    Raises:
        ConfigError: the format is not known, or the file is empty, damaged or of another format.
    """
    kind = format or _ENDINGS.get(path.suffix.lower())
    if kind is None:
        raise ConfigError(
            f"{path}: which format a name in {path.suffix!r} has is not known",
            hint="give `format:` in the source of the map",
        )
    try:
        if path.stat().st_size == 0:
            raise ConfigError("the file is empty", place=Place(str(path), 1, 1))
    except OSError as error:
        raise ConfigError(f"cannot read {path}: {error.strerror}") from error
    # Imported here: a file of one format needs no library of the others.
    if kind == "parquet":
        from rigd.importing.parquet_table import ParquetTable

        return ParquetTable(path)
    from rigd.importing.csv_table import CsvTable

    return CsvTable(path, text)
