"""Reads the numbers in a line; a line that is not as described gives a reason and no number."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from rigd_drivers.instruments.lines.config import SKIPPED, LinesConfig

#: Blanks may stand behind a sign, as scales and multimeters right-align their digits.
_NUMBER: Final = re.compile(
    r"(?P<sign>[-+]?) *(?P<digits>\d+\.?\d*|\.\d+)(?P<power>[eE][-+]?\d{1,3})?", re.ASCII
)
_COMMA: Final = re.compile(r"[-+]? *\d+,\d+", re.ASCII)
#: How much of a line a message shows, in bytes.
_SHOWN: Final = 60


@dataclass(frozen=True)
class Reading:
    """Values in SI in the order of the channels; NaN for one beyond the device's range."""

    values: tuple[float, ...]
    beyond: bool


@dataclass(frozen=True)
class Unreadable:
    """A line without values, and the reason, which names the column."""

    line: bytes
    reason: str

    def __str__(self) -> str:
        """Return the line and the reason, for a person."""
        more = "..." if len(self.line) > _SHOWN else ""
        return f"{self.line[:_SHOWN]!r}{more}: {self.reason}"


class LineReader:
    """Reads lines as ``config`` describes them."""

    def __init__(self, config: LinesConfig) -> None:
        self._config = config
        self._channels = {
            name: (item, item.channel(name)) for name, item in config.channels.items()
        }
        self._beyond = {word.casefold() for word in config.beyond}
        self._pattern: re.Pattern[str] | None = None
        if config.pattern is not None:
            self._pattern = re.compile(config.pattern, re.ASCII)

    def read(self, line: bytes) -> Reading | Unreadable:
        """Return the values of ``line``, or why it has none."""
        text = _text(line).strip()
        found = self._columns(text) if self._pattern is None else self._groups(text)
        if isinstance(found, str):
            return Unreadable(line, found)
        values, beyond = [], False
        for name, (written, place) in found.items():
            value = self._value(name, written)
            if isinstance(value, str):
                return Unreadable(line, f"{place} {value}")
            beyond |= math.isnan(value)
            values.append(value)
        return Reading(tuple(values), beyond)

    def identity(self, asked: bytes, line: bytes) -> bytes | None:
        """Return ``line`` if it can answer a question for the identity.

        Its echo does not, nor a line with values, which the device sends by itself.
        """
        if line.strip() == asked.strip() or isinstance(self.read(line), Reading):
            return None
        return line

    def _groups(self, text: str) -> dict[str, tuple[str, str]] | str:
        """Return what each channel's group has, and how a message names it; or what is wrong."""
        pattern = self._pattern
        if pattern is None:
            raise TypeError("the lines of this device have columns")
        match = pattern.fullmatch(text)
        if match is None:
            return _mismatch(pattern, text)
        return {name: (match[name] or "", f"group {name!r}") for name in self._channels}

    def _columns(self, text: str) -> dict[str, tuple[str, str]] | str:
        names, separator = self._config.columns or (), self._config.separator
        pieces = text.split(separator) if separator else text.split()
        if len(pieces) != len(names):
            return f"it has {len(pieces)} columns, expected {len(names)}"
        found = {
            name: (piece.strip(), f"column {number} ({name!r})")
            for number, (name, piece) in enumerate(zip(names, pieces, strict=True), 1)
            if name != SKIPPED
        }
        return {name: found[name] for name in self._channels}

    def _value(self, name: str, written: str) -> float | str:
        """Return the value in SI, or what is wrong with it."""
        if written.casefold() in self._beyond:
            return math.nan
        point = written
        if self._config.decimal == "comma":
            point = written.replace(",", ".") if "." not in written else ""
        match = _NUMBER.fullmatch(point)
        if match is None:
            comma = self._config.decimal == "point" and _COMMA.fullmatch(written)
            return f"is {written!r}, which is no number" + (
                ": it has a decimal comma, write 'decimal: comma'" if comma else ""
            )
        item, channel = self._channels[name]
        value = item.si(float(f"{match['sign']}{match['digits']}{match['power'] or ''}"))
        if not channel.low <= value <= channel.high:
            return f"is {written!r}, beyond {channel.low:g} to {channel.high:g} {channel.unit}"
        return value


def _text(line: bytes) -> str:
    """Return the line as text: UTF-8, or else Latin-1, in which each byte is a character."""
    try:
        return line.decode("utf-8")
    except UnicodeDecodeError:
        return line.decode("latin-1")


def _mismatch(pattern: re.Pattern[str], text: str) -> str:
    """Return up to which group the begin of ``text`` matches."""
    last, rest = "", text
    for name, part in _parts(pattern.pattern):
        match = part.match(text)
        if match is None:
            return f"group {name!r} does not match the pattern, at {rest[:_SHOWN]!r}"
        last, rest = name, text[match.end() :]
    return f"the pattern does not match the rest {rest[:_SHOWN]!r} behind group {last!r}"


def _parts(pattern: str) -> Iterator[tuple[str, re.Pattern[str]]]:
    """Yield each group with the pattern up to its end, if that is a pattern by itself."""
    for match in re.finditer(r"\(\?P<(\w+)>", pattern):
        try:
            yield match[1], re.compile(pattern[: _end(pattern, match.start())], re.ASCII)
        except re.error:  # the group stands in another one
            continue


def _end(pattern: str, start: int) -> int:
    """Return where the group that begins at ``start`` ends."""
    depth, at, in_set = 0, start, False
    while at < len(pattern):
        character = pattern[at]
        if character == "\\":
            at += 1
        elif in_set:
            in_set = character != "]"
        elif character == "[":
            in_set = True
            at += pattern.startswith(("]", "^]"), at + 1)
        elif character in "()":
            depth += 1 if character == "(" else -1
            if depth == 0:
                return at + 1
        at += 1
    return len(pattern)
