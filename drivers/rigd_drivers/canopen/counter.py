"""Converts the readings of a counter that overflows to a position without jumps."""

from __future__ import annotations


class Unwrap:
    """Follows a counter of ``span`` steps (2^16, 2^24, 2^32, ...) by signed differences.

    Right as long as it moves less than half its span between two readings.
    """

    def __init__(self, span: int) -> None:
        if span < 2:
            raise ValueError(f"a counter of {span} steps cannot roll over")
        self.span = span
        self.total = 0  #: counts, unbounded
        self._last: int | None = None

    def begin(self, count: int) -> int:
        """Take ``count`` for the position, as it is; return it."""
        self.total = self._last = count
        return count

    def follow(self, count: int) -> int:
        """Return the unbounded count; the first is taken as signed (just below zero is small)."""
        last = self._last
        if last is None:
            step = (count + self.span // 2) % self.span - self.span // 2
        else:
            step = (count - last + self.span // 2) % self.span - self.span // 2
        self._last = count
        self.total += step
        return self.total
