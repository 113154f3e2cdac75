"""Position, speed and acceleration from a noisy position: a Rauch-Tung-Striebel smoother.

The position is taken as the third integral of white noise (jerk), measured in white noise. For
such a pair the smoother weighs a frequency f by 1/(1 + (f/f_c)^6), where the ratio of the two
noises sets f_c; it has no phase, and its ends need no padding, which is where the paper's filter
loses up to 8 % of the speed.

Source: Rauch, Tung and Striebel, "Maximum likelihood estimates of linear dynamic systems", AIAA
Journal 3 (1965) 1445-1450.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rigd.analysis.kernel import kernel
from rigd_analyses.approach_angle.data import FloatArray

#: Start of the filter: this many times the variance that its first steps leave means "unknown".
DIFFUSE = 1e8


@dataclass(frozen=True, eq=False)
class Track:
    """Smoothed motion, shape (n,) each, and the standard uncertainty of the speed (n,)."""

    position: FloatArray
    speed: FloatArray
    acceleration: FloatArray
    speed_u: FloatArray


def smooth(measured: FloatArray, period_s: float, cutoff_hz: float) -> Track:
    """Return the motion behind ``measured`` (n,), sampled every ``period_s``; n >= 4.

    ``cutoff_hz`` is the frequency of which half the amplitude is kept. The measurement noise is
    taken from the data's third differences. Units are those of ``measured``, per s, per s^2.
    """
    if measured.size < 4:
        raise ValueError(f"a track of {measured.size} samples, need at least 4")
    # Third differences of white noise of variance r have 20 r; a robust scale lets jumps be jumps.
    noise = 1.4826 * float(np.median(np.abs(np.diff(measured, 3)))) / math.sqrt(20.0)
    noise = max(noise, 1e-12 * (1.0 + float(np.ptp(measured))))
    density = noise**2 * period_s * (2.0 * math.pi * cutoff_hz) ** 6
    states, variance = _smooth(measured - measured[0], period_s, noise**2, density)
    return Track(
        states[:, 0] + measured[0], states[:, 1], states[:, 2], np.sqrt(np.maximum(variance, 0.0))
    )


@kernel
def _smooth(y: FloatArray, h: float, r: float, q: float) -> tuple[FloatArray, FloatArray]:
    """Return smoothed states (n, 3) and the variance of the speed (n,).

    ``r`` variance of a measurement, ``q`` spectral density of the jerk.
    """
    n = y.shape[0]
    step = np.array([[1.0, h, 0.5 * h * h], [0.0, 1.0, h], [0.0, 0.0, 1.0]])
    drive = q * np.array(
        [
            [h**5 / 20.0, h**4 / 8.0, h**3 / 6.0],
            [h**4 / 8.0, h**3 / 3.0, h**2 / 2.0],
            [h**3 / 6.0, h**2 / 2.0, h],
        ]
    )
    filtered, states = np.empty((n, 3)), np.empty((n, 3))
    spread, ahead = np.empty((n, 3, 3)), np.empty((n, 3, 3))
    width = (r * h / q) ** (1.0 / 6.0)  # the smoother's own time constant, s
    x = np.zeros(3)
    p = np.diag(DIFFUSE * r * np.array([1.0, width**-2, width**-4]))
    for k in range(n):
        if k > 0:
            x = step @ x
            p = step @ p @ step.T + drive
        ahead[k] = p
        gain = p[:, 0] / (p[0, 0] + r)
        x = x + gain * (y[k] - x[0])
        p = p - np.outer(gain, p[0])
        p = 0.5 * (p + p.T)
        filtered[k], spread[k] = x, p
    variance = np.empty(n)
    states[n - 1], variance[n - 1] = x, p[1, 1]
    for k in range(n - 2, -1, -1):
        back = np.linalg.solve(ahead[k + 1], step @ spread[k]).T
        states[k] = filtered[k] + back @ (states[k + 1] - step @ filtered[k])
        p = spread[k] + back @ (p - ahead[k + 1]) @ back.T
        variance[k] = p[1, 1]
    return states, variance
