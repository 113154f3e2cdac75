"""``rigd remote procedures`` and ``dry-run``: list a rig's procedures, play one on its model."""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rigd.cli.options import add_json, add_set, read_assignments
from rigd.cli.remote.command import RemoteCommand, connect, print_json

if TYPE_CHECKING:
    from rigd.config.sibling.differences import Difference
    from rigd.dry_run import Physics, PredictedPeak, StepRow
    from rigd.remote.protocol.results import DryRun


def _procedures(args: argparse.Namespace) -> int:
    from rich.markup import escape

    from rigd.cli.views.screen import folding_table, open_console, print_table

    with connect(args) as rig:
        found = rig.procedures()
    if args.json:
        print_json(found.model_dump(mode="json"))
        return 0
    console = open_console()
    table = folding_table("procedure", "title", "cannot run here because")
    for procedure in found.procedures:
        table.add_row(*map(escape, (procedure.name, procedure.title, procedure.problem or "")))
    print_table(console, table)
    return 0


def add_procedure(parser: argparse.ArgumentParser) -> None:
    """Add a procedure and values for its parameters."""
    parser.add_argument(
        "procedure", help="a file on this computer, or the name of a procedure of the daemon"
    )
    add_set(parser)


def values_of(args: argparse.Namespace) -> dict[str, str]:
    """Return the values of ``--set``, by name."""
    return read_assignments(args.set)


def _configure_dry_run(parser: argparse.ArgumentParser) -> None:
    add_procedure(parser)
    add_json(parser)


def _dry_run(args: argparse.Namespace) -> int:
    from rigd.cli.views.dry_run import dry_run_json, print_dry_run
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
    """Shows a dry run of a daemon in the same form as a local one."""

    duration_s: float
    steps: tuple[StepRow, ...]
    peaks: tuple[PredictedPeak, ...]
    refusals: tuple[str, ...]
    physics: Physics
    sibling: str
    differences: tuple[Difference, ...]
    notes: tuple[str, ...]
    known_s: float | None


def _as_played(dry_run: DryRun) -> _PlayedElsewhere:
    from rigd.config.sibling.differences import Difference
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
                peak.display,
            )
            for peak in dry_run.peaks
        ),
        dry_run.refusals,
        dry_run.physics,
        dry_run.sibling,
        tuple(Difference(**dict(item)) for item in dry_run.differences),
        dry_run.notes,
        dry_run.known_s,
    )


COMMANDS = {
    "procedures": RemoteCommand("list the procedures that a daemon has", _procedures, add_json),
    "dry-run": RemoteCommand(
        "play a procedure on a simulated plant: of the rig, or of its sibling; nothing moves",
        _dry_run,
        _configure_dry_run,
        """\
examples:
  rigd remote dry-run procedures/mine.yaml --rig lugre-1
  rigd remote dry-run constant_current --set floor=pvc      a procedure of the daemon
""",
    ),
}
