"""Prints readings: at a terminal a table that refreshes, elsewhere lines or JSON."""

from __future__ import annotations

import json
import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from contextlib import AbstractContextManager
from datetime import UTC, datetime
from typing import Self

from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from rigd.daemon.manual import Reading
from rigd.engine.play.interlocks import Trip
from rigd.model.units import parse_unit

#: Colours of the states of a reading.
_COLOUR = {"ok": "green", "stale": "yellow", "NaN": "red", "no row": "red"}


class ReadingsView(AbstractContextManager["ReadingsView"], ABC):
    """The output for readings; ``on_terminal`` is true for a terminal."""

    on_terminal = False

    @abstractmethod
    def show(self, t_ns: int, readings: Sequence[Reading], active: Sequence[Trip]) -> None:
        """Show channels and interlocks at ``t_ns`` (Unix)."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """Restore the screen."""


def view_for(*, as_json: bool, refresh: bool) -> ReadingsView:
    """Return the view for the kind of standard output; ``refresh``: several tables are shown."""
    if as_json:
        return JsonView()
    console = Console(highlight=False)
    if not refresh:
        return TableView(console)
    return LiveView(console) if console.is_terminal else LineView()


class TableView(ReadingsView):
    """Prints a table."""

    def __init__(self, console: Console) -> None:
        self._console = console

    def show(self, t_ns: int, readings: Sequence[Reading], active: Sequence[Trip]) -> None:
        """Print the present table."""
        self._console.print(picture(readings, active))


class LiveView(ReadingsView):
    """A table that overwrites the previous one."""

    on_terminal = True

    def __init__(self, console: Console) -> None:
        self._live = Live(console=console, auto_refresh=False)

    def __enter__(self) -> Self:
        self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Leave the last table on the screen."""
        self._live.stop()

    def show(self, t_ns: int, readings: Sequence[Reading], active: Sequence[Trip]) -> None:
        """Draw the table again."""
        self._live.update(picture(readings, active), refresh=True)


class LineView(ReadingsView):
    """A line per channel, and per interlock that is tripped or latched."""

    def show(self, t_ns: int, readings: Sequence[Reading], active: Sequence[Trip]) -> None:
        """Print the present lines, each with its time."""
        now = iso_time(t_ns)
        for reading in readings:
            print(
                now,
                reading.channel,
                *in_words(reading),
                age(reading.age_s),
                state(reading),
            )
        for trip in active:
            print(now, interlock_line(trip))
        print(end="", flush=True)


class JsonView(ReadingsView):
    """Prints one JSON object per line."""

    def show(self, t_ns: int, readings: Sequence[Reading], active: Sequence[Trip]) -> None:
        """Print the present object; a value that is not finite is null."""
        channels = {
            reading.channel: {
                "value": reading.value if math.isfinite(reading.value) else None,
                "unit": reading.unit,
                "age_s": round(reading.age_s, 6) if math.isfinite(reading.age_s) else None,
                "state": reading.state,
                "status": reading.status,
            }
            for reading in readings
        }
        interlocks = [
            {
                "name": trip.interlock.name,
                "action": trip.interlock.action.word,
                "reason": trip.reason,
                "message": trip.message,
            }
            for trip in active
        ]
        line = {"time": iso_time(t_ns), "channels": channels, "interlocks": interlocks}
        print(json.dumps(line), flush=True)


def picture(readings: Sequence[Reading], active: Sequence[Trip]) -> Group:
    """Return the table of all channels, and below it the active interlocks."""
    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column("channel", overflow="fold")
    table.add_column("value", justify="right", no_wrap=True, min_width=13)
    table.add_column("unit", no_wrap=True)
    table.add_column("age", justify="right", no_wrap=True, min_width=7)
    table.add_column("state", no_wrap=True)
    for reading in readings:
        colour = _COLOUR[reading.state]
        shown, unit = in_words(reading)
        unit = "" if unit == "1" else unit
        table.add_row(
            reading.channel, shown, unit, age(reading.age_s), Text(state(reading), style=colour)
        )
    lines = [Text(interlock_line(trip), style="red") for trip in active]
    return Group(table, *lines)


def in_words(reading: Reading) -> tuple[str, str]:
    """Return the value, and the unit in which people read it."""
    unit = reading.display or reading.unit
    return number(parse_unit(unit).from_si(reading.value)), unit


def number(value: float) -> str:
    """Return a value with six digits, or ``-`` if there is no value."""
    return "-" if math.isnan(value) else f"{value + 0.0:.6g}"  # no -0


def age(seconds: float) -> str:
    """Return an age as ``3 ms`` or ``1.5 s``, or ``-`` if there is no row yet."""
    if math.isinf(seconds):
        return "-"
    return f"{seconds * 1e3:.0f} ms" if seconds < 1 else f"{seconds:.1f} s"


def state(reading: Reading) -> str:
    """Return the state, with the status word of the device if it has one."""
    return reading.state if reading.status is None else f"{reading.state} {reading.status:#06x}"


def interlock_line(trip: Trip) -> str:
    """Describe an active interlock and its action in a run."""
    action = trip.interlock.action.word.replace("_", " ")
    return f"interlock {trip.interlock.name} ({action}): {trip.reason}"


def iso_time(t_ns: int) -> str:
    """Return Unix time as ISO 8601 in UTC, to the millisecond."""
    moment = datetime.fromtimestamp(t_ns * 1e-9, UTC)
    return moment.isoformat(timespec="milliseconds").replace("+00:00", "Z")
