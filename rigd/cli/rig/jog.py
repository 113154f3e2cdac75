"""``rigd jog``: moves a rig by hand, as a procedure: limits, interlocks and recording apply."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from rigd.cli.options import (
    add_json,
    add_quiet,
    add_rig,
    add_runs,
    named_twice,
    read_assignments,
    rig_of,
)

if TYPE_CHECKING:
    from rigd.config.rig import RigConfig

HELP = "hold setpoints by hand for a time, then go to rest"
EXAMPLES = """\
examples:
  rigd jog wheel_servo.current=0.1A --for 2s --rig lugre-1
  rigd jog longitudinal_belt.speed=-50mm/s --for '1 s' --rig wire-1

The movement is recorded like any run. Ctrl-C stops it. A setpoint changes no faster than its rate
in the rig file allows; rigd refuses a value beyond its limits.
"""

#: Names that a user can give are channel names; other text could be YAML syntax.
_QUOTED = str.maketrans({"\\": "\\\\", '"': '\\"', "\n": " "})


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
    from rigd.model.machine.system import require_linux

    require_linux("`rigd jog`")
    from rigd.cli.rig.playing import play
    from rigd.config.loader import load_rig
    from rigd.config.problems import suggest
    from rigd.daemon.execute import RunRequest
    from rigd.model.errors import ConfigError
    from rigd.procedure.compile import compile_procedure
    from rigd.procedure.loader import parse_procedure

    rig = load_rig(rig_of(args))
    moves = read_assignments(args.setpoints, "SETPOINT=VALUE")
    if (twice := named_twice(args.setpoints)) is not None:
        raise ConfigError(
            f"{twice} is given two values", hint="hold one value; jog again for the next"
        )
    for name in moves:
        if rig.setpoint(rig.setpoint_name(name)) is None:
            raise ConfigError(
                f"the rig {rig.name} has no setpoint {name!r}", hint=suggest(name, rig.settable)
            )
    text = _procedure_text(moves, args.duration, rig)
    try:
        procedure = compile_procedure(parse_procedure(text, Path("jog")), rig, {})
    except ConfigError as error:
        for item in (error, *error.others):
            item.place = None  # an error in a text that the user has not written
        raise
    # A simulated rig also moves in real time: a person watches it.
    request = RunRequest(procedure, text, rig, seed=1, pace=1.0, folder=args.runs)
    return play(request, as_json=args.json, quiet=args.quiet, by_person=False)


def _procedure_text(setpoints: Mapping[str, str], duration: str, rig: RigConfig) -> str:
    """Return the procedure that holds ``setpoints`` for ``duration``, then goes to rest.

    Both are texts of the user: ``{"wheel_servo.current": "0.1 A"}``, ``"2 s"``. The usual check of
    a procedure finds their errors. The cycle has `after` before the time is over, so that it goes
    to rest in the next cycle, however late the daemon is.
    """
    moves = ", ".join(f"{_name(name)}: {_text(to)}" for name, to in setpoints.items())
    rests = ", ".join(f"{_name(name)}: {_text(rest)}" for name, rest in _rests(setpoints, rig))
    period_s = rig.period_ns * 1e-9
    return (
        "procedure: jog\ntitle: Moved by hand\ndoc: Holds setpoints for a while, then takes "
        "them to rest.\ntrial:\n  steps:\n    - step: jog\n"
        f"      set: {{{moves}}}\n      for: {_text(duration)}\n"
        f"  after:\n    - step: rest\n      set: {{{rests}}}\n      for: {period_s!r} s\n"
        "record: all\n"
    )


def _rests(names: Iterable[str], rig: RigConfig) -> Iterator[tuple[str, str]]:
    """Yield each of ``names`` that is a setpoint of ``rig``, with its rest in its unit."""
    for name in names:
        full = rig.setpoint_name(name)
        channel = rig.setpoint(full)
        if channel is not None:
            device, _, setpoint = full.partition(".")
            unit = "" if channel.unit == "1" else f" {channel.unit}"
            yield name, f"{rig.devices[device].limits[setpoint].rest!r}{unit}"


def _name(name: str) -> str:
    return f'"{name.translate(_QUOTED)}"'


def _text(value: str) -> str:
    return f'"{value.translate(_QUOTED)}"'
