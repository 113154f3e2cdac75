"""Reads files of numpy: the arrays of ``.npz``, or the one of ``.npy``; never pickled objects."""

from __future__ import annotations

import math
import zipfile
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import IO, Any, Final

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from rigd.importing.tables.array_table import ArrayColumn, ArrayTable, matrix_columns
from rigd.importing.tables.bounds import require_held
from rigd.importing.tables.parquet_table import unreadable
from rigd.model.errors import ConfigError

#: The column of an array that has no name, as of ``.npy``.
_UNNAMED: Final = "data"
_ENDING: Final = ".npy"


def open_numpy(path: Path) -> ArrayTable:
    """Return the arrays of a file as a table, the fields of structured arrays by their names.

    Arrays of more than two dimensions, of none, and pickled objects are no columns. The arrays of
    ``.npz`` are held in memory while they are read.

    Raises:
        ConfigError: the file is cut off, damaged, no file of numpy, or has objects only.
    """
    arrays = _load(path)
    if arrays and all(item.dtype.hasobject for item in arrays.values()):
        raise ConfigError(
            f"the array {next(iter(arrays))!r} in {path} has pickled objects, which can run any "
            "code and are not read",
            hint="save arrays of numbers: np.savez('new.npz', t=t, force=force)",
        )
    return ArrayTable(path, partial(_opened, path))


@contextmanager
def _opened(path: Path) -> Iterator[Sequence[ArrayColumn]]:
    columns: list[ArrayColumn] = []
    for name, item in _load(path).items():
        for field, values in _fields(name, item):
            if values.ndim in (1, 2) and not values.dtype.hasobject:
                columns += matrix_columns(path, field, "", values)
    yield columns


def _fields(name: str, item: NDArray[Any]) -> Iterator[tuple[str, NDArray[Any]]]:
    """Yield the fields of a structured array, ``name.field`` unless it has no name of its own."""
    if item.dtype.names is None:
        yield name, item
        return
    for field in item.dtype.names:
        yield field if name == _UNNAMED else f"{name}.{field}", item[field]


def _load(path: Path) -> Mapping[str, NDArray[Any]]:
    """Return the arrays by their names; those of objects are empty.

    Raises:
        ConfigError: they cannot be read, or are too large.
    """
    try:
        if not zipfile.is_zipfile(path):
            with path.open("rb") as head:
                _, dtype = _head(head)
            empty = np.empty(0, object)
            return {_UNNAMED: empty if dtype.hasobject else npy.open_memmap(path, mode="r")}
        with zipfile.ZipFile(path) as file:
            members = [item for item in file.infolist() if item.filename.endswith(_ENDING)]
            require_held(path, (item.file_size for item in members))
            return {
                item.filename.removesuffix(_ENDING): _read(path, file, item) for item in members
            }
    except (OSError, ValueError, EOFError, NotImplementedError, RuntimeError) as error:
        raise unreadable(path, "file of numpy", error) from error
    except (zipfile.BadZipFile, zlib.error) as error:
        raise unreadable(path, "file of numpy", error) from error


def _read(path: Path, file: zipfile.ZipFile, member: zipfile.ZipInfo) -> NDArray[Any]:
    """Return an array, unless its head claims more bytes than the file holds for it."""
    with file.open(member) as head:
        shape, dtype = _head(head)
    if dtype.hasobject:
        return np.empty(0, object)
    require_held(path, iter([math.prod(shape) * dtype.itemsize]))
    if math.prod(shape) * dtype.itemsize > member.file_size:
        raise ValueError(f"{member.filename} ends before its array")
    with file.open(member) as content:
        found: NDArray[Any] = npy.read_array(content, allow_pickle=False)
    return found


def _head(file: IO[bytes]) -> tuple[tuple[int, ...], np.dtype[Any]]:
    """Return shape and type of the array that begins here; a head of version 3 is read as of 2."""
    version = npy.read_magic(file)
    read_head = npy.read_array_header_1_0 if version[0] == 1 else npy.read_array_header_2_0
    shape, _, dtype = read_head(file)
    return shape, dtype
