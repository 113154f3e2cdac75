"""Writes tables as MATLAB files of version 7, each made in memory."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import scipy.io

from rigd.model import RecordingError
from rigd.record.export.part import Origin, Part, step_column, step_numbers, unused
from rigd.record.read.tables import Table

#: Longest name of a field that MATLAB 7 files can hold (``long_field_names`` of scipy).
MAX_NAME: Final = 63


def write_mat(path: Path, parts: Sequence[Part], origin: Origin) -> None:
    """Write a table as a variable for each column; ``step`` is a number into ``step_names``.

    A variable of rigd's own, such as ``units``, is ``rigd_units`` beside a column of that name.

    Raises:
        RecordingError: a name is too long, two columns would have one name, or the table is too
            large for such a file.
    """
    (part,) = parts
    table = part.whole()
    names = _names(table)
    taken = names.values()
    content: dict[str, Any] = {names[column]: values for column, values in table.columns.items()}
    if step := step_column(table):
        # A text in each row would take a cell each: the rows have numbers into the list of texts.
        content[unused("step_names", taken)] = np.array(origin.step_names, object)
        content[names[step]] = step_numbers(table.columns[step], origin)
    content[unused("units", taken)] = {names[at]: unit for at, unit in table.units.items()}
    content[unused("recording", taken)] = origin.recording
    content[unused("metadata", taken)] = json.dumps(origin.metadata)
    try:
        # The name ends in .part, to which scipy would add .mat.
        scipy.io.savemat(
            str(path), content, appendmat=False, long_field_names=True, oned_as="column"
        )
    except scipy.io.matlab.MatWriteError as error:
        raise RecordingError(
            f"{part.name}: a MATLAB file cannot hold it: {error}", hint="Export to hdf5 instead."
        ) from error


def _names(table: Table) -> dict[str, str]:
    """Return the names of the columns as MATLAB takes them.

    Raises:
        RecordingError: one is too long, or two are alike.
    """
    found: dict[str, str] = {}
    for column in table.columns:
        name = column.replace(".", "_").replace("/", "_")
        if len(name) > MAX_NAME:
            raise RecordingError(
                f"{table.name}.{name}: MATLAB takes names of {MAX_NAME} letters at most",
                hint="Export to parquet, csv or hdf5 instead.",
            )
        if name in found:
            raise RecordingError(
                f"{table.name}: {found[name]} and {column} would both be {name} in MATLAB",
                hint="Export to parquet, csv or hdf5 instead.",
            )
        found[name] = column
    return {column: name for name, column in found.items()}
