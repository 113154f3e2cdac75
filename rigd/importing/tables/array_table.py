"""Reads tables whose columns are arrays of their own, as in HDF5, MAT, TDMS and MDF4 files."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from rigd.importing.tables.bounds import require_cells, require_columns
from rigd.importing.tables.table import Batch, Kind
from rigd.model.errors import ConfigError, Place

#: Rows that are read at once.
BATCH_ROWS: Final = 131_072


@dataclass(frozen=True, eq=False)
class ArrayColumn:
    """A column of ``rows`` values; ``read`` returns those from one row to before another."""

    name: str
    unit: str
    rows: int
    whole: bool  #: whether its type has whole numbers
    read: Callable[[int, int], NDArray[Any]]


#: Opens the file and gives its columns, which can be read until it is closed.
Opener = Callable[[], AbstractContextManager[Sequence[ArrayColumn]]]


class ArrayTable:
    """One table of arrays; see :class:`rigd.importing.tables.table.SourceTable`.

    A place in it is its row, from 1, and the number of the column. ``start_ns`` is when its times
    begin, if the file states it.
    """

    def __init__(self, path: Path, opener: Opener, start_ns: int | None = None) -> None:
        """Read names, units and lengths of the columns.

        Raises:
            ConfigError: the file cannot be read, or has no columns.
        """
        self._path = path
        self._opener = opener
        self._start_ns = start_ns
        with opener() as columns:
            self._columns = [(item.name, item.unit, item.rows, item.whole) for item in columns]
        if not self._columns:
            raise ConfigError(f"{path} has no columns of numbers")

    @property
    def path(self) -> Path:
        """The file."""
        return self._path

    @property
    def names(self) -> Sequence[str]:
        """The names of the columns."""
        return [column[0] for column in self._columns]

    @property
    def lengths(self) -> Sequence[int]:
        """How many rows each column has."""
        return [column[2] for column in self._columns]

    @property
    def start_ns(self) -> int | None:
        """When a time of 0 was, in ns since 1970, if the file states it."""
        return self._start_ns

    def unit(self, column: int) -> str:
        """Return the unit that the file states."""
        return self._columns[column][1]

    def is_whole(self, column: int) -> bool:
        """Return whether the column has whole numbers."""
        return self._columns[column][3]

    def place(self, column: int, row: int | None = None) -> Place:
        """Return row and column."""
        return Place(str(self._path), 1 if row is None else row + 1, column + 1)

    def batches(self, wanted: Mapping[int, Kind]) -> Iterator[Batch]:
        """Yield all rows of the ``wanted`` columns, in order.

        Raises:
            ConfigError: columns have different lengths, or no numbers.
        """
        lengths = {self._columns[column][2]: column for column in wanted}
        if len(lengths) > 1:
            (a, first), (b, second), *_ = lengths.items()
            raise ConfigError(
                f"column {self.names[first]!r} has {a} rows, {self.names[second]!r} {b}",
                place=self.place(second),
                hint="columns of different rates are sources of their own",
            )
        (rows,) = lengths
        if not rows:
            raise ConfigError("the file has no rows", place=self.place(0))
        require_cells(self._path, rows, len(wanted))
        with self._opener() as columns:
            for first_row in range(0, rows, BATCH_ROWS):
                end = min(first_row + BATCH_ROWS, rows)
                numbers: dict[int, Any] = {}
                texts: dict[int, Any] = {}
                for column, kind in wanted.items():
                    values = columns[column].read(first_row, end)
                    if len(values) != end - first_row:
                        raise ConfigError(
                            f"column {self.names[column]!r} ends before row {end}: the file seems "
                            "to be cut off",
                            place=self.place(column, first_row + len(values)),
                        )
                    if kind == "text":
                        texts[column] = as_texts(values)
                    else:
                        numbers[column] = self._numbers(values, column, kind, first_row)
                yield Batch(first_row, end - first_row, numbers, texts)

    def _numbers(self, values: NDArray[Any], column: int, kind: Kind, row: int) -> NDArray[Any]:
        if values.dtype.kind == "M":
            values = values.astype("datetime64[ns]").astype(np.int64)
        if values.dtype.kind not in "iufb":
            raise ConfigError(
                f"column {self.names[column]!r} has the type {values.dtype}, no numbers",
                place=self.place(column, row),
            )
        if kind == "whole" and values.dtype.kind == "f" and np.isnan(values).any():
            empty = int(np.flatnonzero(np.isnan(values))[0])
            raise ConfigError("a time is missing", place=self.place(column, row + empty))
        return np.ascontiguousarray(values, np.int64 if kind == "whole" else np.float64)


def as_texts(values: NDArray[Any]) -> Any:
    """Return values as an Arrow array of texts."""
    if values.dtype.kind in "OSU":
        return pa.array(
            [item.decode() if isinstance(item, bytes) else str(item) for item in values.tolist()],
            pa.string(),
        )
    return pa.array(np.ascontiguousarray(values)).cast(pa.string()).fill_null("")


def matrix_columns(
    path: Path, name: str, unit: str, values: Any, *, rows_last: bool = False
) -> Iterator[ArrayColumn]:
    """Yield the columns of an array of one or two dimensions: ``name``, or ``name.1`` and so on.

    ``rows_last``: the rows run along the second dimension, as MATLAB writes to HDF5.

    Raises:
        ConfigError: it has more columns than rigd reads; names the ``path`` of its file.
    """
    kind = values.dtype.kind
    whole = kind in "iuM"
    if values.ndim == 1:
        yield ArrayColumn(name, unit, len(values), whole, lambda a, b: values[a:b])
        return
    rows, count = values.shape[::-1] if rows_last else values.shape
    if 1 in (rows, count):  # a vector, whichever way it lies
        along_first = values.shape[1] == 1

        def flat(a: int, b: int) -> NDArray[Any]:
            part: NDArray[Any] = values[a:b, 0] if along_first else values[0, a:b]
            return part

        yield ArrayColumn(name, unit, max(rows, count), whole, flat)
        return
    require_columns(path, name, count)
    for index in range(count):

        def nth(a: int, b: int, at: int = index) -> NDArray[Any]:
            part: NDArray[Any] = values[at, a:b] if rows_last else values[a:b, at]
            return part

        yield ArrayColumn(f"{name}.{index + 1}", unit, rows, whole, nth)


def not_read(path: Path, name: str) -> ConfigError:
    """Return the error for a variable that only MATLAB can read."""
    return ConfigError(
        f"the variable {name!r} in {path} is an object of MATLAB, such as a timeseries, a table or "
        "a Dataset of Simulink, which only MATLAB reads",
        hint=f"save its numbers in MATLAB: s.t = {name}.Time; s.x = {name}.Data; "
        "save('new.mat', '-struct', 's')",
    )
