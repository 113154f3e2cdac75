"""Converts the readings of a counter that overflows to a position without jumps."""

from __future__ import annotations


class Unwrap:
    """Follows a counter of ``span`` steps (2^16, 2^24, 2^32, ...) by signed differences.

    Right as long as it moves less than half its span between two readings. The first is taken
    within half a span of ``near``: with 0 a count just below the end of the span is small.
    """

    def __init__(self, span: int, near: int = 0) -> None:
        if span < 2:
            raise ValueError(f"a counter of {span} steps cannot roll over")
        self.span = span
        self.total = 0  #: counts, unbounded
        self._last: int | None = None
        self._near = near

    def begin(self, count: int) -> int:
        """Take ``count`` for the position, as it is; return it."""
        self.total = self._last = count
        return count

    def follow(self, count: int) -> int:
        """Return the unbounded count."""
        if self._last is None:
            self._last = self.total = self._near
        self.total += (count - self._last + self.span // 2) % self.span - self.span // 2
        self._last = count
        return self.total
