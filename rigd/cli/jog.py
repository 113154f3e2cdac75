"""``rigd jog``: moves a rig by hand under the same limits and interlocks as a procedure."""

from __future__ import annotations

import argparse
from pathlib import Path

HELP = "hold setpoints for a while by hand, then go to rest"
EXAMPLES = """\
examples:
  rigd jog wheel_servo.current=0.1A --for 2s --rig lugre-1
  rigd jog longitudinal_belt.speed=-50mm/s --for '1 s' --rig wire-1

It is recorded as any run is. Ctrl-C stops it. A setpoint changes no faster than its rate in the
rig file allows; beyond its limits the command is refused.
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument(
        "setpoints", nargs="+", metavar="SETPOINT=VALUE", help="device.setpoint and its value"
    )
    parser.add_argument("--rig", required=True, metavar="RIG", help="rig file, or the name in it")
    parser.add_argument(
        "--for", dest="duration", default="1 s", metavar="TIME", help="how long (default 1 s)"
    )
    parser.add_argument(
        "--runs", type=Path, default=Path("runs"), metavar="FOLDER", help="folder of recordings"
    )
    parser.add_argument("--json", action="store_true", help="print the result as JSON")
    parser.add_argument("--quiet", action="store_true", help="no progress")


def execute(args: argparse.Namespace) -> int:
    """Compile the movement as a procedure, and play it."""
    from rigd.cli.assignments import read_assignments
    from rigd.cli.playing import play
    from rigd.config.loader import load_rig
    from rigd.daemon.execute import RunRequest
    from rigd.model.errors import ConfigError
    from rigd.procedure.compile import compile_procedure
    from rigd.procedure.loader import parse_procedure
    from rigd.procedure.manual import jog_text

    rig = load_rig(args.rig)
    moves = read_assignments(args.setpoints, "SETPOINT=VALUE")
    text = jog_text(moves, args.duration)
    try:
        procedure = compile_procedure(parse_procedure(text, Path("jog")), rig, {})
    except ConfigError as error:
        for item in (error, *error.others):
            item.place = None  # in a text that the person never saw
        raise
    # A simulated rig too is moved at the pace of the wall: a person watches.
    request = RunRequest(procedure, text, rig, seed=1, pace=1.0, folder=args.runs)
    return play(request, as_json=args.json, quiet=args.quiet, by_person=False)
