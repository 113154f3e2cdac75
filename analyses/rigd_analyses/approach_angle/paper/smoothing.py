"""Smooths signals iteratively and differentiates them by central differences (paper, Eq. 10).

Each iteration subtracts the straight line through the first and the last sample, filters the rest
forward and backward with a first-order Butterworth low-pass, and adds the line again. Then it takes
a moving average and keeps the samples whose window lies wholly inside the signal.

With the default settings, at 9600 samples per second, all iterations together have their -3 dB
frequency at 9.6 Hz, not at the 20 Hz of the last low-pass. The speeds pass all iterations a second
time, after the differentiation; their -3 dB frequency is 6.7 Hz.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.signal import filtfilt, lfilter

from rigd_analyses.approach_angle.paper.settings import Ends, PaperSettings
from rigd_analyses.approach_angle.raw.run_data import FloatArray


def butterworth(cutoff_hz: float, rate_hz: float) -> tuple[FloatArray, FloatArray]:
    """Return numerator and denominator of the first-order low-pass, by the bilinear transform.

    What ``scipy.signal.butter(1, ...)`` returns, which takes as long as the filter itself.
    """
    k = np.tan(np.pi * cutoff_hz / rate_hz)
    return np.array([k, k]) / (1.0 + k), np.array([1.0, (k - 1.0) / (k + 1.0)])


def smooth(signals: FloatArray, rate_hz: float, settings: PaperSettings) -> FloatArray:
    """Return ``signals`` (k, n) smoothed, (k, n - settings.lost): the same number off either end.

    The first sample belongs to the time of sample ``settings.lost // 2`` of the input.
    """
    for cutoff_hz, count in zip(settings.cutoffs_hz, settings.averages, strict=True):
        numerator, denominator = butterworth(cutoff_hz, rate_hz)
        ends = signals[:, [0, -1]]
        line = ends[:, :1] + np.diff(ends) * np.linspace(0.0, 1.0, signals.shape[1])
        level = signals - line
        if settings.ends is Ends.ZERO:
            forward = lfilter(numerator, denominator, level)
            level = lfilter(numerator, denominator, forward[:, ::-1])[:, ::-1]
        else:
            level = filtfilt(numerator, denominator, level)
        half = count // 2
        signals = uniform_filter1d(level + line, count)[:, half : signals.shape[1] - half]
    return signals


def central_difference(t_s: FloatArray, signals: FloatArray) -> FloatArray:
    """Return d(signals)/dt (k, n - 2) at the times ``t_s[1:-1]``: Eq. 10."""
    return np.asarray((signals[:, 2:] - signals[:, :-2]) / (t_s[2:] - t_s[:-2]))
