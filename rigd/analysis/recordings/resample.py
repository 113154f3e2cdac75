"""Converts streams of different rates to the same times; bridges samples that are missing or late.

The module averages a stream with a faster rate. Some samples may be missing, or repeat an earlier
one because the device was late. The module bridges and counts a few such samples; it refuses more,
because invented samples would look like data.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from rigd.model.channels import STALE
from rigd.model.errors import DataError

#: A stream is averaged if it has at least so many samples to a period; with fewer, the mean
#: would stand up to half a period beside its time.
LEAST_RATIO: Final = 2.0
#: Samples that may be missing or late in succession. Bridged by a straight line, a position of
#: acceleration a is wrong by at most a (n + 1)^2 T^2 / 8: 30 um at 2 m/s^2 and 1 kHz, one count
#: of the carriage's encoder.
LONGEST_BRIDGE: Final = 10
#: Share of the samples of a trial that may be bridged. Noise is smaller in bridged samples.
MOST_BRIDGED: Final = 0.02
#: A sample belongs to a time of the grid if it is so near, in periods.
ON_GRID: Final = 0.01

FloatArray = NDArray[np.float64]
Times = NDArray[np.int64]


def period_ns(times: Times) -> float:
    """Return the usual distance of ``times`` (n,) in ns; infinite if n is below 2.

    The mean over whole steps: times are rounded to ns, and what the median is off by then adds up
    over a trial.
    """
    if len(times) < 2:
        return float("inf")
    steps = np.diff(times)
    return float((times[-1] - times[0]) / np.rint(steps / np.median(steps)).sum())


def means_around(centres: Times, times: Times, values: FloatArray) -> FloatArray:
    """Return the mean of ``values`` (n,) within half a period around each of ``centres`` (k,).

    The period is that of ``centres``. This is a moving average of one period: it passes what is
    slow, has no delay, and lets nothing through at the rate of ``centres`` itself. A sample at an
    edge counts by half, in this mean and in that beside it. Times in ns, ascending.

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
    half, near = round(period / 2), round(ON_GRID * own)
    windows = [
        (np.searchsorted(times, centres - half + off), np.searchsorted(times, centres + half + off))
        for off in (-near, near)  # a sample at an edge is in one of the two
    ]
    of_each = np.array([last - first for first, last in windows])
    counts = of_each.min(axis=0)
    if counts.min() < ratio // 2:
        worst = int(counts.argmin())
        raise DataError(
            f"{counts[worst]} samples stand around {(centres[worst] - centres[0]) * 1e-9:.4f} s, "
            f"while {ratio:.3g} are usual"
        )
    level = float(values.mean())  # sums of differences keep their digits
    sums = np.concatenate([[0.0], np.cumsum(values - level)])
    total = np.sum([sums[last] - sums[first] for first, last in windows], axis=0)
    means: FloatArray = level + total / of_each.sum(axis=0)
    return means


def stale_rows(status: NDArray[np.uint32]) -> NDArray[np.bool_]:
    """Return which rows (n,) repeat an earlier one, by their status words."""
    marked: NDArray[np.bool_] = (status & np.uint32(STALE)) != 0
    return marked


def grid(times: Times) -> Times:
    """Return the regular times (k,) that ``times`` (n,) have in common, in ns, gaps filled.

    Raises:
        DataError: there is a single sample.
    """
    period = period_ns(times)
    if not np.isfinite(period):
        raise DataError("there is a single sample")
    count = round(float(times[-1] - times[0]) / period) + 1
    regular: Times = times[0] + np.rint(np.arange(count) * period).astype(np.int64)
    return regular


def on_grid(regular: Times, times: Times) -> bool:
    """Return whether all of ``times`` (n,) stand at one of the ``regular`` ones (k,)."""
    period = period_ns(regular)
    off = (times - regular[0]) / period
    return bool(np.all(np.abs(off - np.rint(off)) <= ON_GRID))


def bridge(regular: Times, times: Times, values: FloatArray) -> FloatArray:
    """Return ``values`` (n,) at the ``regular`` times (k,), short gaps bridged by straight lines.

    Raises:
        DataError: more than :data:`MOST_BRIDGED` of the samples are missing, or more than
            :data:`LONGEST_BRIDGE` in succession.
    """
    slots = np.rint((times - regular[0]) / period_ns(regular)).astype(np.int64)
    inside = (slots >= 0) & (slots < len(regular))
    slots, values = slots[inside], values[inside]
    missing = len(regular) - len(slots)
    if missing > MOST_BRIDGED * len(regular):
        raise DataError(
            f"{missing} of {len(regular)} samples ({100 * missing / len(regular):.2g} %) are "
            f"missing or late, at most {100 * MOST_BRIDGED:g} % may be"
        )
    edges = np.concatenate([[-1], slots, [len(regular)]])
    longest = int(np.max(np.diff(edges))) - 1
    if longest > LONGEST_BRIDGE:
        raise DataError(
            f"{longest} samples in succession are missing or late, at most {LONGEST_BRIDGE} may be"
        )
    bridged: FloatArray = np.interp(np.arange(len(regular)), slots, values)
    return bridged
