"""Detects a flood of frames on the CAN bus, and finds the identifier that causes it."""

from __future__ import annotations

from collections import Counter
from typing import Final

from rigd_drivers.can.canopen import frames

#: A bus flooded for so long is a failure, in ns. Less than it takes a device to be missed, so that
#: the cause is reported and not its effect.
WINDOW_NS: Final = 50_000_000
#: No node sends the same identifier so often in 1 ms: the bus itself carries some 20 frames.
_BABBLE_PER_MS: Final = 5
#: No bus carries so many frames in 1 ms: the shortest takes 47 us at 1 Mbit/s. Fewer are what had
#: gathered while this computer stalled.
_MOST_PER_MS: Final = 25


class FloodWatch:
    """Counts unexpected frames, or all frames while more arrive than a cycle takes in."""

    def __init__(self, now_ns: int) -> None:
        self.crowded = False  #: frames were left when the last cycle stopped to take them in
        self._crowded_ns = now_ns  #: since when
        self._empty_ns = now_ns  #: when none were left last
        self._since_ns = now_ns  #: since when is counted
        self._tally: Counter[int] = Counter()

    def count(self, identifier: int) -> None:
        """Count a frame."""
        self._tally[identifier] += 1

    def left(self, some: bool, now_ns: int) -> None:
        """Note whether frames were left."""
        if not some:
            self._empty_ns = now_ns
        elif not self.crowded:
            self._crowded_ns, self._since_ns = now_ns, self._empty_ns
            self._tally.clear()
        self.crowded = some

    def judge(self, now_ns: int) -> str:
        """Return what floods the bus, in words; "" if nothing does, or it is not known yet."""
        if now_ns - (self._crowded_ns if self.crowded else self._since_ns) <= WINDOW_NS:
            return ""
        elapsed_ms = (now_ns - self._since_ns) // 1_000_000
        tally = self._tally
        if not self.crowded:
            self._tally, self._since_ns = Counter(), now_ns
        if not tally:
            return ""
        ((identifier, count),) = tally.most_common(1)
        crowd = self.crowded and tally.total() > _MOST_PER_MS * elapsed_ms
        if not crowd and count <= _BABBLE_PER_MS * elapsed_ms:
            return ""
        return (
            f"in {elapsed_ms} ms came {count} frames {frames.describe(identifier)}, of "
            f"{tally.total()} counted"
        )
