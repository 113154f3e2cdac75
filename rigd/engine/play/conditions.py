"""Checks conditions such as ``a.x > 1 m for 20 ms and scale is stable`` in every cycle."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from rigd.procedure.program import Comparison, Condition, StatusCondition, Until


class Taken(NamedTuple):
    """When the values of a rig were taken: the table of times, and which of them each value has.

    The table stays the same object.
    """

    times_ns: Sequence[int]
    place_of: Sequence[int]


@dataclass(frozen=True, eq=False)
class _Watch:
    """A condition bound to its places in the tables of values and times."""

    index: int
    taken: int
    met: Callable[[float], bool]
    hold_ns: int


class Watches:
    """Conditions bound to the tables of a rig: any of the rows, of which all must hold.

    ``readings`` also contains status words, as ``device.status``. A condition has held from one
    reading to another: a value that no reading follows counts for no time. Without ``taken`` each
    value is read in the cycle that checks it.

    Raises:
        KeyError: a condition names an unknown channel.
    """

    def __init__(
        self, until: Until, readings: Mapping[str, int], taken: Taken | None = None
    ) -> None:
        self._until = until
        self._times_ns = None if taken is None else taken.times_ns
        self._rows = [
            tuple(
                _Watch(
                    place := readings[item.channel],
                    0 if taken is None else taken.place_of[place],
                    _test(item),
                    round(item.for_s * 1e9),
                )
                for item in row
            )
            for row in until
        ]
        self._from_ns = 0
        self._held_since: dict[_Watch, int] = {}

    def restart(self, t_ns: int) -> None:
        """Begin anew at ``t_ns``: how long conditions have held before does not count."""
        self._from_ns = t_ns
        self._held_since.clear()

    def shift(self, by_ns: int) -> None:
        """Leave out a time of ``by_ns`` in which nothing was checked."""
        self._from_ns += by_ns
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
        if not watch.hold_ns:
            return True
        taken_ns = t_ns if self._times_ns is None else self._times_ns[watch.taken]
        since_ns = self._held_since.setdefault(watch, max(taken_ns, self._from_ns))
        return taken_ns - since_ns >= watch.hold_ns


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
