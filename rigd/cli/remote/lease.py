"""``rigd remote lease``: shows, takes and releases the control lease."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from rigd.cli.remote.command import RemoteCommand, add_json, connect, print_json
from rigd.model.errors import ConfigError, Exit

if TYPE_CHECKING:
    from rigd.remote import Client
    from rigd.remote.protocol import LeaseView

#: What can be done with it, and in which words.
_DO = ("show", "take", "request", "give", "release", "seize")


def _configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("do", nargs="?", choices=_DO, default="show", help="(default: show)")
    parser.add_argument("to", nargs="?", metavar="NAME", help="whom to give it to")
    add_json(parser)


def _execute(args: argparse.Namespace) -> int:
    if (args.do == "give") != (args.to is not None):
        raise ConfigError("whom to give it to?" if args.do == "give" else f"{args.do} names nobody",
                          hint="rigd remote lease give NAME")  # fmt: skip
    with connect(args) as rig:
        match args.do:
            case "show":
                view = rig.lease()
            case "request":
                view = rig.lease_request()
                if not args.json:
                    return _await(rig, view)
            case "give":
                view = rig.lease_give(args.to)
            case "release":
                view = rig.lease_release()
            case "take":
                return _hold(rig, rig.lease_take)
            case _:
                return _hold(rig, rig.lease_seize)
    if args.json:
        print_json(view.model_dump(mode="json"))
    else:
        print(_in_words(view))
    return 0


def _await(rig: Client, view: LeaseView) -> int:
    """Wait until the lease is handed over, and hold it; who is not there then would lose it."""
    print(f"{view.holder} is asked, and shown it for a minute; Ctrl-C waits no longer", flush=True)
    asked = False
    try:
        for status in rig.watch():
            lease = status.lease
            if lease.holder in (rig.identity, None):
                return _hold(rig, rig.lease_take)
            if asked and rig.identity not in lease.asked_by:
                print(f"{lease.holder} has not handed it over")
                return int(Exit.BLOCKED)
            asked = rig.identity in lease.asked_by
    except KeyboardInterrupt:
        print("no longer waiting")
    return 0


def _hold(rig: Client, take: Callable[[], LeaseView]) -> int:
    """Hold the lease until Ctrl-C, or until it is another's; show who asks for it."""
    told = ""
    view = take()
    print(f"{rig.identity} has control of {rig.rig} until Ctrl-C gives it back", flush=True)
    try:
        for status in rig.watch():
            view = status.lease
            if view.holder not in (rig.identity, None):
                print(f"{view.holder} has control now")
                return 0
            asking = ", ".join(view.asked_by)
            if asking and asking != told:
                print(f"{asking} asks for it: rigd remote lease give NAME", flush=True)
            told = asking
    except KeyboardInterrupt:
        rig.lease_release()
        print("given back")
    return 0


def _in_words(view: LeaseView) -> str:
    if view.holder is None:
        return "nobody has control"
    left_s = max(view.until_ns - time.time_ns(), 0) * 1e-9
    lines = [f"{view.holder} has control, for another {left_s:.1f} s unless it is renewed"]
    return "\n".join([*lines, *(f"  {name} asks for it" for name in view.asked_by)])


COMMANDS = {
    "lease": RemoteCommand(
        "show who has control, take it, ask for it, or hand it over",
        _execute,
        _configure,
        """\
examples:
  rigd remote lease                  who has control
  rigd remote lease request          ask whoever has it, wait for it, and hold it until Ctrl-C
  rigd remote lease give bob         hand over what you hold, here or in another terminal
  rigd remote lease take             hold it until Ctrl-C
  rigd remote lease seize            the same, taken from another; for maintainers

Commands take it by themselves for as long as they need it; to hold it keeps others from
commanding meanwhile. A lease that is not renewed for six seconds is lost, and the run under way
does what its procedure says of a client that vanishes.
""",
    )
}
