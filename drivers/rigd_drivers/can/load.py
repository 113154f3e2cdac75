"""Measures the load of a CAN bus: the share of time in which frames occupy the bus."""

from __future__ import annotations

from typing import Final

#: Bits that a data frame with 0 to 8 bytes and an 11-bit identifier takes on the bus at most, with
#: all stuff bits and the pause behind it: Davis, Burns, Bril, Lukkien (2007), Controller Area
#: Network (CAN) schedulability analysis, section 2.3.
FRAME_BITS: Final = tuple(55 + 10 * count for count in range(9))
#: The same with a 29-bit identifier.
EXTENDED_BITS: Final = tuple(80 + 10 * count for count in range(9))
#: The load is that of the last time of at least this length.
WINDOW_NS: Final = 500_000_000


class LoadMeter:
    """Counts the bits of every frame that is seen or sent, and gives their share of the time.

    An upper bound, as real frames seldom need all their stuff bits.
    """

    def __init__(self, bitrate: float, now_ns: int) -> None:
        self.bits = 0  #: add FRAME_BITS or EXTENDED_BITS of every frame
        self.load: float | None = None  #: 0 to 1, None before the first window is over
        self._bitrate = bitrate
        self._begun_ns = now_ns

    def look(self, now_ns: int) -> None:
        """Begin a new window if the present window is over."""
        took_ns = now_ns - self._begun_ns
        if took_ns >= WINDOW_NS:
            self.load = self.bits / (self._bitrate * took_ns * 1e-9)
            self.bits, self._begun_ns = 0, now_ns
