"""Removes the monitor's noise from the motor current with which a trial is simulated.

A simulation adds up every error of its input, and friction rectifies noise if the slip is small.
Between jumps the current is smooth (constant, or falling at the voltage limit), and a polynomial
filter removes the noise there. The filter never reaches across a jump. Its window is as wide at
each sample as the current permits: the confidence intervals of filters with increasing windows are
intersected until the intersection is empty (ICI rule: Goldenshluger and Nemirovski, Math. Meth.
Stat. 6, 1997; Katkovnik, IEEE Trans. Signal Processing 47, 1999).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.ndimage import minimum_filter1d
from scipy.signal import savgol_filter

from rigd.analysis.recordings.noise import white_noise
from rigd.analysis.result import FloatArray

ORDER = 2
JUMP_SDS = 8.0  #: standard deviations of the monitor that a jump of the current exceeds
LEAST_JUMP_A = 0.03
DOUBLINGS = 5  #: of the window
CONFIDENCE = 2.5  #: standard deviations of a filter's noise to either side


@dataclass(frozen=True, eq=False)
class SimulatedCurrent:
    """``current_a`` (n,) at the samples; ``jumps`` (n,) is 1 if it jumps behind a sample."""

    current_a: FloatArray
    jumps: FloatArray
    noise_a: float  #: standard deviation of the monitor


def simulated_current(measured_a: FloatArray, window: int) -> SimulatedCurrent:
    """Return the current without noise, from filters of ``window`` samples (odd) and more."""
    steps, noise = np.diff(measured_a), white_noise(measured_a, jump=LEAST_JUMP_A)
    threshold = max(JUMP_SDS * noise, LEAST_JUMP_A)
    edges = np.flatnonzero(np.abs(steps) > threshold) + 1
    smooth = measured_a.astype(np.float64)
    for begin, end in zip([0, *edges], [*edges, len(measured_a)], strict=True):
        smooth[begin:end] = _smoothed(smooth[begin:end], window, noise)
    jumps = np.zeros(len(measured_a))
    jumps[edges - 1] = 1.0
    return SimulatedCurrent(smooth, jumps, noise)


def _smoothed(values: FloatArray, window: int, noise: float) -> FloatArray:
    """Return ``values`` (n,) without their noise, each sample from the widest window that fits."""
    count = len(values)
    window = min(window, count - 1 + count % 2)
    if window <= ORDER + 1:
        return values
    found = np.empty(count)
    chosen = np.zeros(count, dtype=np.intp)
    filtered = []
    low, high = np.full(count, -np.inf), np.full(count, np.inf)
    agree = np.ones(count, dtype=np.bool_)
    for index in range(DOUBLINGS + 1):
        wide = (window - 1) * 2**index + 1
        if wide > count:
            break
        filtered.append(savgol_filter(values, wide, ORDER, mode="interp"))
        reach = CONFIDENCE * noise * _noise_gain(wide, count)
        low, high = np.maximum(low, filtered[-1] - reach), np.minimum(high, filtered[-1] + reach)
        agree &= low <= high
        chosen[agree] = index
    # Beside a kink the wider window has not noticed it yet.
    chosen = minimum_filter1d(chosen, window)
    for index, part in enumerate(filtered):
        at = chosen == index
        found[at] = part[at]
    return found


def _noise_gain(window: int, count: int) -> FloatArray:
    """Return the standard deviation (n,) of what the filter leaves of white noise of 1."""
    gain = _gain(window)
    half = window // 2
    out = np.full(count, gain[half])
    out[:half], out[count - half :] = gain[:half], gain[half + 1 :]
    return out


@cache
def _gain(window: int) -> FloatArray:
    """Return the root of the leverage (window,) of a least-squares polynomial."""
    basis, _ = np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, window), ORDER + 1))
    return np.asarray(np.sqrt(np.sum(basis**2, axis=1)))
