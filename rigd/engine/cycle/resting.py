"""Judges whether the rig rests after a run that did not reach its end."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from math import isnan, nan
from typing import Final

from rigd.config.rig import RestBound
from rigd.engine.cycle.mount import MountedRig

STILL_NS: Final = 500_000_000  #: how long the rig must be still, and how old a value may be
LEAST_NS: Final = 2_000_000_000  #: after which rows may end
STEP_NS: Final = 10_000_000  #: between the values that count


class Resting:
    """The channels of ``rig`` that show whether it rests; without any it is never found at rest."""

    def __init__(self, bounds: Sequence[RestBound], rig: MountedRig) -> None:
        self._windows = [
            (bound, rig.readings[bound.name], deque[float](maxlen=STILL_NS // STEP_NS + 1))
            for bound in bounds
        ]
        self._stamp_of = rig.stamp_of
        self._begun_ns: int | None = None
        self._next_ns = 0

    @property
    def moving(self) -> Mapping[str, float]:
        """What exceeds its bound, in SI by channel; NaN of one that gave no value for a while."""
        shown = ((bound, _shown(bound, values)) for bound, _, values in self._windows)
        return {bound.name: value for bound, value in shown if not value <= bound.bound}

    def see(self, t_ns: int, values: Sequence[float], stamps: Sequence[int]) -> bool:
        """Take the newest ``values`` at ``t_ns``; return whether the rig rests and rows may end."""
        if self._begun_ns is None:
            self._begun_ns = self._next_ns = t_ns
        if t_ns < self._next_ns or not self._windows:
            return False
        self._next_ns += STEP_NS
        for _, place, window in self._windows:
            fresh = t_ns - stamps[self._stamp_of[place]] <= STILL_NS
            window.append(values[place] if fresh else nan)
        full = all(len(window) == window.maxlen for *_, window in self._windows)
        return full and t_ns - self._begun_ns >= LEAST_NS and not self.moving


def _shown(bound: RestBound, window: Sequence[float]) -> float:
    """Return the largest magnitude, or the largest change over STILL_NS as a rate; NaN if none."""
    if not window or any(map(isnan, window)):
        return nan
    if bound.is_rate:
        return (max(window) - min(window)) / (STILL_NS * 1e-9)
    return max(map(abs, window))
