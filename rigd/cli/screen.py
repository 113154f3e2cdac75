"""Tables and paragraphs that fit a narrow terminal."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

from rich.console import Console
from rich.measure import Measurement
from rich.padding import Padding
from rich.table import Table

#: Wider than any table; in columns.
_WIDEST = 10_000


def print_rows(console: Console, table: Table) -> None:
    """Print ``table``; in a terminal too narrow for it, its rows as paragraphs.

    The first cell of each row has a line, and so may be long; the others follow, indented.
    """
    least, _, gaps = _needs(console, table)
    if sum(least) + gaps <= console.width:
        print_table(console, table)
        return
    first, *others = table.columns
    for name, *texts in zip(
        (first.header, *first.cells),
        *((other.header, *other.cells) for other in others),
        strict=True,
    ):
        console.print(name, soft_wrap=True)
        console.print(Padding("  ".join(str(text) for text in texts if text), (0, 0, 0, 2)))


def print_table(console: Console, table: Table) -> None:
    """Print ``table`` with every word whole; it has no box and no widths of its own.

    Columns get the room of their longest word, and what the terminal has left over. If the longest
    words do not fit side by side, the terminal breaks the lines: no name is cut.
    """
    least, most, gaps = _needs(console, table)
    for column, width in zip(table.columns, shared(console.width - gaps, least, most), strict=True):
        column.width = width
    columns, console.width = console.width, _WIDEST
    console.print(table)
    console.width = columns


def _needs(console: Console, table: Table) -> tuple[list[int], list[int], int]:
    """Return the least and most width of each column, and what all gaps between them take."""
    options = console.options.update_width(_WIDEST)
    needs = [
        [Measurement.get(console, options, cell) for cell in (column.header, *column.cells)]
        for column in table.columns
    ]
    least = [max(cell.minimum for cell in cells) for cells in needs]
    most = [max(cell.maximum for cell in cells) for cells in needs]
    return least, most, Measurement.get(console, options, table).maximum - sum(most)


def shared(room: int, least: Sequence[int], most: Sequence[int]) -> list[int]:
    """Return a width for each column: at least ``least``, at most ``most``, within ``room``.

    What is left over goes to the columns that lack least first; ``room`` may be too small.
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
    """Return ``text`` broken between words; what goes on is indented further than its line."""
    return "\n".join(_wrapped(line, columns) for line in text.split("\n"))


def _wrapped(line: str, columns: int) -> str:
    if len(line) <= columns:
        return line
    begin = line[: len(line) - len(line.lstrip())]
    return textwrap.fill(
        line.strip(), columns, initial_indent=begin, subsequent_indent=begin and f"{begin}  ",
        break_long_words=False, break_on_hyphens=False,
    )  # fmt: skip
