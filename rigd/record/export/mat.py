"""Writes tables as MATLAB files of version 7, each made in memory."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import scipy.io

from rigd.model import RecordingError
from rigd.record.export.part import Origin, Part, step_column, step_numbers
from rigd.record.tables import Table

#: Longest name of a field that MATLAB 7 files can hold (``long_field_names`` of scipy).
MAX_NAME: Final = 63


def write_mat(path: Path, parts: Sequence[Part], origin: Origin) -> None:
    """Write a table as a variable for each column; ``step`` is a number into ``step_names``.

    Raises:
        RecordingError: a name is too long, or the table too large for such a file.

    """
    (part,) = parts
    table = part.whole()
    names = {column: _name(table, column) for column in table.columns}
    content: dict[str, Any] = {names[column]: values for column, values in table.columns.items()}
    if step := step_column(table):
        # A text in each row would take a cell each: the rows have numbers into the list of texts.
        content["step_names"] = np.array(origin.step_names, object)
        content[names[step]] = step_numbers(table.columns[step], origin)
    content["units"] = {names[column]: unit for column, unit in table.units.items()}
    content["recording"] = origin.recording
    content["metadata"] = json.dumps(origin.metadata)
    try:
        # The name ends in .part, to which scipy would add .mat.
        scipy.io.savemat(
            str(path), content, appendmat=False, long_field_names=True, oned_as="column"
        )
    except scipy.io.matlab.MatWriteError as error:
        raise RecordingError(
            f"{part.name}: a MATLAB file cannot hold it: {error}", hint="Export to hdf5 instead."
        ) from error


def _name(table: Table, column: str) -> str:
    """Return the name of a column as MATLAB takes it.

    Raises:
        RecordingError: it is too long.

    """
    name = column.replace(".", "_").replace("/", "_")
    if len(name) > MAX_NAME:
        raise RecordingError(
            f"{table.name}.{name}: MATLAB takes names of {MAX_NAME} letters at most",
            hint="Export to parquet, csv or hdf5 instead.",
        )
    return name
