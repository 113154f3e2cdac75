"""``rigd jog``: moves a rig by hand under the same limits and interlocks as a procedure."""

from __future__ import annotations

import argparse
from pathlib import Path

from rigd.cli.options import add_json, add_quiet, add_rig, add_runs, read_assignments

HELP = "hold setpoints by hand for a time, then go to rest"
EXAMPLES = """\
examples:
  rigd jog wheel_servo.current=0.1A --for 2s --rig lugre-1
  rigd jog longitudinal_belt.speed=-50mm/s --for '1 s' --rig wire-1

The movement is recorded like any run. Ctrl-C stops it. A setpoint changes no faster than its rate
in the rig file allows; rigd refuses a value beyond its limits.
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument(
        "setpoints", nargs="+", metavar="SETPOINT=VALUE", help="device.setpoint and its value"
    )
    add_rig(parser)
    parser.add_argument(
        "--for", dest="duration", default="1 s", metavar="TIME", help="duration (default 1 s)"
    )
    add_runs(parser)
    add_json(parser)
    add_quiet(parser)


def execute(args: argparse.Namespace) -> int:
    """Compile the movement as a procedure, and play it."""
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
            item.place = None  # an error in a text that the user has not written
        raise
    # A simulated rig also moves in real time: a person watches it.
    request = RunRequest(procedure, text, rig, seed=1, pace=1.0, folder=args.runs)
    return play(request, as_json=args.json, quiet=args.quiet, by_person=False)
