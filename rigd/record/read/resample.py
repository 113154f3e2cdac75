"""Converts streams of different rates to the same times; bridges samples that are missing or late.

The module averages a stream with a faster rate. Some samples may be missing, or repeat an earlier
one because the device was late. The module bridges and counts a few such samples; it refuses more,
because invented samples would look like data. For what is pointwise in time no even times are
needed: :func:`brought` brings a stream to the rows of another one.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
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
#: No straight line bridges a longer step between samples, in periods: times that jitter by half a
#: period are up to 2 apart.
LONGEST_STEP: Final = 3.0

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
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
    means, counts = _means(centres, times, values)
    if counts.min() < ratio // 2:
        worst = int(counts.argmin())
        raise DataError(
            f"{counts[worst]} samples stand around {(centres[worst] - centres[0]) * 1e-9:.4f} s, "
            f"while {ratio:.3g} are usual"
        )
    return means


def _means(
    centres: Times, times: Times, values: FloatArray
) -> tuple[FloatArray, NDArray[np.int64]]:
    """Return what :func:`means_around` does, and of how many samples each mean is, at least."""
    half, near = round(period_ns(centres) / 2), round(ON_GRID * period_ns(times))
    windows = [
        (np.searchsorted(times, centres - half + off), np.searchsorted(times, centres + half + off))
        for off in (-near, near)  # a sample at an edge is in one of the two
    ]
    of_each = np.array([last - first for first, last in windows])
    level = float(values.mean())  # sums of differences keep their digits
    sums = np.concatenate([[0.0], np.cumsum(values - level)])
    total = np.sum([sums[last] - sums[first] for first, last in windows], axis=0)
    with np.errstate(invalid="ignore"):  # where no sample is
        means: FloatArray = level + total / of_each.sum(axis=0)
    return means, of_each.min(axis=0)


class SamplingRule(Enum):
    """How the samples of a stream come to the rows of another one, in words for a report."""

    SAME = "as recorded, at the same times"
    MEAN = "the mean of the samples within half a step between rows to either side"
    LINEAR = "a straight line in time between the samples before and after"


@dataclass(frozen=True, eq=False)
class Brought:
    """Samples at the times of rows, (n,), and by which rule they came there.

    ``there`` marks the rows for which nothing had to be invented. ``curved`` (n,) are those that
    lie on straight lines without the error of these to its leading order, (t - t_0) (t_1 - t) y''/2
    (C. de Boor, A Practical Guide to Splines, 1978, ch. III); None for another rule.
    """

    values: FloatArray
    there: BoolArray
    rule: SamplingRule
    curved: FloatArray | None = None


def brought(rows: Times, times: Times, values: FloatArray) -> Brought:
    """Return ``values`` (n,) at the times of ``rows`` (k,), which may be uneven; times in ns.

    A sample that stands at the time of a row belongs to it. Of a stream with at least
    ``LEAST_RATIO`` samples for each row it is the mean of those around the row
    (:func:`means_around`), of any other one it lies on the straight line between the samples before
    and after, which are at most ``LONGEST_STEP`` periods apart.
    """
    period, own = period_ns(rows), period_ns(times)
    if not np.isfinite(own):
        at = np.searchsorted(times, rows).clip(0, len(times) - 1)
        return Brought(values[at], times[at] == rows, SamplingRule.SAME)
    if period / own >= LEAST_RATIO:
        means, counts = _means(rows, times, values)
        there = counts >= period / own // 2
        return Brought(np.where(there, means, 0.0), there, SamplingRule.MEAN)
    after = np.searchsorted(times, rows).clip(1, len(times) - 1)
    before = after - 1
    nearest = np.where(rows - times[before] < times[after] - rows, before, after)
    same = np.abs(times[nearest] - rows) <= ON_GRID * own
    inside = (rows >= times[0]) & (rows <= times[-1])
    there = same | (inside & (times[after] - times[before] <= LONGEST_STEP * own))
    if np.all(same | ~there):
        return Brought(values[nearest], there, SamplingRule.SAME)
    at_s, own_s = ((item - times[0]) * 1e-9 for item in (rows, times))
    at_s = np.where(same, own_s[nearest], at_s)
    lines = np.interp(at_s, own_s, values)
    if len(values) < 3:
        return Brought(lines, there, SamplingRule.LINEAR, lines)
    bend = 2.0 * np.diff(np.diff(values) / np.diff(own_s)) / (own_s[2:] - own_s[:-2])
    bend = np.concatenate([bend[:1], bend, bend[-1:]])
    bulge = 0.25 * (at_s - own_s[before]) * (own_s[after] - at_s) * (bend[before] + bend[after])
    return Brought(lines, there, SamplingRule.LINEAR, lines - np.where(inside, bulge, 0.0))


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
