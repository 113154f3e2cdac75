"""``rigd runs``: the recordings of a folder."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

HELP = "list the recordings of a folder"
EXAMPLES = """\
examples:
  rigd runs
  rigd runs data/ --procedure constant_current --set floor=pvc
  rigd runs --state interrupted
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument(
        "folder", nargs="?", type=Path, default=Path("runs"), help="folder (default: runs)"
    )
    parser.add_argument("--procedure", metavar="NAME", help="only runs of this procedure")
    parser.add_argument("--rig", metavar="NAME", help="only runs on this rig")
    parser.add_argument(
        "--state", metavar="STATE", help="only runs that ended so: complete, stopped, interrupted"
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="only runs with this value of a parameter",
    )
    parser.add_argument("--json", action="store_true", help="print as JSON")


def execute(args: argparse.Namespace) -> int:
    """Print one line per recording."""
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    from rigd.cli.run import split_assignment
    from rigd.record import Filters, info_json, list_runs

    wanted = dict(split_assignment(one) for one in args.set)
    catalogue = list_runs(args.folder, Filters(args.procedure, args.rig, args.state, wanted))
    if args.json:
        print(json.dumps([info_json(info) for info in catalogue.runs], indent=2))
        return 0
    # Piped, a line is a line: nothing folds.
    console = Console(highlight=False, width=None if sys.stdout.isatty() else 400)
    table = Table(box=None, pad_edge=False)
    for name in ("recording", "procedure", "rig", "state"):
        table.add_column(name, overflow="fold")
    for name in ("trials", "s", "MB"):
        table.add_column(name, justify="right")
    table.add_column("set", overflow="fold")
    for info in catalogue.runs:
        total = info.metadata.get("run", {}).get("trials", "?")
        texts = (
            str(info.path),
            info.procedure,
            info.rig,
            info.state,
            f"{info.trials_done}/{total}",
            f"{info.duration_s:.0f}",
            f"{info.size / 1e6:.1f}",
            ", ".join(
                f"{name}={value}" for name, value in info.metadata.get("overrides", {}).items()
            ),
        )
        table.add_row(*map(escape, texts))
    console.print(table)
    for broken in catalogue.broken:
        console.print(f"[red]{escape(str(broken.problem))}[/]", soft_wrap=True)
    if not catalogue.runs and not catalogue.broken:
        console.print(f"no recordings in {escape(str(args.folder))} match")
    return 0
