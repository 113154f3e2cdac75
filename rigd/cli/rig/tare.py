"""``rigd tare``: performs an action of one device, such as tare; arms nothing."""

from __future__ import annotations

import argparse
import json
import sys

from rigd.cli.options import add_json, add_rig, rig_of

HELP = "tare or zero a device, or perform another of its actions; nothing moves"
EXAMPLES = """\
examples:
  rigd tare scale --rig wire-1
  rigd tare scale --action zero --rig wire-1

The command opens only this device. `rigd drivers` lists the actions of each driver.
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("device", metavar="DEVICE", help="the device, as the rig file names it")
    add_rig(parser)
    parser.add_argument(
        "--action", default="tare", metavar="NAME", help="the action (default tare)"
    )
    add_json(parser)


def execute(args: argparse.Namespace) -> int:
    """Open the device, perform the action, print the device's reply and its new reading."""
    from rigd.model.machine.system import require_linux

    require_linux("`rigd tare`")
    from rigd.cli.views.readings import in_words
    from rigd.config.loader import load_rig
    from rigd.config.shipped_files import titled
    from rigd.daemon.manual import Newest, check_action, only, open_unarmed
    from rigd.daemon.signals import handle_signals
    from rigd.engine.play.control import Control
    from rigd.model.errors import Blocked, Exit

    rig = load_rig(rig_of(args))
    print(f"rig {titled(rig.name, rig.source.location)}", file=sys.stderr)
    name, action = args.device, args.action
    check_action(rig, name, action)
    rig = only(rig, {name})
    newest = Newest(rig)
    control = Control()
    command = f"rigd tare {name}"
    with handle_signals(control), open_unarmed(rig, control, command=command) as look:
        look.on_rows = newest.take
        reasons = look.open()
        if reasons:
            raise Blocked(reasons, f"{name} cannot be opened")
        look.first_rows()
        reply = look.act(name, action)
        if reply is None:
            return int(Exit.STOPPED)
        look.next_row(name)
        readings = list(newest.readings(look.t_ns))
    if args.json:
        values = {
            reading.channel: {"value": reading.value, "unit": reading.unit} for reading in readings
        }
        print(json.dumps({"device": name, "action": action, "reply": reply, "channels": values}))
    else:
        print(f"{name}: {reply}")
        for reading in readings:
            print(f"  {reading.channel} is now {' '.join(in_words(reading))}")
    return int(Exit.OK)
