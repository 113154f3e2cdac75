"""Defines what every format gives: a table whose columns are read batch by batch."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Literal, Protocol, runtime_checkable

from numpy.typing import NDArray

from rigd.config.problems import suggest
from rigd.model.errors import ConfigError, Place
from rigd.model.units import Unit, parse_unit

#: How a column is read: as float64, as int64 (times in ns), or as an Arrow array of texts.
Kind = Literal["number", "whole", "text"]
_WITH_UNIT: Final = re.compile(r"(?P<name>.*?)\s*(?P<sign>[\[(])(?P<unit>[^\[\]()]*)[\])]\s*")
#: What stands between the factors of a unit for others: ``N.m``, ``N⋅m``, ``N-m``.
_JOINED: Final = re.compile(r"(?<=[A-Za-z])[.⋅-](?=[A-Za-z])")
#: A torque without the blank: ``Nm``, ``mNm``, ``kNm``, ``Ncm``, ``Nmm``, ``kgfm``.
_TORQUE: Final = re.compile(r"\b((?:[numkM]?N)|kgf|gf)([cm]?m)\b")


@dataclass(frozen=True, eq=False)
class Batch:
    """Some rows of a table: ``first`` is the number of the first one, from 0.

    ``numbers`` are (rows,) of float64 or int64 by the position of their column, ``texts`` Arrow
    arrays.
    """

    first: int
    rows: int
    numbers: Mapping[int, NDArray[Any]]
    texts: Mapping[int, Any] = field(default_factory=dict)


class SourceTable(Protocol):
    """A table in a file of another program."""

    @property
    def path(self) -> Path:
        """The file."""

    @property
    def names(self) -> Sequence[str]:
        """The names of the columns, as the file has them."""

    @property
    def start_ns(self) -> int | None:
        """When a time of 0 was, in ns since 1970, if the file states it."""

    def unit(self, column: int) -> str:
        """Return the unit that the file states apart from the name; "" if it states none."""

    def is_whole(self, column: int) -> bool:
        """Return whether a column has whole numbers, as far as its type or first row shows."""

    def place(self, column: int, row: int | None = None) -> Place:
        """Return the place of a cell, or without a row that of the column's name."""

    def batches(self, wanted: Mapping[int, Kind]) -> Iterator[Batch]:
        """Yield all rows of the ``wanted`` columns, in order.

        Raises:
            ConfigError: a cell cannot be read, or the file is empty or cut off.
        """


@runtime_checkable
class HasMoments(Protocol):
    """A table whose format has a type for moments."""

    def is_moment(self, column: int) -> bool:
        """Return whether a column has moments: its zero is 1970, whatever the map states."""


def find_column(table: SourceTable, name: str, place: Place) -> int:
    """Return the position of the column that a map names at ``place``.

    The whole name counts first, then the name without its unit, then a number from 1.

    Raises:
        ConfigError: there is none, or several.
    """
    bare = [split_unit(item)[0] for item in table.names]
    for names in (list(table.names), bare):
        found = [index for index, item in enumerate(names) if item == name]
        if len(found) > 1:
            raise ConfigError(
                f"{table.path} has {len(found)} columns {name!r}", place=place,
                hint=f"give the number of one: {', '.join(str(index + 1) for index in found)}",
            )  # fmt: skip
        if found:
            return found[0]
    if name.isdecimal() and 1 <= int(name) <= len(bare):
        return int(name) - 1
    if name in getattr(table, "without_cells", ()):
        raise ConfigError(
            f"the column {name!r} has a name and no cells: rows have {len(bare)}",
            place=table.place(0, 0),
        )
    raise ConfigError(
        f"{table.path} has no column {name!r}", place=place, hint=suggest(name, table.names)
    )


def split_unit(name: str) -> tuple[str, str]:
    """Return the parts of ``Force [kN]``: the name, and the unit or ""."""
    match = _WITH_UNIT.fullmatch(name)
    # `Force (1)` is the second column of a name for many programs, not one without a unit.
    if match is None or (match["sign"] == "(" and match["unit"].strip().isdecimal()):
        return name, ""
    return match["name"], match["unit"].strip()


def parse_file_unit(text: str) -> Unit:
    """Return the unit that a file states: also ``N.m``, ``Nm``, and letters that only look alike.

    Raises:
        ValueError: unknown unit.
    """
    try:
        return parse_unit(text)
    except ValueError:
        pass  # as others may write it
    plain = " ".join(unicodedata.normalize("NFKC", text).split())
    plain = _TORQUE.sub(r"\1 \2", _JOINED.sub(" ", plain))
    return parse_unit(plain)


def stated_unit(table: SourceTable, column: int) -> str:
    """Return the unit that a file states for a column, "" if it states none.

    One that rigd knows counts first, that of the format before that in the name.
    """
    texts = [table.unit(column).strip(), split_unit(table.names[column])[1]]
    return next((text for text in texts if text and _is_known(text)), texts[0] or texts[1])


def _is_known(text: str) -> bool:
    try:
        parse_file_unit(text)
    except ValueError:
        return False
    return True


def unit_of(table: SourceTable, column: int, given: Unit | None, place: Place) -> Unit:
    """Return the unit of a column: that of the map, which must not contradict the file.

    Raises:
        ConfigError: neither states one, or they differ.
    """
    stated = stated_unit(table, column)
    name = table.names[column]
    if given is None:
        if not stated:
            raise ConfigError(
                f"{table.path} states no unit of the column {name!r}", place=place,
                hint="add `unit:` to it in the map; `unit: 1` if it has none",
            )  # fmt: skip
        try:
            return parse_file_unit(stated)
        except ValueError as error:
            raise ConfigError(
                f"{table.path} states the unit {stated!r} of the column {name!r}: {error}",
                place=place,
                hint="add `unit:` to it in the map; `unit: 1` if it has none",
            ) from error
    own = parse_file_unit(stated) if _is_known(stated) and stated else given
    if (own.dimension, own.factor, own.offset) != (given.dimension, given.factor, given.offset):
        raise ConfigError(
            f"the file states {stated} as the unit of {name!r}, the map {given} ({place})",
            place=table.place(column),
            hint="leave `unit:` out of the map to take that of the file; if the file is wrong, "
            "correct it there",
        )
    return given
