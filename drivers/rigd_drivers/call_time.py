"""Bounds how long calls to a card may take, each alone or those of half a cycle together."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager


class CallTime:
    """The time that a call has: ``call_s`` alone, or what is left of :meth:`within`."""

    def __init__(self, call_s: float) -> None:
        self._call_s = call_s
        self._until_s: float | None = None

    @contextmanager
    def within(self, together_s: float) -> Iterator[None]:
        """Let all calls until the end of this have ``together_s`` together."""
        self._until_s = time.monotonic() + together_s
        try:
            yield
        finally:
            self._until_s = None

    @property
    def until_s(self) -> float:
        """When a call that begins now must have ended, by :func:`time.monotonic`."""
        return time.monotonic() + self._call_s if self._until_s is None else self._until_s

    def left_s(self) -> float:
        """Return the time for a call that begins now, in s, at least 1 ms."""
        return max(self.until_s - time.monotonic(), 1e-3)
