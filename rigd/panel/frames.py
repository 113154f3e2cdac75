"""How several live frames become one, for a browser that is slow."""

from __future__ import annotations

import numpy as np

from rigd.remote.protocol.frame import Frame


def merge(first: Frame, second: Frame, most: int) -> Frame:
    """Return one frame with the points of both, pairwise condensed until at most ``most`` are left.

    No extreme is lost; a point keeps the time of the first of those it stands for. Where the
    channels differ (another run has begun), ``second`` alone is returned.
    """
    if first.low.shape[0] != second.low.shape[0]:
        return second
    shift_s = (second.t0_ns - first.t0_ns) * 1e-9
    time_s = np.concatenate([first.time_s, second.time_s + shift_s])
    low = np.concatenate([first.low, second.low], axis=1)
    high = np.concatenate([first.high, second.high], axis=1)
    while time_s.size > most:
        starts = np.arange(0, time_s.size, 2)
        time_s = time_s[starts]
        low = np.fmin.reduceat(low, starts, axis=1)
        high = np.fmax.reduceat(high, starts, axis=1)
    return Frame(first.stream, second.sequence, first.t0_ns, time_s, low, high)
