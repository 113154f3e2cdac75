"""Tests whether whitened residuals are white, have unit variance, and have no jumps.

If the model is right, its residuals look like the noise of input and sensors at every frequency.
The tests need no candidate for what is wrong, so they also find errors without a known cause.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2, norm

from rigd.analysis.result import BoolArray, FloatArray

EXCESS = 1.15  #: variance over that of the noise from which an output shows more than noise
LOUD = 2.0  #: power of a band over that of the output's noise from which it counts
BANDS = 64  #: of frequencies up to half the rate; each a test


@dataclass(frozen=True)
class LoudBand:
    """The band of frequencies in which an output shows most above its noise, up to ``high_hz``."""

    output: int
    low_hz: float
    high_hz: float
    ratio: float
    p_value: float


@dataclass(frozen=True)
class Jump:
    """The largest whitened residual: its output, trial, sample, size in standard deviations."""

    output: int
    trial: int
    sample: int
    size: float
    p_value: float


@dataclass(frozen=True)
class Shape:
    """Where most of a misfit is: its trial, the samples from ``begin`` to ``end``, its frequency.

    Between the samples lies the middle half of the squared residuals; half of their power is below
    ``frequency``, in cycles for each sample.
    """

    trial: int
    begin: int
    end: int
    frequency: float


def levels(white: Sequence[FloatArray], there: Sequence[BoolArray] | None = None) -> list[float]:
    """Return the mean square of each output's whitened residuals (n, m); noise alone leaves 1.

    ``there`` (n, m) are the readings that there are, all if not given; an output without any has 0.
    """
    together = np.concatenate(white)
    readings = np.ones(together.shape) if there is None else np.concatenate(there)
    counts = np.maximum(np.count_nonzero(readings, axis=0), 1)
    return [float(x) for x in np.sum(together**2 * readings, axis=0) / counts]


def loudest_band(
    white: Sequence[FloatArray], period_s: float, counted: Sequence[FloatArray] | None = None
) -> LoudBand:
    """Return the band in which the pooled periodogram of an output exceeds its noise most.

    Bands below ``LOUD`` times the noise do not count: p is 1 without any. ``counted`` (n, m) are
    the errors of counting: the tones that these make at a steady speed are noise.

    Under whiteness the sum of a trial's periodogram over k Fourier frequencies is chi-square with
    2 k degrees of freedom (Brockwell and Davis, Time Series, 1991, sec. 10.3); trials add. The
    level of the noise is the output's own median over the bands: a loud sensor is not coloured.
    """
    edges = np.linspace(0.0, 0.5, BANDS + 1)
    best = LoudBand(0, 0.0, 0.0, 1.0, 1.0)
    for output in range(white[0].shape[1]):
        power, count = _by_band([part[:, output] for part in white])
        there = np.flatnonzero(count)  # a short trial has no frequency in some bands
        noise = np.full(BANDS, np.median(power[there]))
        if counted is not None:
            tones, _ = _by_band([part[:, output] for part in counted])
            noise += np.maximum(tones - np.median(tones[there]), 0.0)
        for band in there:
            ratio = power[band] / noise[band]
            if ratio < LOUD:
                continue
            p_value = float(chi2.sf(ratio * count[band], count[band]))
            p_value = min(1.0, p_value * BANDS * white[0].shape[1])
            if p_value < best.p_value:
                ends = edges[band : band + 2] / period_s
                best = LoudBand(output, float(ends[0]), float(ends[1]), float(ratio), p_value)
    return best


def _by_band(parts: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Return the mean power of ``parts`` (n,) in each band, 1 of white noise, and its freedom."""
    power, count = np.zeros(BANDS), np.zeros(BANDS)
    for part in parts:
        spectrum = np.abs(np.fft.rfft(part)) ** 2 * 2.0 / len(part)
        frequency = np.fft.rfftfreq(len(part))[1:-1]
        edges = np.linspace(0.0, 0.5, BANDS + 1)
        place = np.minimum(np.searchsorted(edges, frequency, "right") - 1, BANDS - 1)
        np.add.at(power, place, spectrum[1:-1])
        np.add.at(count, place, 2.0)
    return power / np.maximum(count, 1.0), count


def largest_jump(white: Sequence[FloatArray], there: Sequence[BoolArray] | None = None) -> Jump:
    """Return the largest whitened residual, with the chance of one so large among all.

    ``there`` is as in :func:`levels`.
    """
    scale = np.sqrt(np.maximum(levels(white, there), 1.0))
    count = sum(part.size for part in white)
    best = Jump(0, 0, 0, 0.0, 1.0)
    for trial, part in enumerate(white):
        sizes = np.abs(part) / scale
        sample, output = np.unravel_index(int(np.argmax(sizes)), sizes.shape)
        size = float(sizes[sample, output])
        if size > best.size:
            p_value = float(min(1.0, 2.0 * norm.sf(size) * count))
            best = Jump(int(output), trial, int(sample), size, p_value)
    return best


def shape_of(white: Sequence[FloatArray], output: int) -> Shape:
    """Return where the residuals (n, m) of an ``output`` have most of their squares."""
    trial = int(np.argmax([np.mean(part[:, output] ** 2) for part in white]))
    part = white[trial][:, output]
    begin, end = (_reached(part**2, share) for share in (0.25, 0.75))
    power = np.abs(np.fft.rfft(part)) ** 2
    return Shape(trial, begin, end, _reached(power, 0.5) / max(len(part), 1))


def _reached(parts: FloatArray, share: float) -> int:
    """Return the place at which the sum of ``parts`` (n,) reaches a share of the whole."""
    return int(np.searchsorted(np.cumsum(parts), share * np.sum(parts)))
