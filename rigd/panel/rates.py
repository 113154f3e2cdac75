"""Rates that a client may not exceed."""

from __future__ import annotations

from collections.abc import Callable
from time import monotonic


class Bucket:
    """A token bucket: ``burst`` at once, ``per_s`` in the long run."""

    def __init__(self, per_s: float, burst: float, now: Callable[[], float] = monotonic) -> None:
        self._per_s = per_s
        self._burst = burst
        self._now = now
        self._left = burst
        self._at_s = now()

    def take(self) -> bool:
        """Return whether one more may pass, and count it."""
        now = self._now()
        self._left = min(self._burst, self._left + (now - self._at_s) * self._per_s)
        self._at_s = now
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True
