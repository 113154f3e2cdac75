"""Prints tables and paragraphs so that they fit a narrow terminal."""

from __future__ import annotations

import sys
import textwrap
from collections.abc import Sequence

from rich.console import Console, JustifyMethod, RenderableType
from rich.measure import Measurement
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

#: Wider than any table; in columns.
_WIDEST = 10_000


def open_console() -> Console:
    """Return the console of standard output; in a pipe each line stays one line."""
    return Console(highlight=False, width=None if sys.stdout.isatty() else 400)


def folding_table(*columns: str) -> Table:
    """Return a table without a box whose cells fold; a heading stands if a column has one."""
    table = Table(box=None, pad_edge=False, show_header=any(columns))
    for column in columns:
        table.add_column(column, overflow="fold")
    return table


def print_rows(console: Console, table: Table) -> None:
    """Print ``table``; if the terminal is too narrow, print its rows as paragraphs.

    The first cell of each row gets its own line, and so may be long; the others follow, indented
    and in columns, as far as these fit.
    """
    least, _, gaps = _needs(console, table)
    if sum(least) + gaps <= console.width:
        print_table(console, table)
        return
    first, *others = (
        [Text.from_markup(str(cell)) for cell in (column.header, *column.cells)]
        for column in table.columns
    )
    for column, cells in zip(table.columns[1:], others, strict=True):
        _align(cells, column.justify)
    for name, *cells in zip(first, *others, strict=True):
        console.print(name, soft_wrap=True)
        line = Text("  ").join(cells)
        line.rstrip()
        console.print(Padding(line, (0, 0, 0, 2)))


def _align(cells: Sequence[Text], justify: JustifyMethod) -> None:
    """Pad the cells of a column to one width."""
    width = max(cell.cell_len for cell in cells)
    for cell in cells:
        if justify == "right":
            cell.pad_left(width - cell.cell_len)
        else:
            cell.pad_right(width - cell.cell_len)


def print_table(console: Console, table: Table) -> None:
    """Print ``table`` without a box and without cutting words.

    Each column gets the width of its longest word, and a share of the space that is left. If the
    longest words do not fit side by side, the terminal wraps the lines: no name is cut.
    """
    least, most, gaps = _needs(console, table)
    for column, width in zip(table.columns, shared(console.width - gaps, least, most), strict=True):
        column.width = width
    columns, console.width = console.width, _WIDEST
    console.print(table)
    console.width = columns


def _needs(console: Console, table: Table) -> tuple[list[int], list[int], int]:
    """Return the least and most width of each column, and the width of all gaps together."""
    options = console.options.update_width(_WIDEST)
    needs = [
        [Measurement.get(console, options, cell) for cell in (column.header, *column.cells)]
        for column in table.columns
    ]
    least = [
        max(
            cell.minimum + _indent(text)
            for cell, text in zip(cells, (column.header, *column.cells), strict=True)
        )
        for cells, column in zip(needs, table.columns, strict=True)
    ]
    most = [max(cell.maximum for cell in cells) for cells in needs]
    return least, most, Measurement.get(console, options, table).maximum - sum(most)


def _indent(text: RenderableType) -> int:
    """Return the number of spaces before the first word; a line needs them beside the word."""
    return len(text) - len(text.lstrip()) if isinstance(text, str) else 0


def shared(room: int, least: Sequence[int], most: Sequence[int]) -> list[int]:
    """Return a width for each column: at least ``least``, at most ``most``, together ``room``.

    Space that is left goes first to the columns that lack least; ``room`` may be too small.
    """
    widths = list(least)
    left = max(room - sum(least), 0)
    wanting = sorted(range(len(widths)), key=lambda index: most[index] - least[index])
    for place, index in enumerate(wanting):
        more = min(most[index] - least[index], left // (len(wanting) - place))
        widths[index] += more
        left -= more
    return widths


def wrapped(text: str, columns: int) -> str:
    """Return ``text`` wrapped between words; continuation lines are indented further."""
    return "\n".join(_wrapped(line, columns) for line in text.split("\n"))


def _wrapped(line: str, columns: int) -> str:
    if len(line) <= columns:
        return line
    begin = line[: len(line) - len(line.lstrip())]
    return textwrap.fill(
        line.strip(), columns, initial_indent=begin, subsequent_indent=begin and f"{begin}  ",
        break_long_words=False, break_on_hyphens=False,
    )  # fmt: skip
