"""Prints the result of an analysis at a terminal."""

from __future__ import annotations

import sys

from rich.console import Console
from rich.markup import escape
from rich.table import Table as RichTable

from rigd.analysis.terminal import TerminalReport, TerminalTable
from rigd.cli.screen import print_table, wrapped

#: Columns where the width of the terminal is not known.
WIDTH = 120


def print_terminal_report(shown: TerminalReport) -> None:
    """Print tables and paragraphs, an empty line between any two."""
    console = Console(highlight=False, width=None if sys.stdout.isatty() else WIDTH)
    for index, item in enumerate(shown):
        if index:
            console.print()
        if isinstance(item, TerminalTable):
            print_table(console, _rich(item))
        else:
            console.print(wrapped(item, console.width), markup=False, soft_wrap=True)


def _rich(table: TerminalTable) -> RichTable:
    drawn = RichTable(
        title=escape(table.title) or None, title_justify="left", box=None, pad_edge=False
    )
    for column in table.columns:
        drawn.add_column(escape(column.title), justify="right" if column.right else "left")
    for row in table.rows:
        drawn.add_row(*map(escape, row.cells), style="dim" if row.faint else "")
    return drawn
