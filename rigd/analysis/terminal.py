"""What an evaluation shows in a terminal, as plain data: a program may print it as it likes."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Column:
    """A column of a table; numbers stand at the right."""

    title: str
    right: bool = False


@dataclass(frozen=True)
class Row:
    """The cells of a row, as text; a faint one holds nothing that is known."""

    cells: tuple[str, ...]
    faint: bool = False


@dataclass(frozen=True)
class TerminalTable:
    """Columns and rows, under a title where it has one."""

    columns: tuple[Column, ...]
    rows: tuple[Row, ...]
    title: str = ""


#: Tables and paragraphs, from top to bottom. A paragraph may have several lines.
TerminalReport = tuple[TerminalTable | str, ...]
