"""Prints the result of a dry run (a procedure played on a simulated plant), or returns JSON.

The printed result is a set of tables.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from rigd.config.sibling.differences import Difference
from rigd.dry_run import Physics, PredictedPeak, StepRow
from rigd.model.units import parse_unit

LEAST_WIDTH = 120


class DryRunFigures(Protocol):
    """The figures of a dry run to print; the dry run was played here or by a daemon."""

    @property
    def duration_s(self) -> float:
        """Duration in s, in the time of the rig."""

    @property
    def steps(self) -> Sequence[StepRow]:
        """The steps in the order of play."""

    @property
    def peaks(self) -> Sequence[PredictedPeak]:
        """The peak of every limited channel."""

    @property
    def refusals(self) -> Sequence[str]:
        """The reasons why the procedure must not run."""

    @property
    def physics(self) -> Physics:
        """What the figures come from."""

    @property
    def sibling(self) -> str:
        """The sibling that was played; "" without."""

    @property
    def differences(self) -> Sequence[Difference]:
        """What differs between the files of rig and sibling."""

    @property
    def notes(self) -> Sequence[str]:
        """What a reader must know of this dry run, in sentences."""

    @property
    def known_s(self) -> float | None:
        """Without physics, the time of the steps with a known duration, in s."""


def print_dry_run(dry_run: DryRunFigures) -> None:
    """Print the step table, the duration, the peaks beside their limits, and the verdict."""
    # Names of channels must stay whole: below this width the terminal wraps, not the table.
    console = Console(highlight=False)
    console = Console(highlight=False, width=max(console.width, LEAST_WIDTH))
    if dry_run.physics == "sibling":
        console.print(f"played on the plant of the sibling {escape(dry_run.sibling)}\n")
    elif dry_run.physics == "none":
        console.print("[yellow]without physics[/]: no peak is known\n")
    console.print(_steps(dry_run))
    if dry_run.known_s is None:
        console.print(f"estimated duration: [bold]{dry_run.duration_s:.1f} s[/] of rig time\n")
        console.print(_peaks(dry_run))
    else:
        console.print(
            f"duration: [bold]{dry_run.known_s:.1f} s[/] known, and at most "
            f"[bold]{dry_run.duration_s:.1f} s[/] if every end condition waits for its timeout\n"
        )
    if dry_run.differences:
        console.print(_differences(dry_run))
        console.print(
            "plant, channels, their ranges and their pace were those of the sibling; limits, "
            "rates, interlocks, cycle and constants those of the rig file\n"
        )
    for note in dry_run.notes:
        console.print(f"note: {escape(note)}", soft_wrap=True)
    if dry_run.refusals:
        console.print("[red]refused[/]: preflight would block this run, or the run would fail")
        for line in dry_run.refusals:
            console.print(f"  {escape(line)}", soft_wrap=True)
    elif dry_run.physics == "none":
        console.print(
            "[yellow]not refused[/]: names, units and setpoints fit the rig; name a simulated "
            "`sibling` in the rig file to predict peaks",
            soft_wrap=True,
        )
    else:
        console.print("[green]fit to run[/]: every predicted peak is inside its limit")


def _differences(dry_run: DryRunFigures) -> Table:
    title = "differences of the two files"
    table = Table(title=title, title_justify="left", box=None, pad_edge=False)
    table.add_column("what")
    table.add_column("rig file")
    table.add_column("sibling")
    for item in dry_run.differences:
        table.add_row(*map(escape, (item.what, item.here, item.there)))
    return table


def _steps(dry_run: DryRunFigures) -> Table:
    table = Table(title="steps", title_justify="left", box=None, pad_edge=False)
    table.add_column("block")
    table.add_column("step")
    table.add_column("setpoints")
    table.add_column("ends when")
    table.add_column("played", justify="right")
    table.add_column("seconds", justify="right")
    for row in dry_run.steps:
        spread = f"{row.shortest_s:.2f}"
        if row.timing == "at_most":
            spread = f"at most {row.longest_s:.2f}"
        elif row.longest_s - row.shortest_s >= 0.005:
            spread += f" .. {row.longest_s:.2f}"
        texts = (
            row.block,
            row.name,
            "\n".join(row.setpoints),
            "\n".join(row.ends),
            str(row.played),
            spread,
        )
        table.add_row(*map(escape, texts))
    return table


def _peaks(dry_run: DryRunFigures) -> Table:
    table = Table(title="predicted peaks", title_justify="left", box=None, pad_edge=False)
    table.add_column("channel", no_wrap=True)
    for name in ("lowest", "highest", "limits"):
        table.add_column(name, justify="right")
    table.add_column("unit")
    table.add_column("set by")
    for peak in dry_run.peaks:
        unit = parse_unit(peak.display or peak.unit)
        low, high, least, most = map(unit.from_si, (peak.low, peak.high, peak.lowest, peak.highest))
        style = "" if peak.inside else "red"
        table.add_row(
            escape(peak.channel),
            f"{least:.4g}",
            f"{most:.4g}",
            f"{_bound(low)} .. {_bound(high)}",
            unit.symbol,
            escape(peak.limit_by),
            style=style,
        )
    return table


def _bound(value: float) -> str:
    return "" if math.isinf(value) else f"{value:.4g}"


def dry_run_json(dry_run: DryRunFigures) -> dict[str, object]:
    """Return the dry run as an object for ``json.dumps``; open bounds are null."""

    def finite(value: float) -> float | None:
        return value if math.isfinite(value) else None

    return {
        "physics": dry_run.physics,
        "sibling": dry_run.sibling or None,
        "duration_s": dry_run.duration_s,
        "known_s": dry_run.duration_s if dry_run.known_s is None else dry_run.known_s,
        "fit": not dry_run.refusals,
        "refusals": list(dry_run.refusals),
        "steps": [vars(row) for row in dry_run.steps],
        "peaks": [
            {
                "channel": peak.channel,
                "unit": peak.unit,
                "lowest": finite(peak.lowest),
                "highest": finite(peak.highest),
                "low": finite(peak.low),
                "high": finite(peak.high),
                "limit_by": peak.limit_by,
                "inside": peak.inside,
            }
            for peak in dry_run.peaks
        ],
        "differences": [vars(item) for item in dry_run.differences],
        "notes": list(dry_run.notes),
    }
