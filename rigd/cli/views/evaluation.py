"""Prints the result of an analysis at a terminal."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Final

from rich.console import Console
from rich.markup import escape
from rich.table import Table as RichTable

from rigd.analysis.terminal import TerminalReport, TerminalTable
from rigd.cli.views.screen import print_table, wrapped

if TYPE_CHECKING:
    from rigd.analysis.analysis import Evaluation

#: Columns to use if the width of the terminal is unknown.
WIDTH = 120
#: Entries of a heading that the user has just typed, or does not need at a terminal.
LEFT_OUT: Final = frozenset({"Procedure", "Recording", "Recordings", "Report made"})


def print_evaluation(evaluation: Evaluation) -> None:
    """Print which results may be used, the source of the data, and the report for terminals."""
    opened: list[str] = []
    if evaluation.opening is not None:
        opened.append("\n".join(evaluation.opening.sentences))
    if evaluation.heading is not None:
        heading = evaluation.heading
        parts = [heading.badge] if heading.badge else []
        parts += [f"{name} {text}" for name, text in heading.entries if name not in LEFT_OUT]
        opened.append("; ".join(parts))
    print_terminal_report((*filter(None, opened), *evaluation.terminal_report()))


def print_terminal_report(shown: TerminalReport) -> None:
    """Print tables and paragraphs, an empty line between any two."""
    console = Console(highlight=False, width=None if sys.stdout.isatty() else WIDTH)
    for index, item in enumerate(shown):
        if index:
            console.print()
        if isinstance(item, TerminalTable):
            if item.title:  # a table would break it at its own width
                console.print(item.title, markup=False, soft_wrap=True, style="italic")
            print_table(console, _rich(item))
        else:
            console.print(wrapped(item, console.width), markup=False, soft_wrap=True)


def _rich(table: TerminalTable) -> RichTable:
    drawn = RichTable(box=None, pad_edge=False)
    for column in table.columns:
        drawn.add_column(escape(column.title), justify="right" if column.right else "left")
    for row in table.rows:
        drawn.add_row(*map(escape, row.cells), style="dim" if row.faint else "")
    return drawn
