"""``rigd doctor``: checks whether this machine and a rig are fit to run."""

from __future__ import annotations

import argparse
import json
import sys

from rigd.cli.options import add_json, add_rig, add_runs

HELP = "check whether this machine and a rig are fit to run; measures both and prints remedies"
EXAMPLES = """\
examples:
  rigd doctor                          the machine alone
  rigd doctor --rig wire-1             and every device of the rig: found, timed, zero, noise
  rigd doctor --rig wire-1 --json      for a script

With --rig every link and device is opened, and the heartbeat to each drive stops once, to prove
that the drive makes itself safe. Nothing is armed and nothing moves. Keep the rig at rest.

exit code: 0 fit (warnings or not), 3 something fails
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    add_rig(parser)
    parser.add_argument(
        "--seconds",
        type=_seconds,
        default=10.0,
        metavar="N",
        help="length of each measurement (default 10)",
    )
    add_runs(parser)
    add_json(parser)


def execute(args: argparse.Namespace) -> int:
    """Examine the machine and the rig; print every check when it is made."""
    from rigd.model.machine.system import require_linux

    require_linux("`rigd doctor`")
    from rich.console import Console

    from rigd.cli.views.checkup import CheckupView, as_json
    from rigd.config.loader import load_rig
    from rigd.daemon.doctor import Check, Examination, examine, is_fit
    from rigd.model.errors import Exit

    rig = None if args.rig is None else load_rig(args.rig)
    checks: list[Check] = []
    view = CheckupView(Console(highlight=False))

    def print_check(check: Check) -> None:
        checks.append(check)
        if not args.json:
            view.show(check)

    if not args.json:
        view.begin(rig, args.seconds)
    whole = examine(Examination(rig, args.seconds, args.runs), print_check)
    if args.json:
        print(json.dumps(as_json(checks, whole=whole), indent=2))
    elif whole:
        view.conclude(checks)
    if not whole:
        print("rigd: interrupted, some checks are missing", file=sys.stderr)
        return int(Exit.STOPPED)
    return int(Exit.OK if is_fit(checks) else Exit.BLOCKED)


def _seconds(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if 0.5 <= value <= 3600:
        return value
    raise argparse.ArgumentTypeError(f"{text!r} is not a number of seconds from 0.5 to 3600")
