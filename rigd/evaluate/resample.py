"""Streams of different rates brought to the same times, and rows that repeat earlier ones.

Nothing is interpolated: what is missing would look like data. A stream that is sampled faster is
averaged; a few rows that repeat an earlier one are taken as they are, more of them are refused.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from rigd.model.channels import STALE
from rigd.model.errors import DataError

#: A stream is averaged where it has at least so many samples to a period; with fewer, the mean
#: would stand up to half a period beside its time.
LEAST_RATIO: Final = 2.0
#: Share of the rows of a trial that may repeat an earlier row. Each holds a position for 1 ms at
#: 1 kHz: at 1 m/s an error of 1 mm, in a 25 ms window of smoothing up to 9 mm/s of its slope.
MOST_STALE: Final = 0.005
#: Rows in succession that may.
LONGEST_STALE: Final = 3

FloatArray = NDArray[np.float64]
Times = NDArray[np.int64]


def period_ns(times: Times) -> float:
    """Return the usual distance of ``times`` (n,) in ns; infinite where n is below 2."""
    return float(np.median(np.diff(times))) if len(times) > 1 else float("inf")


def means_around(centres: Times, times: Times, values: FloatArray) -> FloatArray:
    """Return the mean of ``values`` (n,) within half a period around each of ``centres`` (k,).

    The period is that of ``centres``. This is a moving average of one period: it passes what is
    slow, has no delay, and lets nothing through at the rate of ``centres`` itself. Times in ns,
    ascending.

    Raises:
        DataError: around one of ``centres`` less than half of the samples are there, or there are
            too few to a period to average at all.
    """
    period, own = period_ns(centres), period_ns(times)
    ratio = period / own
    if not ratio >= LEAST_RATIO:
        raise DataError(
            f"there is a sample every {own / 1e6:.4g} ms, need at least {LEAST_RATIO:g} in every "
            f"{period / 1e6:.4g} ms to take their mean"
        )
    half = round(period / 2)
    first = np.searchsorted(times, centres - half)
    last = np.searchsorted(times, centres + half)
    counts = last - first
    if counts.min() < ratio // 2:
        worst = int(counts.argmin())
        raise DataError(
            f"{counts[worst]} samples stand around {(centres[worst] - centres[0]) * 1e-9:.4f} s, "
            f"where {ratio:.3g} are usual"
        )
    level = float(values.mean())  # sums of differences keep their digits
    sums = np.concatenate([[0.0], np.cumsum(values - level)])
    means: FloatArray = level + (sums[last] - sums[first]) / counts
    return means


def stale_rows(status: NDArray[np.uint32]) -> NDArray[np.bool_]:
    """Return which rows (n,) repeat an earlier one, by their status words."""
    marked: NDArray[np.bool_] = (status & np.uint32(STALE)) != 0
    return marked


def check_stale(stale: NDArray[np.bool_]) -> None:
    """Check that so few rows repeat an earlier one that they may stand for themselves.

    Raises:
        DataError: more than :data:`MOST_STALE` of them do, or more than :data:`LONGEST_STALE` in
            succession.
    """
    count = int(np.count_nonzero(stale))
    if count > MOST_STALE * len(stale):
        raise DataError(
            f"{count} of {len(stale)} rows ({100 * count / len(stale):.2g} %) repeat an earlier "
            f"one, at most {100 * MOST_STALE:g} % may"
        )
    edges = np.flatnonzero(np.diff(np.concatenate([[False], stale, [False]])))
    longest = int(np.max(edges[1::2] - edges[::2], initial=0))
    if longest > LONGEST_STALE:
        raise DataError(
            f"{longest} rows in succession repeat an earlier one, at most {LONGEST_STALE} may"
        )
