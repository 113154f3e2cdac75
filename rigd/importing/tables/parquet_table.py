"""Reads Parquet files batch by batch."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from mmap import ACCESS_READ, mmap
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from rigd.importing.tables.bounds import require_cells, require_chunk
from rigd.importing.tables.parquet_pages import page_sizes
from rigd.importing.tables.table import Batch, Kind
from rigd.model.errors import ConfigError, Place

#: Rows that are read at once.
BATCH_ROWS: Final = 131_072


class ParquetTable:
    """One Parquet file; see :class:`rigd.importing.tables.table.SourceTable`.

    A place in it is its row, from 1, and the number of the column.
    """

    def __init__(self, path: Path) -> None:
        """Read the schema.

        Raises:
            ConfigError: the file cannot be read, or is no Parquet.
        """
        self._path = path
        try:
            with pq.ParquetFile(path) as file:
                kinds = {field.name: field.type for field in file.schema_arrow}
            texts = [name for name, kind in kinds.items() if pa.types.is_string(kind)]
            self._file = pq.ParquetFile(path, read_dictionary=texts)
        except (OSError, pa.ArrowException) as error:
            raise unreadable(path, "Parquet", error) from error
        self._schema: Any = self._file.schema_arrow

    @property
    def path(self) -> Path:
        """The file."""
        return self._path

    @property
    def names(self) -> list[str]:
        """The names of the columns."""
        return list(self._schema.names)

    @property
    def start_ns(self) -> int | None:
        """None: the format has no place for it."""
        return None

    def unit(self, column: int) -> str:
        """Return the unit in the metadata of the column, as rigd exports it."""
        if self.is_moment(column):
            return "ns"
        metadata = self._schema.field(column).metadata or {}
        return str(metadata.get(b"unit", b""), "utf-8", "replace")

    def is_whole(self, column: int) -> bool:
        """Return whether the column has whole numbers."""
        kind = self._schema.field(column).type
        return bool(pa.types.is_integer(kind) or pa.types.is_timestamp(kind))

    def is_moment(self, column: int) -> bool:
        """Return whether the column has moments: its zero is 1970."""
        return bool(pa.types.is_timestamp(self._schema.field(column).type))

    def place(self, column: int, row: int | None = None) -> Place:
        """Return row and column."""
        return Place(str(self._path), 1 if row is None else row + 1, column + 1)

    def batches(self, wanted: Mapping[int, Kind]) -> Iterator[Batch]:
        """Yield all rows of the ``wanted`` columns, in order.

        Raises:
            ConfigError: a column has another type, or the file is damaged.
        """
        names = [self.names[column] for column in wanted]
        row = 0
        require_cells(self._path, self._file.metadata.num_rows, len(wanted))
        self._require_small_pages(names)
        for column, kind in wanted.items():
            if kind != "text":
                self._require_numbers(self._schema.field(column).type, column, 0)
        try:
            for found in self._file.iter_batches(BATCH_ROWS, columns=names):
                numbers: dict[int, Any] = {}
                texts: dict[int, Any] = {}
                for column, kind in wanted.items():
                    values = found.column(self._position(column, found.schema.names))
                    if kind == "text":
                        texts[column] = self._texts(values)
                    else:
                        numbers[column] = self._numbers(values, column, kind, row)
                yield Batch(row, found.num_rows, numbers, texts)
                row += found.num_rows
        except (OSError, pa.ArrowException) as error:
            raise unreadable(self._path, "Parquet", error) from error
        if not row:
            raise ConfigError("the file has no rows", place=self.place(0))

    def _position(self, column: int, read: Sequence[str]) -> int:
        """Return where a column is among the names of those ``read``, which may repeat."""
        name = self.names[column]
        same = [position for position, item in enumerate(read) if item == name]
        return same[self.names[:column].count(name)]

    def _numbers(self, values: Any, column: int, kind: Kind, row: int) -> Any:
        if pa.types.is_timestamp(values.type):
            values = values.cast(pa.timestamp("ns", values.type.tz)).cast(pa.int64())
        self._require_numbers(values.type, column, row)
        if kind == "whole":
            if values.null_count:
                empty = int(np.flatnonzero(values.is_null().to_numpy(zero_copy_only=False))[0])
                raise ConfigError("a time is missing", place=self.place(column, row + empty))
            return values.cast(pa.int64()).to_numpy(zero_copy_only=False)
        numbers = values.to_numpy(zero_copy_only=False)
        return numbers.astype(np.float64, copy=False)

    def _require_small_pages(self, names: Sequence[str]) -> None:
        """Raise unless each page of these columns may be unpacked: pyarrow does so as a whole.

        Raises:
            ConfigError: a page states more bytes than rigd unpacks, or there is none.
        """
        metadata = self._file.metadata
        paths = [metadata.schema.column(leaf).path for leaf in range(metadata.num_columns)]
        leaves = [  # a part of a nested column has its name, a dot, and its own
            leaf for leaf, path in enumerate(paths)
            if any(path == name or path.startswith(f"{name}.") for name in names)
        ]  # fmt: skip
        with (
            self._path.open("rb") as stream,
            mmap(stream.fileno(), 0, access=ACCESS_READ) as mapped,
            memoryview(mapped) as data,
        ):
            for group, leaf in product(range(metadata.num_row_groups), leaves):
                part = metadata.row_group(group).column(leaf)
                begin = min(part.dictionary_page_offset or part.data_page_offset,
                            part.data_page_offset)  # fmt: skip
                try:
                    for at, size in page_sizes(data, begin, begin + part.total_compressed_size):
                        require_chunk(self._path, f"a page at byte {at}", size)
                except ValueError as error:
                    raise ConfigError(
                        f"the file is damaged: there is no page at byte {error.args[0]}",
                        place=Place(str(self._path), 1, 1),
                    ) from None

    def _require_numbers(self, type: Any, column: int, row: int) -> None:
        kinds = pa.types
        type = type.value_type if kinds.is_dictionary(type) else type
        if not (
            kinds.is_integer(type) or kinds.is_floating(type) or kinds.is_boolean(type)
            or kinds.is_timestamp(type)
        ):  # fmt: skip
            raise ConfigError(
                f"column {self.names[column]!r} has the type {type}, no numbers",
                place=self.place(column, row),
            )

    def _texts(self, values: Any) -> Any:
        """Return values as texts; one that many rows have is held once until here."""
        if pa.types.is_dictionary(values.type):
            lengths = pc.binary_length(values.dictionary).take(values.indices)
            size = pc.sum(lengths).as_py() or 0
            require_chunk(self._path, f"texts of {len(values)} rows", size)
        return values.cast(pa.string()).fill_null("")


def unreadable(path: Path, kind: str, error: BaseException) -> ConfigError:
    """Return the error for a file that is cut off, damaged, or of another kind."""
    if isinstance(error, OSError) and error.strerror:
        return ConfigError(f"cannot read {path}: {error.strerror}")
    first = str(error).partition("\n")[0]
    return ConfigError(
        f"the file is cut off, damaged or no {kind}: {first}", place=Place(str(path), 1, 1)
    )
