"""Merges several live frames into one for a slow browser."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rigd.remote.protocol.frame import Frame


def merge(first: Frame, second: Frame, most: int) -> Frame:
    """Return one frame with the points of both; more than ``most`` are condensed to half of that.

    Each point left stands for an equal piece of the time, so that what waits longest, and is merged
    most often, is no coarser than the newest. No extreme is lost; a point keeps the time of the
    first of those it stands for. Where the channels differ (another run has begun), ``second``
    alone is returned.
    """
    if first.low.shape[0] != second.low.shape[0]:
        return second
    shift_s = (second.t0_ns - first.t0_ns) * 1e-9
    time_s = np.concatenate([first.time_s, second.time_s + shift_s])
    low = np.concatenate([first.low, second.low], axis=1)
    high = np.concatenate([first.high, second.high], axis=1)
    if time_s.size > most:
        starts = _pieces(time_s, max(1, most // 2))
        time_s = time_s[starts]
        low = np.fmin.reduceat(low, starts, axis=1)
        high = np.fmax.reduceat(high, starts, axis=1)
    return Frame(first.stream, second.sequence, first.t0_ns, time_s, low, high)


def _pieces(time_s: NDArray[np.float64], count: int) -> NDArray[np.intp]:
    """Return where each of at most ``count`` equal pieces of the time begins among the points."""
    first_s = time_s.min()
    width_s = (time_s.max() - first_s) / count
    if width_s == 0.0:
        return np.zeros(1, dtype=np.intp)
    piece = np.minimum((time_s - first_s) // width_s, count - 1)
    # A clock that was set back begins no piece a second time.
    return np.flatnonzero(np.diff(np.maximum.accumulate(piece), prepend=-1.0))
