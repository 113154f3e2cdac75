"""Splits the bytes from a port into lines, even if the connection is disturbed."""

from __future__ import annotations

from typing import Final

#: Longest line kept, in bytes, unless the driver gives another length.
MAX_LINE: Final = 256


class LineBuffer:
    """Collects bytes and gives out lines, without their ends; holds at most ``max_line`` bytes.

    A line ends with CR, LF or both, so that one of them may be missing. Of a line that is longer
    nothing is kept: everything up to the next end is thrown away, and counted in :attr:`overlong`.

    Args:
        max_line: longest line kept, in bytes.
        drop_nul: drop NUL bytes, as a break condition makes them. Only for a protocol whose lines
            show that a character is missing: without its damaged point, 12.5 reads as 125.

    """

    def __init__(self, max_line: int = MAX_LINE, *, drop_nul: bool = False) -> None:
        self._max_line = max_line
        self._drop_nul = drop_nul
        self._line = bytearray()
        self._skipping = False
        #: Lines thrown away because they were too long.
        self.overlong = 0

    @property
    def begun(self) -> bool:
        """Whether a line has begun whose end has not come."""
        return bool(self._line) or self._skipping

    def feed(self, data: bytes) -> list[bytes]:
        """Take ``data`` in and return the lines that it completes; empty lines are left out."""
        lines = []
        if self._drop_nul:
            data = data.replace(b"\0", b"")
        *complete, rest = data.replace(b"\r", b"\n").split(b"\n")
        for piece in complete:
            self._append(piece)
            if self._line:
                lines.append(bytes(self._line))
            self.clear()
        self._append(rest)
        return lines

    def clear(self) -> None:
        """Discard the line that has begun; what comes next is the begin of a line."""
        self._line.clear()
        self._skipping = False

    def skip(self) -> None:
        """Throw away what comes up to the next end of a line: its begin was not seen."""
        self._line.clear()
        self._skipping = True

    def _append(self, piece: bytes) -> None:
        if self._skipping:
            return
        if len(self._line) + len(piece) > self._max_line:
            self.skip()
            self.overlong += 1
        else:
            self._line += piece
