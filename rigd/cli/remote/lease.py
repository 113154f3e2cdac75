"""``rigd remote lease``: shows, takes and releases the lease (the right to command a rig)."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import TYPE_CHECKING

from rigd.cli.options import add_json
from rigd.cli.remote.command import RemoteCommand, connect, print_json
from rigd.model.errors import ConfigError, Exit

if TYPE_CHECKING:
    from rigd.remote import Client
    from rigd.remote.protocol import LeaseView

#: The actions on the lease, with their help.
_DO = ("show", "take", "request", "give", "release", "seize")


def _configure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("do", nargs="?", choices=_DO, default="show", help="(default: show)")
    parser.add_argument("to", nargs="?", metavar="NAME", help="identity that gets the lease")
    add_json(parser)


def _execute(args: argparse.Namespace) -> int:
    if (args.do == "give") != (args.to is not None):
        missing = args.do == "give"
        problem = "the new holder is missing" if missing else f"{args.do} takes no name"
        raise ConfigError(problem, hint="rigd remote lease give NAME")
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
            print(_in_words(view, rig.status().t_ns))  # this computer's clock may differ
    return 0


def _await(rig: Client, view: LeaseView) -> int:
    """Wait until the holder hands the lease over, then hold it."""
    from rigd.remote.protocol import ClientUser

    print(f"{view.holder} sees the request for a minute; Ctrl-C stops waiting", flush=True)
    asked = False
    try:
        for status in rig.watch():
            lease = status.lease
            if lease.holder is None or lease.is_held_by(rig.identity):
                return _hold(rig, rig.lease_take)
            was_asked, asked = asked, ClientUser.of(rig.identity) in lease.asked_by
            if was_asked and not asked:
                print(f"{lease.holder} has not handed it over")
                return int(Exit.BLOCKED)
    except KeyboardInterrupt:
        print("no longer waiting")
    return 0


def _hold(rig: Client, take: Callable[[], LeaseView]) -> int:
    """Hold the lease until Ctrl-C, or until another client gets it; show requests for it."""
    shown = ""
    view = take()
    print(f"{rig.identity} has control of {rig.rig} until Ctrl-C gives it back", flush=True)
    try:
        for status in rig.watch():
            view = status.lease
            if not (view.holder is None or view.is_held_by(rig.identity)):
                print(f"{view.holder} has control now")
                return 0
            asking = ", ".join(map(str, view.asked_by))
            if asking and asking != shown:
                print(f"{asking} requests it: rigd remote lease give NAME", flush=True)
            shown = asking
    except KeyboardInterrupt:
        rig.lease_release()
        print("given back")
    return 0


def _in_words(view: LeaseView, now_ns: int) -> str:
    if view.holder is None:
        return "no client has control"
    left_s = max(view.until_ns - now_ns, 0) * 1e-9
    lines = [f"{view.holder} has control, for another {left_s:.1f} s unless it is renewed"]
    return "\n".join([*lines, *(f"  {item} requests it" for item in view.asked_by)])


COMMANDS = {
    "lease": RemoteCommand(
        "show which client has control, take it, request it, or hand it over",
        _execute,
        _configure,
        """\
examples:
  rigd remote lease                  the client that has control
  rigd remote lease request          ask its holder for it, wait, and hold it until Ctrl-C
  rigd remote lease give bob         hand over what you hold, here or in another terminal
  rigd remote lease take             hold it until Ctrl-C
  rigd remote lease seize            the same, taken from another; for maintainers

Commands take the lease by themselves for as long as they need it. While you hold it, other clients
cannot command the rig. A lease that is not renewed for six seconds is lost; the run in progress
then follows `on_client_loss` of its procedure.
""",
    )
}
