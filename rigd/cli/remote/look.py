"""``rigd remote status`` and ``rigd remote events``: print the state and the events of a rig."""

from __future__ import annotations

import argparse
from datetime import datetime
from typing import TYPE_CHECKING, Final

from rigd.cli.options import add_json, add_quiet
from rigd.cli.remote.command import (
    RemoteCommand,
    again,
    connect,
    connect_async,
    print_json,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

    from pydantic import JsonValue

    from rigd.remote.protocol import RigEvent, Status

#: Keys that are no details of an event.
_EMPTY: Final[tuple[JsonValue, ...]] = (None, "", [], {})


def _configure_status(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--watch", action="store_true", help="follow the run in progress to its end"
    )
    add_quiet(parser)
    add_json(parser)


def _status(args: argparse.Namespace) -> int:
    from rigd.remote.protocol import as_json

    if args.watch:
        return _watch(args)
    with connect(args) as rig:
        status = rig.status()
    if args.json:
        print_json(as_json(status))
    else:
        _print(status, again(args))
    return 0


def _watch(args: argparse.Namespace) -> int:
    import asyncio

    from rigd.cli.remote.watching import watch
    from rigd.model.errors import ConfigError

    async def follow() -> int:
        async with connect_async(args) as rig:
            status = await rig.status()
            if status.run is None:
                raise ConfigError("no run in progress: nothing to watch")
            return await watch(rig, status.run, args, steers=False)

    return asyncio.run(follow())


def _print(status: Status, target_options: str) -> None:
    from rich.console import Console
    from rich.markup import escape

    from rigd.cli.asking import invitation
    from rigd.cli.remote.watching import as_prompt

    console = Console(highlight=False, soft_wrap=True)

    def write(text: str, style: str = "") -> None:
        console.print(escape(text), style=style)

    write(f"{status.rig}: {status.state.replace('_', ' ')}  ({status.title})", "bold")
    if status.run is not None:
        write(f"  {status.procedure}, recording {status.run}")
        left = "" if status.left_s is None else f", {_duration(status.left_s)} left"
        step = f", step {status.step}" if status.step else ""
        write(
            f"  {status.trials_done} of {status.trials_total} trials done in "
            f"{_duration(status.run_s)}{left}{step}"
        )
        if status.pause_in_s is not None:
            write(f"  pauses in {_duration(status.pause_in_s)} at the latest")
        if status.waits:
            write(f"  {status.waits}")
        if status.coming_to_rest:
            write(f"  {status.ending}, coming to rest: rows are recorded on")
    if status.prompt is not None:
        write(f"  a prompt waits for an answer: {status.prompt.text}", "yellow")
        write(
            f"    rigd remote answer VALUE{target_options}  "
            f"({invitation(as_prompt(status.prompt))})"
        )
    if status.lease.holder is not None:
        write(f"  control: {status.lease.holder}")
    for name in status.lease.asked_by:
        write(f"    {name} requests control")
    for trip in status.trips:
        ack = f"rigd remote ack {trip.interlock}{target_options}"
        done = "acknowledged" if trip.acknowledged else ack
        at = f"  {clock(trip.since_ns)} {trip.interlock} acted ({trip.action})"
        write(f"{at}: {trip.message}; {done}", "red")
    for item in status.interrupted:
        write(f"  interrupted: {item.run}, {item.trials_done} of {item.trials_total} trials")
        write(f"    rigd remote resume-run {item.run}{target_options}")
    if status.last is not None:
        write(f"  last run: {status.last.run}, {status.last.ending}: {status.last.reason}")
    daemon = status.daemon
    if daemon.accept_pauses or 2 * daemon.descriptors > daemon.descriptors_most > 0:
        write(
            f"  {daemon.descriptors} of {daemon.descriptors_most} descriptors in use; "
            f"{daemon.unauthenticated_ended} unauthenticated connections ended, "
            f"new ones refused for a while {daemon.accept_pauses} times",
            "yellow",
        )
    for held in status.certificates:
        end, over = day(held.until_ns), held.until_ns <= status.t_ns
        write(
            f"  certificate of the {held.whose}, {held.name}: {'expired' if over else 'expires'} "
            f"on {end}",
            "red" if over else "yellow",
        )
    for notice in status.notices[-5:]:
        write(f"  {clock(notice.t_ns)} {notice.text}", "" if notice.level == "info" else "yellow")


def _configure_events(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--since", type=int, default=0, metavar="N", help="only events with a number from N on"
    )
    parser.add_argument(
        "--follow", action="store_true", help="also print new events as they happen"
    )
    add_json(parser, "print a line of JSON for each event")


def _events(args: argparse.Namespace) -> int:
    with connect(args) as rig:
        events = rig.watch_events(args.since) if args.follow else rig.events(args.since).events
        try:
            for event in events:
                print(event.model_dump_json() if args.json else _line(event), flush=True)
        except KeyboardInterrupt:
            if not args.follow:
                raise  # following ends only in this way
    return 0


def _line(event: RigEvent) -> str:
    trial = "" if event.trial < 0 else f"trial {event.trial}"
    details = _details(event.data)
    line = f"{event.seq:6d}  {clock(event.t_ns)}  {event.kind:12s} {trial:9s} {details}".rstrip()
    # An event contains text of a client: it must not begin a line or control the terminal.
    return "".join(item if item.isprintable() else " " for item in line)


def _details(data: Mapping[str, JsonValue]) -> str:
    """Return the details of an event: its name first, without empty values."""
    if data.keys() == {"who", "verb", "args"}:
        return f"{data['who']}: {data['verb']} {_plain(data['args'])}".rstrip()
    units = data.get("units")
    parts: list[str] = []
    for name, value in data.items():
        if name == "units" or value in _EMPTY:
            continue
        if name == "name":
            parts.insert(0, _plain(value))
        elif name == "parameters" and isinstance(value, dict) and isinstance(units, dict):
            shown = (f"{item} {_in_unit(of, units.get(item))}" for item, of in value.items())
            parts.append(", ".join(shown))
        else:
            parts.append(f"{name.replace('_', ' ')} {_plain(value)}")
    return "; ".join(parts) or ", ".join(data)


def _in_unit(value: JsonValue, unit: JsonValue) -> str:
    """Return a parameter, in SI, as a quantity in its unit; a word as it is."""
    from rigd.model.units import format_quantity

    if isinstance(value, bool) or not isinstance(value, int | float) or not isinstance(unit, str):
        return _plain(value)
    return format_quantity(value, unit)


def _plain(value: JsonValue) -> str:
    match value:
        case bool():
            return "yes" if value else "no"
        case float():
            return f"{value:.6g}"
        case list():
            return ", ".join(map(_plain, value))
        case dict():
            kept = ((name, item) for name, item in value.items() if name != "sha256")
            return ", ".join(f"{name} {_plain(item)}" for name, item in kept if item not in _EMPTY)
    return str(value)


def clock(t_ns: int) -> str:
    """Return the time of day here."""
    return datetime.fromtimestamp(t_ns * 1e-9).strftime("%H:%M:%S")


def day(t_ns: int) -> str:
    """Return the date here."""
    return datetime.fromtimestamp(t_ns * 1e-9).strftime("%Y-%m-%d")


def _duration(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    return f"{rest} s" if minutes == 0 else f"{minutes} min {rest} s"


COMMANDS = {
    "status": RemoteCommand(
        "show the state of a rig",
        _status,
        _configure_status,
        """\
examples:
  rigd remote status --rig lugre-1
  rigd remote status --watch       progress to the end; exits as the run did
""",
    ),
    "events": RemoteCommand(
        "show the events of a rig, the newest last",
        _events,
        _configure_events,
        """\
examples:
  rigd remote events --follow
  rigd remote events --since 120 --json
""",
    ),
}
