"""Computes position, speed and acceleration from a noisy position (Rauch-Tung-Striebel smoother).

The model of the position is the third integral of white noise (jerk), measured in white noise. For
this model the smoother weighs a frequency f by 1/(1 + (f/f_c)^6); the ratio of the two noises sets
f_c. The smoother has no phase shift, and its ends need no padding. At the ends the filter of the
paper loses up to 8 % of the speed.

Source: Rauch, Tung and Striebel, "Maximum likelihood estimates of linear dynamic systems", AIAA
Journal 3 (1965) 1445-1450.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rigd.analysis.kernel import kernel
from rigd.analysis.recordings.noise import white_noise
from rigd_analyses.approach_angle.raw.run_data import FloatArray

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
    noise = max(white_noise(measured, 3), 1e-12 * (1.0 + float(np.ptp(measured))))
    density = noise**2 * period_s * (2.0 * math.pi * cutoff_hz) ** 6
    states, variance = _smooth(measured - measured[0], period_s, noise**2, density)
    return Track(
        states[:, 0] + measured[0], states[:, 1], states[:, 2], np.sqrt(np.maximum(variance, 0.0))
    )


@kernel
def _smooth(y: FloatArray, h: float, r: float, q: float) -> tuple[FloatArray, FloatArray]:
    """Return smoothed states (n, 3) and the variance of the speed (n,).

    ``r`` variance of a measurement, ``q`` spectral density of the jerk.

    Products and solutions of 3 x 3 are written out in :func:`_times` and :func:`_solved`: those of
    numpy take numba 14 s to compile, and go through BLAS, whose last bits differ between machines.
    """
    n = y.shape[0]
    step = np.array([[1.0, h, 0.5 * h * h], [0.0, 1.0, h], [0.0, 0.0, 1.0]])
    drive = np.array(
        [
            [q * h**5 / 20.0, q * h**4 / 8.0, q * h**3 / 6.0],
            [q * h**4 / 8.0, q * h**3 / 3.0, q * h**2 / 2.0],
            [q * h**3 / 6.0, q * h**2 / 2.0, q * h],
        ]
    )
    states, spread, ahead = np.empty((n, 3)), np.empty((n, 3, 3)), np.empty((n, 3, 3))
    width = (r * h / q) ** (1.0 / 6.0)  # the smoother's own time constant, s
    x, stepped = np.zeros(3), np.zeros(3)
    p, product = np.zeros((3, 3)), np.empty((3, 3))
    for i in range(3):
        p[i, i] = DIFFUSE * r * width ** (-2.0 * i)
    for k in range(n):
        if k > 0:
            _advance(step, x, stepped)
            x[:] = stepped
            _times(step, p, product)
            _times(product, step.T, p)
            p += drive
        ahead[k] = p
        surprise, total = y[k] - x[0], p[0, 0] + r
        for i in range(3):
            x[i] += p[i, 0] / total * surprise
        for i in range(3):
            for j in range(3):
                product[i, j] = p[i, j] - p[i, 0] * p[0, j] / total
        for i in range(3):
            for j in range(3):
                p[i, j] = 0.5 * (product[i, j] + product[j, i])
        states[k], spread[k] = x, p
    variance = np.empty(n)
    variance[n - 1] = p[1, 1]
    back = np.empty((3, 3))
    for k in range(n - 2, -1, -1):
        _times(step, spread[k], product)
        _solved(ahead[k + 1], product, back)  # the transpose of the smoother's gain
        _advance(step, states[k], stepped)
        for i in range(3):
            for j in range(3):
                states[k, i] += back[j, i] * (states[k + 1, j] - stepped[j])
        p -= ahead[k + 1]
        _times(p, back, product)
        _times(back.T, product, p)
        p += spread[k]
        variance[k] = p[1, 1]
    return states, variance


@kernel
def _advance(a: FloatArray, x: FloatArray, out: FloatArray) -> None:
    """Write ``a`` (3, 3) times ``x`` (3,) to ``out`` (3,)."""
    for i in range(3):
        out[i] = a[i, 0] * x[0] + a[i, 1] * x[1] + a[i, 2] * x[2]


@kernel
def _times(a: FloatArray, b: FloatArray, out: FloatArray) -> None:
    """Write ``a`` times ``b`` to ``out``, (3, 3) each and all different."""
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]


@kernel
def _solved(a: FloatArray, b: FloatArray, out: FloatArray) -> None:
    """Write the solution X of ``a`` X = ``b`` to ``out``, (3, 3) each; ``a`` positive definite."""
    low = np.zeros((3, 3))  # a = low low^T, Cholesky
    for i in range(3):
        for j in range(i + 1):
            left = a[i, j]
            for m in range(j):
                left -= low[i, m] * low[j, m]
            low[i, j] = math.sqrt(left) if i == j else left / low[j, j]
    for c in range(3):
        for i in range(3):
            out[i, c] = b[i, c]
            for m in range(i):
                out[i, c] -= low[i, m] * out[m, c]
            out[i, c] /= low[i, i]
        for i in range(2, -1, -1):
            for m in range(i + 1, 3):
                out[i, c] -= low[m, i] * out[m, c]
            out[i, c] /= low[i, i]
