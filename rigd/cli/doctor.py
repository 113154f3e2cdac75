"""``rigd doctor``: checks whether this machine and a rig are fit to run."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

HELP = "is this machine and this rig fit? measures both and says what to do"
EXAMPLES = """\
examples:
  rigd doctor                          the machine alone
  rigd doctor --rig wire-1             and every device of the rig: found, timed, zero, noise
  rigd doctor --rig wire-1 --json      for a script

With --rig every link and device is opened, and each drive is left without our heartbeat once, to
prove that it makes itself safe. Nothing is armed and nothing moves. Let the rig stand still.

exit code: 0 fit (warnings or not), 3 something fails
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("--rig", metavar="RIG", help="rig file, or the name in it")
    parser.add_argument(
        "--seconds",
        type=_seconds,
        default=10.0,
        metavar="N",
        help="length of each measurement (default 10)",
    )
    parser.add_argument(
        "--runs", type=Path, default=Path("runs"), metavar="FOLDER", help="folder of recordings"
    )
    parser.add_argument("--json", action="store_true", help="print the result as JSON")


def execute(args: argparse.Namespace) -> int:
    """Examine; print every check as it is made."""
    from rich.console import Console

    from rigd.cli.checkup_view import CheckupView, as_json
    from rigd.config.loader import load_rig
    from rigd.daemon.doctor import Check, Examination, examine, is_fit
    from rigd.model.errors import Exit

    rig = None if args.rig is None else load_rig(args.rig)
    checks: list[Check] = []
    view = CheckupView(Console(highlight=False))

    def tell(check: Check) -> None:
        checks.append(check)
        if not args.json:
            view.show(check)

    if not args.json:
        view.begin(rig, args.seconds)
    whole = examine(Examination(rig, args.seconds, args.runs), tell)
    if args.json:
        print(json.dumps(as_json(checks, whole=whole), indent=2))
    elif whole:
        view.conclude(checks)
    if not whole:
        print("rigd: interrupted, not everything was looked at", file=sys.stderr)
        return int(Exit.STOPPED)
    return int(Exit.OK if is_fit(checks) else Exit.BLOCKED)


def _seconds(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if 0.5 <= value <= 3600:
        return value
    raise argparse.ArgumentTypeError(f"{text!r} is no number of seconds from 0.5 to 3600")
