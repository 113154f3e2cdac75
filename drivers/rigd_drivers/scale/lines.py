"""Splits the bytes from a serial port into lines, even if the connection is disturbed."""

from __future__ import annotations

from typing import Final

#: Longest line kept, in bytes: the longest reply of MT-SICS level 0 (I2, two texts) is below 80.
MAX_LINE: Final = 256


class LineBuffer:
    """Collects bytes and gives out lines, without their ends; holds at most :data:`MAX_LINE`.

    A line ends with CR, LF or both, so that one of them may be missing. NUL bytes, as a break
    condition makes them, are dropped. Of a line without end nothing is kept: everything up to the
    next end is thrown away.
    """

    def __init__(self) -> None:
        self._line = bytearray()
        self._too_long = False

    def feed(self, data: bytes) -> list[bytes]:
        """Take ``data`` in and return the lines that it completes; empty lines are left out."""
        lines = []
        *complete, rest = data.replace(b"\0", b"").replace(b"\r", b"\n").split(b"\n")
        for piece in complete:
            self._append(piece)
            if self._line:
                lines.append(bytes(self._line))
            self.clear()
        self._append(rest)
        return lines

    def clear(self) -> None:
        """Discard the line that has begun."""
        self._line.clear()
        self._too_long = False

    def _append(self, piece: bytes) -> None:
        if self._too_long or len(self._line) + len(piece) > MAX_LINE:
            self._line.clear()
            self._too_long = True
        else:
            self._line += piece
