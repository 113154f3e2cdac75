"""Checks conditions such as ``a.x > 1 m for 20 ms and scale is stable`` in every cycle."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from rigd.procedure.program import Comparison, Condition, StatusCondition, Until


@dataclass(frozen=True, eq=False)
class _Watch:
    """A condition bound to its place in the values table."""

    index: int
    met: Callable[[float], bool]
    hold_ns: int


class Watches:
    """Conditions bound to the tables of a rig: any of the rows, of which all must hold.

    ``readings`` also contains status words, as ``device.status``.

    Raises:
        KeyError: a condition names an unknown channel.
    """

    def __init__(self, until: Until, readings: Mapping[str, int]) -> None:
        self._until = until
        self._rows = [
            tuple(
                _Watch(readings[item.channel], _test(item), round(item.for_s * 1e9)) for item in row
            )
            for row in until
        ]
        self._held_since: dict[_Watch, int] = {}

    def restart(self) -> None:
        """Forget for how long conditions have held."""
        self._held_since.clear()

    def shift(self, by_ns: int) -> None:
        """Leave out a time of ``by_ns`` in which nothing was checked."""
        for watch in self._held_since:
            self._held_since[watch] += by_ns

    def met(self, t_ns: int, values: Sequence[float]) -> bool:
        """Return whether a row holds in the cycle at ``t_ns``."""
        # Every condition is checked, because each has its own time: what records goes on.
        return any([all([self._holds(watch, t_ns, values) for watch in row]) for row in self._rows])

    def values(self, values: Sequence[float]) -> dict[str, float]:
        """Return the newest value of every channel in the conditions."""
        return {
            condition.channel: values[watch.index]
            for row, watched in zip(self._until, self._rows, strict=True)
            for condition, watch in zip(row, watched, strict=True)
        }

    def _holds(self, watch: _Watch, t_ns: int, values: Sequence[float]) -> bool:
        if not watch.met(values[watch.index]):
            self._held_since.pop(watch, None)
            return False
        return t_ns - self._held_since.setdefault(watch, t_ns) >= watch.hold_ns


def _test(condition: Condition | StatusCondition) -> Callable[[float], bool]:
    """Return the test of a value against ``condition``; NaN fails every test."""
    if isinstance(condition, StatusCondition):
        mask, wanted = condition.mask, condition.wanted
        return lambda word: word == word and bool(int(word) & mask) is wanted
    threshold = condition.threshold
    above = condition.comparison is Comparison.ABOVE
    if condition.magnitude:
        if above:
            return lambda value: abs(value) > threshold
        return lambda value: abs(value) < threshold
    if above:
        return lambda value: value > threshold
    return lambda value: value < threshold
