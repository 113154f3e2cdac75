"""Reads MATLAB files: up to version 7 with scipy, of version 7.3 as HDF5."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
import scipy.io

from rigd.config.problems import suggest
from rigd.importing.array_table import ArrayColumn, ArrayTable, matrix_columns
from rigd.importing.parquet_table import unreadable
from rigd.model.errors import ConfigError
from rigd.model.extras import require

_HDF5: Final = b"MATLAB 7.3"


def open_mat(path: Path, group: str | None) -> ArrayTable:
    """Return the arrays of a file, or those of the structure ``group``, as a table.

    A file up to version 7 is read whole.

    Raises:
        ConfigError: the file is cut off, damaged or no MATLAB file, or has no such structure.
    """
    with path.open("rb") as file:
        by_hdf5 = file.read(len(_HDF5)) == _HDF5
    if by_hdf5:
        require("import", "a MATLAB file of version 7.3")
        from rigd.importing.hdf5_table import open_hdf5

        return open_hdf5(path, group, by_matlab=True)
    try:
        content: dict[str, Any] = scipy.io.loadmat(path, simplify_cells=True)
    except (OSError, ValueError, TypeError, NotImplementedError, KeyError, IndexError) as error:
        raise unreadable(path, "MATLAB file", error) from error
    except Exception as error:  # scipy has errors of its own, and those of zlib
        raise unreadable(path, "MATLAB file", error) from error
    found = content
    if group is not None:
        structures = [name for name, item in content.items() if isinstance(item, dict)]
        if group not in structures:
            raise ConfigError(f"{path} has no structure {group!r}", hint=suggest(group, structures))
        found = content[group]
    units = found.get("units")
    return ArrayTable(path, partial(_opened, found, units if isinstance(units, dict) else {}))


@contextmanager
def _opened(found: dict[str, Any], units: dict[str, Any]) -> Iterator[Sequence[ArrayColumn]]:
    columns: list[ArrayColumn] = []
    for name, item in found.items():
        if name.startswith("__") or not isinstance(item, np.ndarray) or item.ndim not in (1, 2):
            continue
        columns += matrix_columns(name, str(units.get(name, "")), item)
    yield columns
