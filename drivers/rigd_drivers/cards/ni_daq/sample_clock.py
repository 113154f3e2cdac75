"""Estimates when the card took each sample, in the time of CLOCK_MONOTONIC.

The card samples by its own clock. The module compares this clock with CLOCK_MONOTONIC.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

#: The quickest arrival of each second is kept, for so many seconds.
WINDOW_NS: Final = 1_000_000_000
WINDOWS: Final = 60
#: The slope is used once so many windows are there: an arrival may be 0.1 ms late, which over
#: 10 s is 10 ppm.
WINDOWS_FOR_RATE: Final = 10
#: Furthest that a card's crystal is taken to be from its nominal rate; within 100 ppm is usual.
MOST_DRIFT: Final = 200e-6
#: Fastest that an error of the time is worked off: 1 ms in 1 s.
MOST_SLEW: Final = 1e-3
#: Slope at which the times of a block still increase, if it arrives before it is expected.
MOST_HASTE: Final = -0.999

Point = tuple[float, float]


class SampleClock:
    """Computes the time of every sample from its number and the arrival time of its block.

    A block arrives after its last sample was taken, late by what the bus, the driver, the network
    and the scheduler need: at least a little, at times much. So the true line of time over sample
    number runs below all arrivals. It is estimated as the highest line that does, over the last
    minute; the same as the linear programme of Moon, Skelly and Towsley, "Estimation and removal
    of clock skew from network delay measurements", INFOCOM 1999. What is left is the smallest
    delay, which cannot be distinguished from an offset.

    Times always increase, and no sample is later than its arrival. An error that is found is
    worked off within :data:`MOST_SLEW`; only if a block would be later than its arrival, it is
    within that block.
    """

    def __init__(self, nominal_hz: float, started_ns: int) -> None:
        """``started_ns`` is before sample 0 was taken; the first block's arrival shows how long."""
        self.nominal_hz = nominal_hz
        self._period_ns = 1e9 / nominal_hz  # nominal
        self._first_ns = started_ns
        self._count = 0  # samples so far
        # The line in use: lateness against the nominal clock, in ns, at a nominal time, in ns.
        self._knot: Point = (0.0, 0.0)  # of the last sample
        self._slope = 0.0
        self._drift = 0.0
        self._window_end_ns = float(WINDOW_NS)
        self._quickest: Point | None = None
        self._arrivals: deque[Point] = deque(maxlen=WINDOWS)

    @property
    def rate_hz(self) -> float:
        """The card's rate by the monotonic clock, as estimated so far."""
        return self.nominal_hz / (1.0 + self._drift)

    @property
    def count(self) -> int:
        """How many samples have been given a time."""
        return self._count

    def stamp(self, count: int, arrived_ns: int) -> NDArray[np.int64]:
        """Return the monotonic times of the next ``count`` samples, shape (count,), in ns.

        ``arrived_ns`` is when their block did.
        """
        nominal = (self._count + np.arange(count)) * self._period_ns
        last = float(nominal[-1])
        if self._count == 0:
            self._first_ns = max(self._first_ns, arrived_ns - int(last))
        self._count += count
        arrival = (last, float(arrived_ns - self._first_ns - last))
        if self._quickest is None or arrival[1] < self._quickest[1]:
            self._quickest = arrival
        start, late = self._knot
        slope = self._slope
        if late + (last - start) * slope > arrival[1]:  # no sample is later than its arrival
            slope = max((arrival[1] - late) / max(last - start, 1.0), MOST_HASTE)
        times = nominal + late + (nominal - start) * slope
        self._knot = (last, late + (last - start) * slope)
        if last >= self._window_end_ns:
            self._steer()
        return self._first_ns + times.astype(np.int64)

    def _steer(self) -> None:
        """Close a window and aim at the estimated line, to be met one window from now."""
        now, late = self._knot
        if self._quickest is not None:
            self._arrivals.append(self._quickest)
        self._quickest = None
        self._window_end_ns = now + WINDOW_NS
        drift = self._drift
        if len(self._arrivals) >= WINDOWS_FOR_RATE:
            drift = min(max(line_below(self._arrivals)[1], -MOST_DRIFT), MOST_DRIFT)
        self._drift = drift
        level = min(late - drift * at for at, late in self._arrivals)
        wanted = (level + drift * (now + WINDOW_NS) - late) / WINDOW_NS
        self._slope = min(max(wanted, drift - MOST_SLEW), drift + MOST_SLEW)


def line_below(points: Sequence[Point]) -> Point:
    """Return level (at 0) and slope of the highest line below ``points``, which ascend in x.

    Of all lines that no point is below, the one with the least sum of distances: the edge of the
    lower convex hull over the mean of x.
    """
    hull: list[Point] = []
    for point in points:
        while len(hull) > 1 and _turns_down(hull[-2], hull[-1], point):
            hull.pop()
        hull.append(point)
    if len(hull) == 1:
        return hull[0][1], 0.0
    middle = sum(x for x, _ in points) / len(points)
    left, right = next(edge for edge in pairwise(hull) if middle <= edge[1][0])
    slope = (right[1] - left[1]) / (right[0] - left[0])
    return left[1] - slope * left[0], slope


def _turns_down(a: Point, b: Point, c: Point) -> bool:
    """Return whether ``b`` is on or above the line from ``a`` to ``c``."""
    return (b[1] - a[1]) * (c[0] - a[0]) >= (c[1] - a[1]) * (b[0] - a[0])
