"""Finds when conditions begin to hold, between the samples of a recording.

A sample that is missing or not finite fulfils nothing. Between two samples a channel is taken for a
straight line, so an event is found more finely than the period of its channel.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rigd.procedure.program import Comparison, Condition

#: A condition that held begins again if it did not hold for so many samples at least, one of which
#: lay from the bound by so many standard deviations of the noise: noise about a bound is no event.
CLEAR: Final = 10
#: Times (n,) in s, ascending, and values (n,) of a channel.
Samples = tuple[NDArray[np.float64], NDArray[np.float64]]
#: Begin and end, in s.
Interval = tuple[float, float]


def event_time(
    rows: Sequence[Sequence[Condition]],
    samples: Callable[[str], Samples],
    begin_s: float,
    number: int = 1,
) -> float | None:
    """Return when one of ``rows`` begins to hold at or after ``begin_s``, in s; None if none does.

    ``samples(channel)`` gives all samples of a channel. What holds at the first of them has not
    begun. What holds at ``begin_s`` already, and an event of a higher ``number``, begins again once
    it clearly did not hold: see :data:`CLEAR`.
    """
    if number == 1 and not holds_at(rows, samples, begin_s):
        spans = holding(rows, samples)
    else:
        spans = holding(rows, samples, again=True)
    starts = [start for start, _ in spans if start >= begin_s]
    return starts[number - 1] if len(starts) >= number else None


def holds_at(
    rows: Sequence[Sequence[Condition]], samples: Callable[[str], Samples], at_s: float
) -> bool:
    """Return whether one of ``rows`` holds at ``at_s`` and began before."""
    return any(start < at_s < end for start, end in holding(rows, samples))


def holding(
    rows: Sequence[Sequence[Condition]], samples: Callable[[str], Samples], *, again: bool = False
) -> list[Interval]:
    """Return when one of ``rows`` holds, in turn; with ``again`` each clearly after the other."""
    spans = sorted(item for row in rows for item in _holding(row, samples, again=again))
    found: list[Interval] = []
    for start, end in spans:
        if found and start <= found[-1][1]:
            found[-1] = (found[-1][0], max(end, found[-1][1]))
        else:
            found.append((start, end))
    return found


def _holding(
    row: Sequence[Condition], samples: Callable[[str], Samples], *, again: bool
) -> list[Interval]:
    """Return when all conditions of a row hold together."""
    common: list[Interval] = [(-np.inf, np.inf)]
    for condition in row:
        found = intervals(condition, *samples(condition.channel), again=again)
        held = [item for item in found if item[1] - item[0] >= condition.for_s]
        common = [
            (max(a[0], b[0]), min(a[1], b[1]))
            for a in common
            for b in held
            if max(a[0], b[0]) <= min(a[1], b[1])
        ]
    return common


def intervals(
    condition: Condition,
    times: NDArray[np.float64],
    values: NDArray[np.float64],
    *,
    again: bool = False,
) -> list[Interval]:
    """Return when ``condition`` holds, its ``for`` aside.

    Begin and end of an interval are not in it. It begins at -inf if it holds at the first sample,
    and ends just behind the last sample that fulfils it if none, or one that is not finite,
    follows. With ``again`` two of them are one if what lies between is not clear of noise: see
    :data:`CLEAR`.
    """
    if condition.magnitude:
        values = np.abs(values)
    sign = 1.0 if condition.comparison is Comparison.ABOVE else -1.0
    above = sign * (values - condition.threshold)
    holds = np.isfinite(above) & (above > 0)
    edges = np.flatnonzero(np.diff(holds.astype(np.int8), prepend=0, append=0)).tolist()
    spans = list(zip(edges[::2], edges[1::2], strict=True))
    if again:
        spans = _apart(spans, above)
    found = []
    for first, end in spans:
        start = -np.inf if first == 0 else _crossing(times, above, first - 1, first)
        stop = _crossing(times, above, end, end - 1)
        found.append((float(start), float(stop)))
    return found


def _apart(spans: Sequence[tuple[int, int]], above: NDArray[np.float64]) -> list[tuple[int, int]]:
    """Return spans of samples, those one that are not clearly apart: see :data:`CLEAR`."""
    room, found = CLEAR * _noise(above), list(spans[:1])
    for first, end in spans[1:]:
        between = above[found[-1][1] : first]
        if len(between) >= CLEAR and np.nanmin(between, initial=0.0) < -room:
            found.append((first, end))
        else:
            found[-1] = (found[-1][0], end)
    return found


def _noise(values: NDArray[np.float64]) -> float:
    """Return the standard deviation of white noise in ``values``, from their second differences.

    The median of their sizes: a motion that is smooth over three samples, and jumps, leave it.
    """
    bends = np.abs(np.diff(values, 2))
    bends = bends[np.isfinite(bends)]
    return float(np.median(bends) / 0.6745 / np.sqrt(6.0)) if len(bends) else 0.0


def _crossing(
    times: NDArray[np.float64], above: NDArray[np.float64], outside: int, inside: int
) -> float:
    """Return where the line between two samples is 0.

    Just beyond the one inside, if there is no other or it is not finite.
    """
    if outside == len(above) or not np.isfinite(above[outside]):
        return float(np.nextafter(times[inside], np.inf if outside > inside else -np.inf))
    share = above[inside] / (above[inside] - above[outside])
    return float(times[inside] + share * (times[outside] - times[inside]))
