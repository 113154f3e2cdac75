"""Reduces long signals to the points that a figure can show, and keeps every peak."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from itertools import pairwise

import numpy as np

from rigd.analysis.result import BoolArray, FloatArray

#: Columns of a figure: two points in each (its least and greatest value) look like all samples.
COLUMNS = 250
_WHOLE: ContextVar[bool] = ContextVar("whole traces", default=False)


@contextmanager
def whole_traces() -> Iterator[None]:
    """Keep every sample within the block, for figures whose data are wanted."""
    token = _WHOLE.set(True)
    try:
        yield
    finally:
        _WHOLE.reset(token)


def thin(x: FloatArray, y: FloatArray, columns: int = COLUMNS) -> tuple[FloatArray, FloatArray]:
    """Return the least and greatest sample of each of ``columns`` equal pieces, in order of ``x``.

    Signals of at most ``2 * columns`` samples come back as they are, and all do within
    :func:`whole_traces`. A piece without any finite sample becomes one NaN, so that a gap stays a
    gap; a gap shorter than a piece closes.

    Args:
        x: (n,) ascending.
        y: (n,), NaN if there is nothing to draw.
        columns: how many pieces.

    Returns:
        Two arrays (m,) with m <= 2 * columns.

    """
    n = x.size
    if n <= 2 * columns or _WHOLE.get():
        return x, y
    edges = np.linspace(0, n, columns + 1).astype(np.intp)
    keep: list[int] = []
    for first, last in pairwise(edges):
        piece = y[first:last]
        finite = np.flatnonzero(np.isfinite(piece))
        if finite.size == 0:
            keep.append(int(first))
            continue
        ends = (finite[np.argmin(piece[finite])], finite[np.argmax(piece[finite])])
        keep.extend(int(first + k) for k in sorted(set(ends)))
    return x[keep], y[keep]


def spans(x: FloatArray, flag: BoolArray, columns: int = COLUMNS) -> list[tuple[float, float]]:
    """Return (start, length) of the stretches of ``x`` in which ``flag`` holds.

    Stretches closer together than a column of the figure are joined. A stretch reaches halfway
    to its neighbours, so that a single sample has a width.
    """
    if x.size == 0 or not flag.any():
        return []
    steps = np.diff(np.concatenate(([0], flag.astype(np.int8), [0])))
    first, last = np.flatnonzero(steps == 1), np.flatnonzero(steps == -1) - 1
    half = (x[-1] - x[0]) / max(x.size - 1, 1) / 2
    closest = (x[-1] - x[0]) / columns
    joined: list[tuple[float, float]] = []
    for a, b in zip(x[first] - half, x[last] + half, strict=True):
        if joined and a - joined[-1][1] < closest:
            joined[-1] = (joined[-1][0], float(b))
        else:
            joined.append((float(a), float(b)))
    return [(a, b - a) for a, b in joined]
