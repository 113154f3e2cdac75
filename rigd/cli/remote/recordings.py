"""``rigd remote runs``, ``fetch`` and ``report``: list, copy and report recordings of a daemon."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING

from rigd.cli.options import add_json, add_quiet
from rigd.cli.remote.command import RemoteCommand, again, connect, print_json

if TYPE_CHECKING:
    from rigd.remote.protocol.results import RunList


def _configure_runs(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--limit", type=_count, default=20, metavar="N", help="how many (20)")
    parser.add_argument("--before", metavar="RUN", help="only recordings older than this")
    parser.add_argument(
        "--where",
        action="append",
        default=[],
        metavar="CONDITION",
        help="only recordings for which this holds, as in `rigd runs`: specimen == W7; several "
        "--where must all hold",
    )
    add_json(parser)


def _runs(args: argparse.Namespace) -> int:
    with connect(args) as rig:
        several = len(args.where) > 1  # one stays as it is, so that errors name its places
        where = " and ".join(f"({text})" if several else text for text in args.where)
        found = rig.runs(args.limit, args.before, where)
    if args.json:
        print_json(found.model_dump(mode="json"))
    else:
        _print(found, where, again(args))
    return 0


def _print(found: RunList, where: str, again: str) -> None:
    from rich.markup import escape
    from rich.table import Table

    from rigd.cli.views.screen import open_console, print_table

    console = open_console()
    if not found.runs:
        console.print("no recordings match" if where else "no recordings yet")
        return
    table = Table(box=None, pad_edge=False)
    for name in ("recording", "procedure", "state", "began (UTC)"):
        table.add_column(name, overflow="fold")
    for name in ("trials", "s", "MB"):
        table.add_column(name, justify="right")
    table.add_column("report")
    for run in found.runs:
        began = datetime.fromtimestamp(run.started_ns * 1e-9, UTC).strftime("%Y-%m-%d %H:%M")
        texts = (
            run.run,
            run.procedure,
            run.problem or ", ".join(filter(None, (run.condition, run.state))),
            began if run.started_ns else "",
            f"{run.trials_done}/{run.trials_total}",
            "" if run.duration_s is None else f"{run.duration_s:.0f}",
            f"{run.size / 1e6:.1f}",
            "yes" if run.has_report else "",
        )
        table.add_row(*map(escape, texts))
    print_table(console, table)
    if found.more:
        asked = f" --where {quote(where)}" if where else ""
        older = f"rigd remote runs --before {found.runs[-1].run}{asked}{again}"
        console.print(escape(f"for older recordings:  {older}"), soft_wrap=True)


def _configure_fetch(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("run", metavar="RUN", help="name of a recording, as `runs` lists it")
    parser.add_argument(
        "--to",
        type=Path,
        default=Path(),
        metavar="FOLDER",
        help="folder for the file (default: here)",
    )
    add_quiet(parser)
    add_json(parser)


def _fetch(args: argparse.Namespace) -> int:
    with connect(args) as rig, _progress(args) as progress:
        path = rig.fetch(args.run, args.to, progress)
    _print_path(args, path)
    return 0


def _configure_report(parser: argparse.ArgumentParser) -> None:
    _configure_fetch(parser)
    parser.add_argument(
        "--identification", action="store_true", help="the report of the last identification"
    )
    parser.add_argument(
        "--make",
        action="store_true",
        help=("identify first, then fetch the new report; may take minutes"),
    )


def _report(args: argparse.Namespace) -> int:
    with connect(args) as rig, _progress(args) as progress:
        identified = args.identification or args.make
        if args.make:
            identified = rig.run(args.run).line.identifies
            if identified:
                with rig.control(brief=True):
                    rig.identify(args.run)
            else:
                note = f"{args.run} has no analysis in its procedure: this is the page of the run"
                print(note, file=sys.stderr)
        if identified:
            path = rig.report(args.run, args.to, progress, page="identification")
        else:
            rig.draw(args.run)
            path = rig.report(args.run, args.to, progress, page="run")
    _print_path(args, path)
    return 0


def _count(text: str) -> int:
    if text.isdecimal() and int(text) > 0:
        return int(text)
    raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from 1 on")


@contextmanager
def _progress(args: argparse.Namespace) -> Iterator[Callable[[int, int], None]]:
    """Show a progress bar during a transfer, on a terminal."""
    from rich.console import Console
    from rich.progress import BarColumn, DownloadColumn, Progress, TransferSpeedColumn

    console = Console(stderr=True)
    hidden = args.quiet or args.json or not console.is_terminal
    columns = (BarColumn(bar_width=24), DownloadColumn(), TransferSpeedColumn())
    with Progress(*columns, console=console, disable=hidden) as bar:
        task = bar.add_task(args.run, total=None)
        yield lambda done, size: bar.update(task, completed=done, total=size)


def _print_path(args: argparse.Namespace, path: Path) -> None:
    if args.json:
        print_json({"path": str(path), "size": path.stat().st_size})
    else:
        print(path)


COMMANDS = {
    "runs": RemoteCommand(
        "list the recordings of a daemon, the newest first",
        _runs,
        _configure_runs,
        """\
examples:
  rigd remote runs --where 'specimen == W7 and started > 2026-09-01'
""",
    ),
    "fetch": RemoteCommand(
        "fetch a recording",
        _fetch,
        _configure_fetch,
        """\
examples:
  rigd remote fetch lugre-1_quick_20261121T080000.mcap --to data/

A broken transfer continues at the same byte. The complete file is checked against its SHA-256
before it gets its name.
""",
    ),
    "report": RemoteCommand(
        "fetch a recording as a page, or the report of its analysis",
        _report,
        _configure_report,
        """\
examples:
  rigd remote report RUN             the recording as a page, drawn by the daemon
  rigd remote report RUN --make      the daemon identifies, then the report is fetched
""",
    ),
}
