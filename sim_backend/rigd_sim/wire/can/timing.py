"""Computes how long frames occupy a CAN bus, and decides which waiting frame is sent next."""

from __future__ import annotations

import heapq
from typing import Final

#: Bits of a base frame without data: SOF to intermission (ISO 11898-1, 10.4).
OVERHEAD_BITS: Final = 47
#: Of these, the ones that bit stuffing applies to: SOF to the end of the CRC.
STUFFED_BITS: Final = 34
#: Flags above the 29 bits of an identifier (linux/can.h).
ID_MASK: Final = 0x1FFFFFFF

#: Sender, identifier with flags, data.
Frame = tuple[object, int, bytes]


def frame_ns(length: int, bitrate: float) -> int:
    """Return how long, in ns, a base frame of ``length`` data bytes occupies a bus at most.

    The worst case of bit stuffing: one more bit for every four behind the first.
    """
    bits = OVERHEAD_BITS + 8 * length
    return round((bits + (STUFFED_BITS + 8 * length - 1) // 4) * 1e9 / bitrate)


class Arbiter:
    """One frame at a time, the lowest identifier first among those that wait.

    It has no clock of its own: the caller offers frames and passes the time.
    """

    def __init__(self, bitrate: float) -> None:
        self._bitrate = bitrate
        self._waiting: list[tuple[int, int, Frame]] = []
        self._offered = 0
        self._on_wire: Frame | None = None
        self._free_ns = 0
        #: Time in ns that frames have occupied the bus.
        self.busy_ns = 0

    def offer(self, frame: Frame, t_ns: int) -> None:
        """Let ``frame`` take part in arbitration from ``t_ns`` on."""
        self._offered += 1
        heapq.heappush(self._waiting, (frame[1] & ID_MASK, self._offered, frame))
        if self._on_wire is None:
            self._begin(t_ns)

    def take(self, t_ns: int) -> Frame | None:
        """Return the frame whose last bit has passed by ``t_ns``, or None.

        The bus then waits for :meth:`resume`, so that all nodes that answer that frame compete.
        """
        return self._on_wire if self._on_wire is not None and self._free_ns <= t_ns else None

    def resume(self) -> None:
        """Let the next frame begin where the one taken ended."""
        self._on_wire = None
        if self._waiting:
            self._begin(self._free_ns)

    @property
    def due_ns(self) -> int | None:
        """When the frame on the wire will have passed; None while the bus is idle."""
        return None if self._on_wire is None else self._free_ns

    def _begin(self, t_ns: int) -> None:
        self._on_wire = heapq.heappop(self._waiting)[2]
        duration = frame_ns(len(self._on_wire[2]), self._bitrate)
        self._free_ns = max(t_ns, self._free_ns) + duration
        self.busy_ns += duration
