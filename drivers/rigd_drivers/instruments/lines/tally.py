"""Counts the lines of a device that could not be read, and makes the status word of its rows."""

from __future__ import annotations

from enum import IntFlag
from typing import Final

from rigd_drivers.instruments.lines.config import LinesConfig
from rigd_drivers.instruments.lines.reader import LineReader, Reading, Unreadable


class LineStatus(IntFlag):
    """The status word of a row; bits 16 to 23 count lines that could not be read, modulo 256."""

    UNREADABLE = 1  #: since the row before, a line came that could not be read
    UNANSWERED = 2  #: since the row before, a question had no answer in time
    BEYOND = 4  #: a value is beyond the device's range, and NaN


_COUNT_SHIFT: Final = 16
_COUNT_MASK: Final = 0xFF


class Tally:
    """Reads lines as ``config`` describes them, and remembers what was wrong."""

    def __init__(self, config: LinesConfig) -> None:
        self._reader = LineReader(config)
        self._status = LineStatus(0)  # of the next row
        self._overlong = 0  # lines that the port had thrown away at the last row
        self.lines = 0  #: lines that have come, without echoes
        self.unreadable = 0  #: of these, those that could not be read
        self.last: Unreadable | None = None  #: the last of them since the last row

    def take(self, line: bytes) -> Reading | None:
        """Return the reading in ``line``; None if it cannot be read, which is counted."""
        self.lines += 1
        found = self._reader.read(line)
        if isinstance(found, Reading):
            return found
        self.unreadable += 1
        self.last = found
        self._status |= LineStatus.UNREADABLE
        return None

    def unanswered(self) -> None:
        """Note that a question had no answer."""
        self._status |= LineStatus.UNANSWERED

    def row(self, reading: Reading, overlong: int) -> tuple[float, ...]:
        """Return the row of ``reading``; ``overlong``: lines that the port has thrown away."""
        if overlong > self._overlong:
            self.unreadable += overlong - self._overlong
            self._overlong = overlong
            self._status |= LineStatus.UNREADABLE
        if reading.beyond:
            self._status |= LineStatus.BEYOND
        status = self._status | (self.unreadable & _COUNT_MASK) << _COUNT_SHIFT
        self._status, self.last = LineStatus(0), None
        return (*reading.values, int(status))

    def wrong(self, port: str, within: str) -> str:
        """Return in words that no line can be read, with the last one."""
        return (
            f"{port} sends no line that can be read {within}; the last is {self.last} "
            f"({self.unreadable} of {self.lines} lines could not be read)"
        )
