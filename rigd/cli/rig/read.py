"""``rigd read``: prints the newest value of each channel; arms and records nothing."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING

from rigd.cli.options import add_json, add_rig, rig_of

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rigd.daemon.manual import UnarmedSession

HELP = "show the present value of each channel; nothing is armed, nothing moves"
EXAMPLES = """\
examples:
  rigd read --rig wire-1                           all channels, until Ctrl-C
  rigd read --rig wire-1 scale carriage.position   only these devices are opened
  rigd read --rig wire-1 --once --json             one object for a script
  rigd read --rig wire-1 --for 10s --json          one object per line, each second

On a terminal a table that is refreshed, elsewhere a line per channel each second. Interlocks are
evaluated and shown, but stop nothing: nothing is armed.
"""

#: Period of refreshing a table on a terminal, and of writing lines elsewhere; in s.
TERMINAL_S, LINES_S = 0.25, 1.0
#: Delay before the first output, so that interlocks active at rest are included; in s.
FIRST_LOOK_S = 0.1


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument(
        "channels", nargs="*", metavar="CHANNEL", help="device.channel, or a device (default: all)"
    )
    add_rig(parser)
    length = parser.add_mutually_exclusive_group()
    length.add_argument(
        "--for",
        dest="duration",
        metavar="TIME",
        help="duration, such as 5s (default: until Ctrl-C)",
    )
    length.add_argument("--once", action="store_true", help="show every channel once, then end")
    add_json(parser, "one JSON object per line")


def execute(args: argparse.Namespace) -> int:
    """Open the requested devices, show them, and leave them safe."""
    from rigd.model.machine.system import require_linux

    require_linux("`rigd read`")
    from rigd.cli.views.readings import view_for
    from rigd.config.loader import load_rig
    from rigd.config.shipped_files import titled
    from rigd.daemon.manual import Newest, chosen_channels, only, open_unarmed
    from rigd.daemon.signals import handle_signals
    from rigd.engine.play.control import Control
    from rigd.model.errors import Blocked, Exit

    rig = load_rig(rig_of(args))
    print(f"rig {titled(rig.name, rig.source.location)}", file=sys.stderr)
    seconds = None if args.duration is None else _seconds(args.duration)
    channels = chosen_channels(rig, args.channels)
    if args.channels:
        rig = only(rig, {channel.partition(".")[0] for channel in channels})
    newest = Newest(rig, channels)
    control = Control()
    with handle_signals(control), open_unarmed(rig, control, command="rigd read") as look:
        look.on_rows = newest.take
        reasons = look.open()
        if reasons:
            raise Blocked(reasons, f"rig {rig.name} cannot be read")
        look.first_rows()
        with view_for(as_json=args.json, refresh=not args.once) as view:
            every_s = TERMINAL_S if view.on_terminal else LINES_S
            for _ in _moments(look, 0.0 if args.once else seconds, every_s):
                view.show(look.t_ns, list(newest.readings(look.t_ns)), look.active_interlocks())
    return int(Exit.OK)


def _moments(look: UnarmedSession, seconds: float | None, every_s: float) -> Iterator[None]:
    """Yield at once, then every ``every_s`` until ``seconds`` are over or the user interrupts."""
    end_ns = None if seconds is None else look.t_ns + round(seconds * 1e9)
    look.rest(FIRST_LOOK_S)
    while not look.stopped:
        yield
        left_s = every_s if end_ns is None else min(every_s, (end_ns - look.t_ns) * 1e-9)
        if left_s <= 0:
            return
        look.rest(left_s)


def _seconds(text: str) -> float:
    """Return a duration that the user has typed, in s.

    Raises:
        ConfigError: it is not a duration.
    """
    from rigd.model.errors import ConfigError
    from rigd.model.units import parse_quantity, parse_unit

    try:
        quantity = parse_quantity(text)
    except ValueError as error:
        raise ConfigError(f"--for {text}: {error}") from error
    if not quantity.unit.same_kind(parse_unit("s")) or quantity.value <= 0:
        raise ConfigError(f"--for {text}: expected a time above 0, such as '5 s'")
    return quantity.value
