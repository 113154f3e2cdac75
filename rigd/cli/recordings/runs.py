"""``rigd runs``: lists the recordings of a folder."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Collection, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Final

from rigd.cli.options import add_json, add_set, read_assignments

if TYPE_CHECKING:
    from rigd.catalogue import Condition, Listing

#: The condition of files of other programs, and what a person stated or decided: columns that
#: are shown if any recording has them.
_STATED: Final = ("condition", "set", "specimen", "verdict", "meta", "note")
#: Of a column; notes may be long.
_MOST_LETTERS: Final = 60
#: To read so many recordings takes long enough that progress is shown.
_MANY: Final = 1000

HELP = "list and search the recordings of a folder"
EXAMPLES = """\
examples:
  rigd runs
  rigd runs data/ --procedure constant_current --set floor=pvc
  rigd runs --state interrupted
  rigd runs --where 'specimen.coating == "PTFE" and started >= 2026-09-01'
  rigd runs --since 7d --meta batch=13
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
        help="only runs started with this --meta value, such as batch=13",
    )
    parser.add_argument(
        "--since",
        type=_since,
        metavar="DATE",
        help=(
            "only runs recorded since this date: 2026-11-01 (UTC), or 7d for the last seven days"
        ),
    )
    parser.add_argument(
        "--where",
        action="append",
        default=[],
        metavar="CONDITION",
        help="only runs for which this holds: specimen, verdict, started, parameter.current, "
        "meta.batch and others beside a text, a date, or a number with its unit; several "
        "--where must all hold",
    )
    add_json(parser, "print as JSON")


def execute(args: argparse.Namespace) -> int:
    """Print one line per recording."""
    from rigd.catalogue import search

    found = search(args.folder, _condition(args), _progress)
    if args.json:
        print(json.dumps([_json(args.folder, line) for line in found.lines], indent=2))
    elif found.lines:
        _print(args.folder, found.lines)
    for broken in found.broken:
        print(f"rigd: {broken.problem}", file=sys.stderr)
    if not found.lines and not args.json and (args.where or not found.broken):
        print(f"no recordings in {args.folder} match")
        for field, texts in found.stated.items():
            print(f"  {field} here: {', '.join(texts)}")
    return 0


def _condition(args: argparse.Namespace) -> Condition | None:
    """Return what all options ask for together."""
    from rigd.catalogue import all_of, equal, parse_where, since

    parts: list[Condition] = [
        equal(name, given)
        for name in ("procedure", "rig", "state")
        if (given := getattr(args, name)) is not None
    ]
    for group, texts in (("parameter", args.set), ("meta", args.meta)):
        given = read_assignments(texts)
        parts += [equal(f"{group}.{name}", text) for name, text in given.items()]
    if args.since is not None:
        parts.append(since(args.since.timestamp()))
    parts += [parse_where(text) for text in args.where]
    return all_of(parts) if parts else None


def _progress(number: int, total: int) -> None:
    """Show at a terminal how far the index of many recordings is."""
    if total >= _MANY and number % 100 == 0 and sys.stderr.isatty():
        print(f"\rreading {number} of {total} recordings ", end="", file=sys.stderr, flush=True)
    if total >= _MANY and number == total - 1 and sys.stderr.isatty():
        print("\r\x1b[K", end="", file=sys.stderr, flush=True)


def _json(folder: Path, line: Listing) -> dict[str, object]:
    from rigd.record import Recording, info_json

    about = info_json(Recording.open(folder / line.file).info)
    return {**about, "recorded": datetime.fromtimestamp(line.started, UTC).isoformat()}


def _print(folder: Path, lines: Sequence[Listing]) -> None:
    from rigd.cli.views.plain_table import plain_table
    from rigd.model.about import plain

    stated = [name for name in _STATED if any(getattr(line, name) for line in lines)]
    heads = ("recording", "recorded (UTC)", "procedure", "rig", "state", "trials", "s", "MB")
    numbers = range(5, 8)
    rows = [
        (
            str(folder / line.file),
            _date(line),
            line.procedure,
            line.rig,
            line.state,
            f"{line.trials}/{line.planned}",
            "" if line.duration_s is None else f"{line.duration_s:.0f}",
            f"{line.size / 1e6:.1f}",
            *(shorten(plain(getattr(line, name)), _MOST_LETTERS) for name in stated),
        )
        for line in lines
    ]
    rows = [tuple(map(plain, row)) for row in rows]
    text = plain_table((*heads, *stated), rows, numbers)
    if text is None:
        _print_folded((*heads, *stated), rows, numbers)
    else:
        print(text)


def _print_folded(
    heads: Sequence[str], rows: Sequence[Sequence[str]], numbers: Collection[int]
) -> None:
    """Print a table that is too wide for the terminal, or has letters of several columns."""
    from rich.markup import escape
    from rich.table import Table

    from rigd.cli.views.screen import open_console, print_rows

    table = Table(box=None, pad_edge=False)
    for number, name in enumerate(heads):
        if number in numbers:
            table.add_column(name, justify="right")
        else:
            table.add_column(name, overflow="fold")
    for row in rows:
        table.add_row(*map(escape, row))
    print_rows(open_console(), table)


def shorten(text: str, most: int) -> str:
    """Return a text of at most ``most`` letters; a longer one ends in ``…``."""
    return text if len(text) <= most else f"{text[: most - 1]}…"


def _date(line: Listing) -> str:
    """Return when a run was recorded, with ``~`` in front if only the file's date is known."""
    moment = datetime.fromtimestamp(line.started, UTC)
    return f"{'~' if line.started_of == 'file' else ''}{moment:%Y-%m-%d %H:%M}"


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
