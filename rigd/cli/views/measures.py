"""Prints measures: what they are, each trial, and the results with their verdicts."""

from __future__ import annotations

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from rigd.analysis.measures import MeasureResult
from rigd.analysis.measures.view import MeasuresView, view_of
from rigd.cli.views.screen import open_console, print_rows, wrapped

_COLOURS = {"accepted": "green", "rejected": "red", "not decided": "yellow"}


def print_measures(result: MeasureResult) -> None:
    """Print ``result`` to standard output."""
    console, view = open_console(), view_of(result)
    for name, text in view.about:
        console.print(f"{escape(name)}: {escape(text)}", soft_wrap=True)
    _print_trials(console, view)
    _print_results(console, view)
    for remark in view.remarks:
        console.print(escape(wrapped(remark, max(console.width, 60))), soft_wrap=True)
    if view.verdict:
        console.print(f"[{_COLOURS[view.verdict]}]{view.verdict}[/]")
    if view.unread:
        console.print(f"[red]{escape(view.unread)}[/]")


def _print_trials(console: Console, view: MeasuresView) -> None:
    table = Table(box=None, pad_edge=False)
    swept = any(row.setpoints for row in view.trials)
    table.add_column("trial", justify="right")
    if swept:
        table.add_column("setpoints", overflow="fold")
    for heading in view.headings:
        table.add_column(escape(heading), justify="right")
    for row in view.trials:
        cells = [row.trial, *([row.setpoints] if swept else []), *row.cells]
        table.add_row(*map(escape, cells))
    console.print()
    print_rows(console, table)


def _print_results(console: Console, view: MeasuresView) -> None:
    table = Table(box=None, pad_edge=False)
    swept = any(line.setpoints for line in view.lines)
    judged = any(line.verdict for line in view.lines)
    table.add_column("measure", overflow="fold")
    if swept:
        table.add_column("setpoints", overflow="fold")
    for heading in ("trials", "mean", "s", "95 % interval"):
        table.add_column(heading, justify="right")
    if judged:
        table.add_column("must be")
        table.add_column("verdict")
    table.add_column("", overflow="fold")
    for line in view.lines:
        cells = [line.name, *([line.setpoints] if swept else []), line.count, line.mean, line.std]
        texts = [*map(escape, [*cells, line.interval])]
        if judged:
            colour = _COLOURS.get(line.verdict)
            verdict = f"[{colour}]{line.verdict}[/]" if colour else ""
            texts += [escape(line.accept), verdict]
        table.add_row(*texts, escape(line.why))
    console.print()
    print_rows(console, table)
    console.print()
