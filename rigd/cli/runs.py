"""``rigd runs``: lists the recordings of a folder."""

from __future__ import annotations

import argparse
import json
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING

from rigd.cli.options import add_json, add_set, read_assignments

if TYPE_CHECKING:
    from rigd.record import RunInfo

HELP = "list the recordings of a folder"
EXAMPLES = """\
examples:
  rigd runs
  rigd runs data/ --procedure constant_current --set floor=pvc
  rigd runs --state interrupted
  rigd runs --since 7d --meta specimen=W7
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument(
        "folder", nargs="?", type=Path, default=Path("runs"), help="folder (default: runs)"
    )
    parser.add_argument("--procedure", metavar="NAME", help="only runs of this procedure")
    parser.add_argument("--rig", metavar="NAME", help="only runs on this rig")
    parser.add_argument(
        "--state",
        metavar="STATE",
        help=("only runs that ended in this state: complete, stopped, interrupted"),
    )
    add_set(parser, "only runs with this value of a parameter")
    parser.add_argument(
        "--meta",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="only runs started with this --meta value, such as specimen=W7",
    )
    parser.add_argument(
        "--since",
        type=_since,
        metavar="DATE",
        help=(
            "only runs recorded since this date: 2026-11-01 (UTC), or 7d for the last seven days"
        ),
    )
    add_json(parser, "print as JSON")


def execute(args: argparse.Namespace) -> int:
    """Print one line per recording."""
    from rich.markup import escape
    from rich.table import Table

    from rigd.cli.screen import open_console, print_rows
    from rigd.model.about import plain
    from rigd.record import RunFilter, info_json, list_runs

    wanted = read_assignments(args.set)
    meta = read_assignments(args.meta)
    filters = RunFilter(args.procedure, args.rig, args.state, wanted, meta, args.since)
    catalogue = list_runs(args.folder, filters)
    if args.json:
        print(json.dumps([info_json(info) for info in catalogue.runs], indent=2))
        return 0
    console = open_console()
    table = Table(box=None, pad_edge=False)
    for name in ("recording", "recorded (UTC)", "procedure", "rig", "state"):
        table.add_column(name, overflow="fold")
    for name in ("trials", "s", "MB"):
        table.add_column(name, justify="right")
    assigned = {
        heading: name
        for heading, name in (("set", "overrides"), ("meta", "meta"))
        if any(info.metadata.get(name) for info in catalogue.runs)
    }
    for heading in assigned:
        table.add_column(heading, overflow="fold")
    for info in catalogue.runs:
        total = info.metadata.get("run", {}).get("trials", "?")
        texts = (
            str(info.path),
            _date(info),
            info.procedure,
            info.rig,
            info.state,
            f"{info.trials_done}/{total}",
            f"{info.duration_s:.0f}",
            f"{info.size / 1e6:.1f}",
            *(_assigned(info, name) for name in assigned.values()),
        )
        table.add_row(*(escape(plain(text)) for text in texts))
    print_rows(console, table)
    for broken in catalogue.broken:
        console.print(f"[red]{escape(str(broken.problem))}[/]", soft_wrap=True)
    if not catalogue.runs and not catalogue.broken:
        console.print(f"no recordings in {escape(str(args.folder))} match")
    return 0


def _date(info: RunInfo) -> str:
    """Return when a run was recorded, with ``~`` in front if only the file's date is known."""
    from rigd.record.moment import recorded_at

    moment = recorded_at(info)
    return f"{'~' if moment.of == 'file' else ''}{moment.at:%Y-%m-%d %H:%M}"


def _assigned(info: RunInfo, name: str) -> str:
    return ", ".join(f"{key}={value}" for key, value in info.metadata.get(name, {}).items())


def _since(text: str) -> datetime:
    days = text.strip().removesuffix("d")
    if days.isdecimal() and text.strip().endswith("d") and int(days) <= 36500:
        return datetime.now(UTC) - timedelta(days=int(days))
    try:
        moment = datetime.fromisoformat(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(
            f"{text!r} is neither a date such as 2026-11-01 nor a number of days such as 7d"
        ) from error
    return moment if moment.tzinfo else moment.replace(tzinfo=UTC)
