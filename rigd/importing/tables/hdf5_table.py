"""Reads HDF5 files, and MATLAB files of version 7.3, which are HDF5."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from math import prod
from pathlib import Path
from typing import Any, Final

import h5py

from rigd.config.problems import suggest
from rigd.importing.tables.array_table import ArrayColumn, ArrayTable, matrix_columns, not_read
from rigd.importing.tables.bounds import require_chunk
from rigd.importing.tables.parquet_table import unreadable
from rigd.model.errors import ConfigError, Place

#: Of all names with their paths below one group: a group in a group 1,000 times has as many.
_MOST_LETTERS: Final = 1_000_000


def open_hdf5(path: Path, group: str | None, *, by_matlab: bool = False) -> ArrayTable:
    """Return the datasets below a group as a table; of a compound dataset its fields.

    Raises:
        ConfigError: the file is cut off, damaged or no HDF5, or has no such group.
    """
    return ArrayTable(path, partial(_opened, path, group, by_matlab))


@contextmanager
def _opened(path: Path, group: str | None, by_matlab: bool) -> Iterator[Sequence[ArrayColumn]]:
    try:
        file = h5py.File(path, "r")
    except OSError as error:
        raise unreadable(path, "HDF5", error) from error
    with file:
        found: Any = file
        if group is not None:
            if group not in file:
                there: list[str] = []
                file.visit(there.append)
                raise ConfigError(f"{path} has no group {group!r}", hint=suggest(group, there))
            found = file[group]
        columns = list(_columns(path, found, by_matlab))
        if by_matlab and not columns:
            _refuse_object(path, file)
        yield columns


def _columns(path: Path, found: Any, by_matlab: bool) -> Iterator[ArrayColumn]:
    if isinstance(found, h5py.Dataset):
        yield from _of_dataset(path, "", found, by_matlab)
        return
    for name, item in _datasets(path, found):
        if not (name.startswith("#") or _is_object(item)):
            yield from _of_dataset(path, name, item, by_matlab)


def _datasets(path: Path, found: Any) -> list[tuple[str, Any]]:
    """Return the datasets below a group.

    Raises:
        ConfigError: it has too many parts, or they are too deep in each other.
    """
    datasets: list[tuple[str, Any]] = []
    left = _MOST_LETTERS

    def take(name: str, item: Any) -> bool | None:
        nonlocal left
        left -= len(name) + 1
        if isinstance(item, h5py.Dataset):
            datasets.append((name, item))
        return True if left < 0 else None

    if found.visititems(take):
        raise ConfigError(
            f"the names of its groups and datasets have more than {_MOST_LETTERS} letters",
            place=Place(str(path), 1, 1),
            hint="name the group that has the channels by `group:` in the source",
        )
    return datasets


def _is_object(item: Any) -> bool:
    """Return whether MATLAB wrote an object of a class there, whose content lies elsewhere."""
    return "MATLAB_object_decode" in item.attrs


def _refuse_object(path: Path, file: Any) -> None:
    for name, item in file.items():
        if not name.startswith("#") and _is_object(item):
            raise not_read(path, name)


def _of_dataset(path: Path, name: str, data: Any, by_matlab: bool) -> Iterator[ArrayColumn]:
    if data.chunks is not None and data.ndim in (1, 2):
        size = prod(data.chunks) * data.dtype.itemsize
        require_chunk(path, f"chunks of the dataset {name!r}", size)
    unit = _text(data.attrs.get("unit", data.attrs.get("units", "")))
    if data.dtype.names and data.ndim == 1:
        for field in data.dtype.names:
            yield ArrayColumn(
                f"{name}/{field}" if name else field, "", len(data),
                data.dtype[field].kind in "iu", partial(_field, data, field),
            )  # fmt: skip
        return
    if data.ndim in (1, 2):
        yield from matrix_columns(path, name, unit, data, rows_last=by_matlab)


def _field(data: Any, field: str, start: int, end: int) -> Any:
    return data[field][start:end] if data.chunks is None else data[start:end][field]


def _text(value: object) -> str:
    return value.decode() if isinstance(value, bytes) else str(value)
