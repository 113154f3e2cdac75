"""Reads the first rows of every column of a table, to see what the column is."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rigd.importing.proposal.dialect import MISSING, Dialect, number
from rigd.importing.tables.array_table import ArrayTable
from rigd.importing.tables.table import (
    HasMoments,
    Kind,
    SourceTable,
    parse_file_unit,
    split_unit,
    stated_unit,
)
from rigd.model.errors import ConfigError
from rigd.model.units import Unit

#: Rows that are looked at.
SAMPLE_ROWS: Final = 20_000
#: A longer name of a column is not written into a map, its number is.
LONGEST_NAME: Final = 200
#: A unit at the end of a name, as in `time_ms`.
_ENDING: Final = re.compile(r"[_ ](ns|us|ms|s|min|h)$")
_WORDS: Final = {"millis": "ms", "micros": "us"}


@dataclass(frozen=True, eq=False)
class SeenColumn:
    """A column and its first rows: ``values`` (n,), or ``texts`` if it has no numbers.

    ``unit`` is None if the file states none that rigd knows; ``stated`` is what it states.
    ``rows`` is how many the column has, 0 if the format tells it at the end only. ``moment``: its
    values are ns since 1970, whatever the map states.
    """

    index: int
    name: str
    stated: str
    unit: Unit | None
    values: NDArray[np.float64] | NDArray[np.int64] | None
    texts: Sequence[str]
    rows: int
    moment: bool
    missing: tuple[str, ...] = ()

    @property
    def bare(self) -> str:
        """The name without its unit."""
        return split_unit(self.name)[0].strip()

    @property
    def unit_in_name(self) -> str | None:
        """The unit of time that the name ends with, None if there is none."""
        name = self.bare.lower()
        match = _ENDING.search(name)
        return _WORDS.get(name) or (match[1] if match else None)

    def written(self, names: Sequence[str]) -> str:
        """Return what selects it in a map: its name, or its number if others have the name."""
        bare = [split_unit(name)[0] for name in names]
        for text, others in ((self.name, names), (split_unit(self.name)[0], bare)):
            if others.count(text) == 1 and 0 < len(text) <= LONGEST_NAME:
                return text
        return str(self.index + 1)


def name_of(text: str, taken: Mapping[str, object]) -> str:
    """Return a name of rigd for what others call ``text``, which none of ``taken`` has."""
    plain = unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode().lower()
    name = re.sub(r"[^a-z0-9]+", "_", plain).strip("_")[:50]
    if not name[:1].isalpha():
        name = f"column_{name}".rstrip("_")
    found, count = name, 1
    while found in taken:
        count += 1
        found = f"{name}_{count}"
    return found


def of_text(table: SourceTable, dialect: Dialect) -> list[SeenColumn]:
    """Return the columns of a text file."""
    rows = dialect.rows[:SAMPLE_ROWS]
    found = []
    for index, name in enumerate(table.names):
        texts = [row[index] if index < len(row) else "" for row in rows]
        numbers = [number(text) for text in texts]
        missing = {text for text in texts if text in MISSING}
        there = sum(text not in missing for text in texts)
        known = 2 * sum(value is not None for value in numbers) > there > 0
        values = np.array([np.nan if value is None else value for value in numbers])
        found.append(
            SeenColumn(
                index, name, *_unit(table, index), values if known else None, texts, 0, False,
                tuple(sorted(missing)) if known else (),
            )
        )  # fmt: skip
    return found


def of_table(table: SourceTable) -> Iterator[SeenColumn]:
    """Yield the columns of a table that has types, those without rows left out.

    Raises:
        ConfigError: the file is damaged.
    """
    lengths = table.lengths if isinstance(table, ArrayTable) else None
    for index, name in enumerate(table.names):
        rows = lengths[index] if lengths else 0
        if lengths and not rows:
            continue
        values, texts = _values(table, index)
        moment = isinstance(table, HasMoments) and table.is_moment(index)
        yield SeenColumn(index, name, *_unit(table, index), values, texts, rows, moment)


def _values(
    table: SourceTable, index: int
) -> tuple[NDArray[np.float64] | NDArray[np.int64] | None, Sequence[str]]:
    kinds: list[Kind] = ["number", "text"]
    if table.is_whole(index):
        kinds.insert(0, "whole")
    for kind in kinds[:-1]:
        try:
            batch = next(table.batches({index: kind}))
        except ConfigError:  # another type, or no value in a row
            continue
        return np.array(batch.numbers[index][:SAMPLE_ROWS]), ()
    batch = next(table.batches({index: "text"}))
    return None, [str(text) for text in batch.texts[index][:SAMPLE_ROWS]]


def _unit(table: SourceTable, index: int) -> tuple[str, Unit | None]:
    stated = stated_unit(table, index)
    try:
        return stated, parse_file_unit(stated) if stated else None
    except ValueError:
        return stated, None
