"""Limits every setpoint of a rig in value and rate before a driver writes it."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence

from rigd.model.limits import SetpointLimit


class Limiter:
    """Bounds every setpoint in value and in rate, cycle by cycle.

    ``limits`` are in the order of the command table. Setpoints begin at rest. ``elsewhere`` are the
    indices of those that move nothing and are limited where they are used: of controllers.
    """

    def __init__(
        self,
        limits: Sequence[SetpointLimit],
        period_s: float,
        elsewhere: Collection[int] = (),
    ) -> None:
        self.limits = tuple(limits)
        self.applied = [limit.rest for limit in limits]  #: the last setpoints that passed
        self.cut: set[int] = set()  #: indices of commands refused or out of bounds
        self._bounds = [
            (index, limit.low, limit.high, limit.rate * period_s)
            for index, limit in enumerate(limits)
            if index not in elsewhere
        ]

    def apply(self, wanted: Sequence[float]) -> list[float]:
        """Return the setpoints that may be written now.

        For a setpoint that is not finite, the last finite value holds.
        """
        applied, cut = self.applied, self.cut
        for index, low, high, step in self._bounds:
            target = wanted[index]
            last = applied[index]
            # The usual case; NaN fails every comparison.
            if target == last or (low <= target <= high and -step <= target - last <= step):
                applied[index] = target
                if cut:
                    cut.discard(index)
                continue
            if not math.isfinite(target):
                self.cut.add(index)
                continue
            value = min(max(target, low), high)
            if value == target:
                self.cut.discard(index)
            else:
                self.cut.add(index)
            if value - last > step:
                value = last + step
            elif last - value > step:
                value = last - step
            applied[index] = value
        return applied

    def at_rest(self) -> bool:
        """Return whether every setpoint has its rest value."""
        applied, limits = self.applied, self.limits
        return all(
            applied[bound[0]] == limits[bound[0]].rest or limits[bound[0]].holds
            for bound in self._bounds
        )
