"""``rigd remote procedures`` and ``dry-run``: lists procedures and plays them dry."""

from __future__ import annotations

import argparse
import math
import sys
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rigd.cli.remote.command import RemoteCommand, add_json, connect, print_json

if TYPE_CHECKING:
    from rigd.dry_run import PredictedPeak, StepRow
    from rigd.remote.protocol.results import DryRun


def _procedures(args: argparse.Namespace) -> int:
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    from rigd.cli.screen import print_table

    with connect(args) as rig:
        found = rig.procedures()
    if args.json:
        print_json(found.model_dump(mode="json"))
        return 0
    console = Console(highlight=False, width=None if sys.stdout.isatty() else 400)
    table = Table(box=None, pad_edge=False)
    for name in ("procedure", "title", "cannot run here because"):
        table.add_column(name, overflow="fold")
    for procedure in found.procedures:
        table.add_row(*map(escape, (procedure.name, procedure.title, procedure.problem or "")))
    print_table(console, table)
    return 0


def add_procedure(parser: argparse.ArgumentParser) -> None:
    """Add a procedure and the values it is to have."""
    parser.add_argument(
        "procedure", help="a file of this computer, or the name of a procedure the daemon has"
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="give a parameter of the procedure another value, with its unit",
    )


def values_of(args: argparse.Namespace) -> dict[str, str]:
    """Return what ``--set`` gives, by name."""
    from rigd.cli.assignments import read_assignments

    return read_assignments(args.set)


def _configure_dry_run(parser: argparse.ArgumentParser) -> None:
    add_procedure(parser)
    add_json(parser)


def _dry_run(args: argparse.Namespace) -> int:
    from rigd.cli.dry_run_view import dry_run_json, print_dry_run
    from rigd.model.errors import Exit

    with connect(args) as rig:
        played = _as_played(rig.dry_run(args.procedure, values_of(args)))
    if args.json:
        print_json(dry_run_json(played))
    else:
        print_dry_run(played)
    return int(Exit.BLOCKED if played.refusals else Exit.OK)


@dataclass(frozen=True)
class _PlayedElsewhere:
    """A dry run that was played elsewhere, as one played here is shown."""

    duration_s: float
    steps: tuple[StepRow, ...]
    peaks: tuple[PredictedPeak, ...]
    refusals: tuple[str, ...]


def _as_played(dry_run: DryRun) -> _PlayedElsewhere:
    from rigd.dry_run import PredictedPeak, StepRow

    def bound(value: float | None, missing: float) -> float:
        return missing if value is None else value

    return _PlayedElsewhere(
        dry_run.duration_s,
        tuple(StepRow(**dict(step)) for step in dry_run.steps),
        tuple(
            PredictedPeak(
                peak.channel,
                peak.unit,
                bound(peak.lowest, math.nan),
                bound(peak.highest, math.nan),
                bound(peak.low, -math.inf),
                bound(peak.high, math.inf),
                peak.limit_by,
            )
            for peak in dry_run.peaks
        ),
        dry_run.refusals,
    )


COMMANDS = {
    "procedures": RemoteCommand("list the procedures that a daemon has", _procedures, add_json),
    "dry-run": RemoteCommand(
        "play a procedure on the daemon's simulated plant; nothing moves",
        _dry_run,
        _configure_dry_run,
        """\
examples:
  rigd remote dry-run procedures/quick.yaml --rig lugre-1
  rigd remote dry-run constant_current --set floor=pvc      one that the daemon has
""",
    ),
}
