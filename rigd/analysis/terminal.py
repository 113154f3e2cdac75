"""Defines the tables and paragraphs that an evaluation shows in a terminal, as plain data.

The program that prints them chooses their appearance.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Column:
    """A column of a table; numbers stand at the right."""

    title: str
    right: bool = False


@dataclass(frozen=True)
class TableRow:
    """The cells of a row, as text; a faint row holds no known value."""

    cells: tuple[str, ...]
    faint: bool = False


@dataclass(frozen=True)
class TerminalTable:
    """Columns and rows, with an optional title."""

    columns: tuple[Column, ...]
    rows: tuple[TableRow, ...]
    title: str = ""


#: Tables and paragraphs, from top to bottom. A paragraph may have several lines.
TerminalReport = tuple[TerminalTable | str, ...]
