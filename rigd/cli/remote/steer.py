"""``rigd remote pause``, ``stop`` and others: send a command to the run in progress."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import TYPE_CHECKING

from rigd.cli.options import add_json
from rigd.cli.remote.command import RemoteCommand, connect, find, print_json

if TYPE_CHECKING:
    from rigd.remote import Client


def _commanding(do: Callable[[Client, argparse.Namespace], str]) -> Callable[..., int]:
    """Return the command that executes ``do`` with the lease, and prints its result."""

    def execute(args: argparse.Namespace) -> int:
        with connect(args) as rig, rig.control(brief=True):
            result = do(rig, args)
        _print_result(args, result)
        return 0

    return execute


def _stopping(do: Callable[[Client, str], bool], verb: str) -> Callable[..., int]:
    """Return the command that stops; it needs no lease, so that nothing can block it.

    The stop is sent before anything is imported that it does not need.
    """

    def execute(args: argparse.Namespace) -> int:
        from rigd.remote.client.stopping import send_stop

        acted = send_stop(find(args), verb, args.reason)
        run, last = None, None
        if args.wait or not acted:
            with connect(args) as rig:
                if acted is None:
                    acted = do(rig, args.reason)
                run = rig.status().run
                last = rig.wait(run) if args.wait and run is not None else None
        if args.json:
            print_json({"acted": acted} | ({} if last is None else last.model_dump(mode="json")))
            return 0
        idle = "no run in progress" if run is None else f"{run} already has this request"
        print(f"{verb}: asked for" if acted else f"{verb}: {idle}")
        if last is not None:
            print(f"{last.run}: {last.ending}: {last.reason}")
        return 0

    return execute


def _print_result(args: argparse.Namespace, result: str) -> None:
    if args.json:
        print_json({"done": result})
    else:
        print(result)


def _pause(rig: Client, args: argparse.Namespace) -> str:
    status = rig.status()
    rig.pause()
    if status.can_hold:
        return f"step {status.step!r} is held"
    return "the run pauses at the next step that can be held, or after the present trial"


def _resume(rig: Client, args: argparse.Namespace) -> str:
    rig.resume()
    return "goes on"


def _acknowledge(rig: Client, args: argparse.Namespace) -> str:
    from rigd.cli.remote.look import clock

    trips = {trip.interlock: trip for trip in rig.status().trips}
    trip = trips.get(args.interlock)
    rig.acknowledge(args.interlock, None if trip is None else trip.since_ns)
    if trip is None:  # it tripped in between
        return f"{args.interlock} is acknowledged"
    return f"{args.interlock} is acknowledged: at {clock(trip.since_ns)}, {trip.message}"


def _act(rig: Client, args: argparse.Namespace) -> str:
    return rig.act(args.device, args.action) or f"{args.device}: {args.action} done"


def _answer(rig: Client, args: argparse.Namespace) -> str:
    from rigd.cli.remote.watching import as_prompt
    from rigd.engine.run.answers import read_answer
    from rigd.model.errors import ConfigError
    from rigd.remote.protocol import Code, Refusal

    view = rig.status().prompt
    if view is None or args.id not in (None, view.id):
        raise Refusal(Code.CONFLICT, "no such prompt waits for an answer", hint="see its status")
    try:
        value = read_answer(as_prompt(view), args.value)
    except ValueError as error:
        raise ConfigError(f"{view.text}: {error}") from error
    rig.answer(value, view.id)
    return f"{view.name}: {args.value}"


def _configure_answer(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("value", help="such as '1.2 kg', pvc, or yes")
    parser.add_argument("--id", type=int, metavar="N", help="only if this prompt waits")
    add_json(parser)


def _configure_interlock(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("interlock", help="its name, as `rigd remote status` shows it")
    add_json(parser)


def _configure_act(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("device")
    parser.add_argument("action", help="such as tare")
    add_json(parser)


def _configure_stop(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--reason", default="", metavar="TEXT", help="shown, and recorded")
    parser.add_argument("--wait", action="store_true", help="return after the run has ended")
    add_json(parser)


_STOP_NOTE = """\
Every client may stop a run; no lease is needed. In order of severity: stop, abort, estop.
A software stop is a request: the safety function is the hardware chain of the rig.
"""

COMMANDS = {
    "pause": RemoteCommand(
        "hold the step if it can be held, or pause after the trial", _commanding(_pause), add_json
    ),
    "resume": RemoteCommand("continue after a pause", _commanding(_resume), add_json),
    "answer": RemoteCommand(
        "answer the prompt that waits",
        _commanding(_answer),
        _configure_answer,
        """\
examples:
  rigd remote answer '1.2 kg'
  rigd remote answer yes
""",
    ),
    "ack": RemoteCommand(
        "acknowledge an interlock that has tripped: you have looked at the rig",
        _commanding(_acknowledge),
        _configure_interlock,
    ),
    "act": RemoteCommand(
        "perform an action of a device, such as a tare; for maintainers",
        _commanding(_act),
        _configure_act,
    ),
    "stop": RemoteCommand(
        "stop the run in order: setpoints to rest, then its `finish`",
        _stopping(lambda rig, reason: rig.stop(reason), "stop"),
        _configure_stop,
        _STOP_NOTE,
    ),
    "abort": RemoteCommand(
        "ramp to rest now, without `finish`",
        _stopping(lambda rig, reason: rig.abort(reason), "abort"),
        _configure_stop,
        _STOP_NOTE,
    ),
    "estop": RemoteCommand(
        "request the devices to drop power",
        _stopping(lambda rig, reason: rig.estop(reason), "estop"),
        _configure_stop,
        _STOP_NOTE,
    ),
}
