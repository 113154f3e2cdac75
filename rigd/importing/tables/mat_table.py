"""Reads MATLAB files: up to version 7 with scipy, of version 7.3 as HDF5."""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO, Final

import numpy as np
import scipy.io
from scipy.io.matlab import MatlabFunction, MatlabOpaque

from rigd.config.problems import suggest
from rigd.importing.tables.array_table import ArrayColumn, ArrayTable, matrix_columns, not_read
from rigd.importing.tables.bounds import require_held, unpacked_sizes
from rigd.importing.tables.parquet_table import unreadable
from rigd.model.errors import ConfigError
from rigd.model.machine.extras import require

_HDF5: Final = b"MATLAB 7.3"
#: Of the head of a file up to version 7: its bytes, and where the mark of the byte order begins;
#: and the type of a variable that is compressed ("MAT-File Format", MathWorks, 1-9).
_HEAD_BYTES: Final = 128
_ORDER_AT: Final = 126
_COMPRESSED: Final = 15
#: So many structures are listed.
_MOST_NAMED: Final = 12


def open_mat(path: Path, group: str | None) -> ArrayTable:
    """Return the arrays of a file, or those of the structure ``group``, as a table.

    A file up to version 7 is read whole.

    Raises:
        ConfigError: the file is cut off, damaged or no MATLAB file, or has no such structure.
    """
    if _is_hdf5(path):
        require("import", "a MATLAB file of version 7.3")
        from rigd.importing.tables.hdf5_table import open_hdf5

        return open_hdf5(path, group, by_matlab=True)
    own = _load(path)
    structures = dict(_structures(own))
    found = own
    if group is not None:
        if group not in structures:
            _refuse_object(path, {group: own.get(group)})
            raise ConfigError(f"{path} has no structure {group!r}", hint=suggest(group, structures))
        found = structures[group]
    elif not _has_numbers(own):
        _refuse_object(path, own)
        if structures:
            raise ConfigError(
                f"{path} has structures and no arrays",
                hint=f"give `group:`, one of {', '.join(list(structures)[:_MOST_NAMED])}",
            )
    units = found.get("units")
    return ArrayTable(path, partial(_opened, path, found, units if isinstance(units, dict) else {}))


def mat_groups(path: Path) -> list[str | None]:
    """Return the structures of a file that have arrays of numbers, None for those beside them.

    Raises:
        ConfigError: the file is cut off, damaged or no MATLAB file.
    """
    if _is_hdf5(path):
        return [None]
    own = _load(path)
    found: list[str | None] = [name for name, item in _structures(own) if _has_numbers(item)]
    return [None, *found] if _has_numbers(own) or not found else found


def _is_hdf5(path: Path) -> bool:
    with path.open("rb") as file:
        return file.read(len(_HDF5)) == _HDF5


def _load(path: Path) -> dict[str, Any]:
    """Return the variables of a file up to version 7.

    Raises:
        ConfigError: it is cut off, damaged, too large or no MATLAB file.
    """
    with path.open("rb") as file:
        require_held(path, _unpacked(file))
    try:
        content: dict[str, Any] = scipy.io.loadmat(path, simplify_cells=True)
    except (OSError, ValueError, TypeError, NotImplementedError, KeyError, IndexError) as error:
        raise unreadable(path, "MATLAB file", error) from error
    except Exception as error:  # scipy has errors of its own, and those of zlib
        raise unreadable(path, "MATLAB file", error) from error
    return {name: item for name, item in content.items() if not name.startswith("__")}


def _has_numbers(own: dict[str, Any]) -> bool:
    return any(isinstance(x, np.ndarray) and x.dtype.kind in "iufb" for x in own.values())


def _unpacked(file: BinaryIO) -> Iterator[int]:
    """Yield the sizes of the parts of all compressed variables of a file of version 5 to 7."""
    head = file.read(_HEAD_BYTES)
    tag = struct.Struct("<II" if head[_ORDER_AT:] == b"IM" else ">II")
    while len(begin := file.read(tag.size)) == tag.size:
        kind, size = tag.unpack(begin)
        if kind == _COMPRESSED:
            yield from unpacked_sizes(file.read(size))
        else:
            file.seek(size, os.SEEK_CUR)


def _structures(own: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the structures by what selects them: `run`, or `results(3)` of an array of them."""
    for name, item in own.items():
        if isinstance(item, dict):
            yield name, item
        elif isinstance(item, list):
            yield from (
                (f"{name}({at})", part) for at, part in enumerate(item, 1) if isinstance(part, dict)
            )


def _refuse_object(path: Path, own: dict[str, Any]) -> None:
    for name, item in own.items():
        if is_object(item):
            raise not_read(path, name)


def is_object(item: object) -> bool:
    """Return whether scipy has found an object of a class of MATLAB, and not its content."""
    kinds = (MatlabOpaque, MatlabFunction)
    return isinstance(item, kinds) or (
        isinstance(item, np.ndarray) and item.dtype.names == ("s0", "s1", "s2", "arr")
    )


@contextmanager
def _opened(
    path: Path, found: dict[str, Any], units: dict[str, Any]
) -> Iterator[Sequence[ArrayColumn]]:
    columns: list[ArrayColumn] = []
    for name, item in found.items():
        if name.startswith("__") or not isinstance(item, np.ndarray) or item.ndim not in (1, 2):
            continue
        columns += matrix_columns(path, name, str(units.get(name, "")), item)
    yield columns
