"""Finds when conditions begin to hold, between the samples of a recording.

A sample that is missing or not finite fulfils nothing. Between two samples a channel is taken for a
straight line, so an event is found more finely than the period of its channel.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rigd.procedure.program import Comparison, Condition

#: Times (n,) in s, ascending, and values (n,) of a channel.
Samples = tuple[NDArray[np.float64], NDArray[np.float64]]
#: Begin and end, in s.
Interval = tuple[float, float]


def first_time(
    rows: Sequence[Sequence[Condition]], samples: Callable[[str], Samples], begin_s: float
) -> float | None:
    """Return when one of ``rows`` begins to hold at or after ``begin_s``, in s; None if none does.

    ``samples(channel)`` gives all samples of a channel. What holds at the first of them has not
    begun.
    """
    starts = [start for row in rows for start, _ in _holding(row, samples) if start >= begin_s]
    return min(starts, default=None)


def holds_at(
    rows: Sequence[Sequence[Condition]], samples: Callable[[str], Samples], at_s: float
) -> bool:
    """Return whether one of ``rows`` holds at ``at_s`` and began before."""
    return any(start < at_s < end for row in rows for start, end in _holding(row, samples))


def _holding(row: Sequence[Condition], samples: Callable[[str], Samples]) -> list[Interval]:
    """Return when all conditions of a row hold together."""
    common: list[Interval] = [(-np.inf, np.inf)]
    for condition in row:
        held = [item for item in intervals(condition, *samples(condition.channel))
                if item[1] - item[0] >= condition.for_s]  # fmt: skip
        common = [
            (max(a[0], b[0]), min(a[1], b[1]))
            for a in common
            for b in held
            if max(a[0], b[0]) <= min(a[1], b[1])
        ]
    return common


def intervals(
    condition: Condition, times: NDArray[np.float64], values: NDArray[np.float64]
) -> list[Interval]:
    """Return when ``condition`` holds, its ``for`` aside.

    An interval begins at -inf if it holds at the first sample, and ends with the last sample that
    fulfils it if one that is not finite follows.
    """
    if condition.magnitude:
        values = np.abs(values)
    sign = 1.0 if condition.comparison is Comparison.ABOVE else -1.0
    above = sign * (values - condition.threshold)
    holds = np.isfinite(above) & (above > 0)
    changes = np.flatnonzero(np.diff(holds.astype(np.int8))) + 1
    edges = [0, *changes.tolist(), len(holds)]
    found = []
    for first, end in pairwise(edges):
        if first < end and holds[first]:
            start = -np.inf if first == 0 else _crossing(times, above, first - 1, first)
            stop = times[end - 1] if end == len(holds) else _crossing(times, above, end, end - 1)
            found.append((float(start), float(stop)))
    return found


def _crossing(
    times: NDArray[np.float64], above: NDArray[np.float64], outside: int, inside: int
) -> float:
    """Return where the line between two samples is 0; the one inside if the other is not finite."""
    if not np.isfinite(above[outside]):
        return float(times[inside])
    share = above[inside] / (above[inside] - above[outside])
    return float(times[inside] + share * (times[outside] - times[inside]))
