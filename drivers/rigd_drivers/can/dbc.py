"""Reads what a DBC file states of one CAN message: its signals, their units and ranges.

``cantools`` (the extra ``rigd[dbc]``) reads the file; it is imported only for a rig that has such a
message.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

from rigd.model.machine.extras import is_installed, missing
from rigd.model.units import Unit, parse_unit
from rigd.sdk import Channel, wrong_entry

#: How DBC files write units that rigd spells otherwise; "Â°" is a degree sign of UTF-8, read in the
#: code page of DBC files (cp1252).
_SPELT: Final = {
    "": "1", "-": "1", "°C": "degC", "Â°C": "degC", "deg C": "degC", "°F": "degF",
    "°": "deg", "Nm": "N m", "°/s": "deg/s", "kph": "km/h",
}  # fmt: skip
_NAME: Final = re.compile(r"[a-z][a-z0-9_]*")


@dataclass(frozen=True)
class Signal:
    """One signal that a frame carries."""

    name: str  #: in the DBC
    channel: Channel
    unit: Unit  #: of the number in the DBC
    low: float  #: in SI, as the DBC has it; -inf: it states none
    high: float


@dataclass(frozen=True)
class Message:
    """One message of a DBC, or one page of it: what its multiplexer selects."""

    known: Any  #: the message of cantools
    signals: tuple[Signal, ...]
    multiplexer: str | None
    page: int | None

    def values(self, data: bytes) -> tuple[float, ...] | None:
        """Return the values in SI in a frame of the right length; None: it is another page."""
        from cantools.database import DecodeError

        try:
            found = self.known.decode(data, decode_choices=False)
        except DecodeError:  # a page that the DBC does not have
            return None
        if self.multiplexer is not None and found[self.multiplexer] != self.page:
            return None
        return tuple(signal.unit.to_si(float(found[signal.name])) for signal in self.signals)


def read_message(
    path: Path, name: str, page: int | None, units: Mapping[str, str], wanted: tuple[str, ...]
) -> Message:
    """Return a message of the DBC at ``path``.

    Args:
        path: of the file.
        name: of the message.
        page: what its multiplexer selects; None: it has none.
        units: of signals, where the file has none that rigd knows.
        wanted: signals that become channels; none: all.

    Raises:
        ValueError: there is no such message, page, signal or unit; the text says what there is.
    """
    known = _message(path, name)
    multiplexers = [signal.name for signal in known.signals if signal.is_multiplexer]
    if len(multiplexers) > 1:
        raise wrong_entry(
            f"message {name} of {path.name} has nested multiplexers: not supported", "message"
        )
    multiplexer = multiplexers[0] if multiplexers else None
    _check_page(path, known, multiplexer, page)
    carried = {
        signal.name: signal
        for signal in known.signals
        if signal.name != multiplexer
        and (signal.multiplexer_ids is None or page in signal.multiplexer_ids)
    }
    named: list[tuple[str, str, str | int]] = [
        *((given, "signals", place) for place, given in enumerate(wanted)),
        *((given, "units", given) for given in units),
    ]
    for given, key, below in named:
        if given not in carried:
            raise wrong_entry(
                f"message {name} of {path.name} carries no signal {given!r}; it carries "
                f"{', '.join(carried)}",
                key,
                below,
            )
    signals = tuple(
        _signal(path, name, signal, units.get(signal.name))
        for signal in carried.values()
        if not wanted or signal.name in wanted
    )
    names = [signal.channel.name for signal in signals]
    for item in names:
        if names.count(item) > 1:
            raise wrong_entry(
                f"two signals of message {name} become the channel {item!r}", "message"
            )
    return Message(known, signals, multiplexer, page)


def _message(path: Path, name: str) -> Any:
    if not is_installed("dbc"):
        raise wrong_entry(missing("a message of a DBC", "dbc"), "message")
    database = _database(path, path.stat().st_mtime_ns)
    found = {message.name: message for message in database.messages}
    if name not in found:
        raise wrong_entry(
            f"{path.name} has no message {name!r}; it has {', '.join(found)}", "message"
        )
    return found[name]


@lru_cache(maxsize=16)
def _database(path: Path, _changed_ns: int) -> Any:
    import cantools
    from cantools.database.errors import Error

    try:
        return cantools.database.load_file(path, database_format="dbc")
    except (Error, UnicodeDecodeError) as error:
        raise wrong_entry(f"{path} is no DBC that can be read: {error}", "dbc") from error


def _check_page(path: Path, known: Any, multiplexer: str | None, page: int | None) -> None:
    if multiplexer is None:
        if page is not None:
            raise wrong_entry(
                f"message {known.name} of {path.name} has no multiplexer: no `page`", "page"
            )
        return
    pages = sorted({each for signal in known.signals for each in signal.multiplexer_ids or ()})
    if page not in pages:
        given = "none" if page is None else f"{page}"
        raise wrong_entry(
            f"message {known.name} of {path.name} is multiplexed by {multiplexer}: `page` is one "
            f"of {', '.join(map(str, pages))}, not {given}",
            "page",
        )


def _signal(path: Path, message: str, signal: Any, given: str | None) -> Signal:
    where = f"signal {signal.name} of message {message} in {path.name}"
    unit = _unit(where, signal.name, signal.unit or "", given)
    name = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", signal.name).lower()
    if not _NAME.fullmatch(name):
        raise wrong_entry(
            f"{where} cannot be a channel: names are lower-case letters, digits, _", "message"
        )
    lows_highs = (signal.minimum, signal.maximum)
    stated = None not in lows_highs and lows_highs[0] != lows_highs[1]
    low, high = map(unit.to_si, map(float, lows_highs)) if stated else (-math.inf, math.inf)
    doc = signal.comment or f"{signal.name} of {message}"
    channel = Channel.read_in(unit.symbol, name, doc.splitlines()[0], low, high)
    return Signal(signal.name, channel, unit, low, high)


def _unit(where: str, name: str, text: str, given: str | None) -> Unit:
    try:
        stated = parse_unit(_SPELT.get(text, text))
    except ValueError as error:
        if given is None:
            raise wrong_entry(
                f"{where} has the unit {text!r}, which rigd does not know; give it in "
                f"`units: {{{name}: ...}}`",
                "units",
            ) from error
        return _given(given, name)
    if given is None:
        return stated
    own = _given(given, name)
    if text and not own.same_kind(stated):
        raise wrong_entry(f"{where} is in {text}; `units` gives it in {given}", "units", name)
    return own


def _given(unit: str, name: str) -> Unit:
    try:
        return parse_unit(unit)
    except ValueError as error:
        raise wrong_entry(str(error), "units", name) from error
