"""Gives the mean of correlated samples a standard uncertainty that counts their correlation.

Samples of a filtered sensor, or of friction that wanders slowly, are not independent: s / sqrt(n)
is then too small, by a factor of ten and more at 1 kHz. The integrated autocorrelation time tau (in
samples, 1/2 for white noise) is summed up to a window that the data choose, and the variance of the
mean is 2 tau s^2 / n (Sokal, Monte Carlo Methods in Statistical Mechanics, 1996, sec. 3). The mean
that is subtracted makes it too small by a share of (2 window + 1) / n, which is added again (Wolff,
Comput. Phys. Commun. 156, 143, sec. 3.1).

A sensor that rounds to steps q moves the mean of samples too: more samples do not help, noise does.
The error of rounding is a saw tooth over the value, and its mean over normal noise of standard
deviation s is, but for what is smaller, q/pi exp(-2 pi^2 s^2/q^2) sin(2 pi value/q).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import NormalDist
from typing import Final

import numpy as np
from numpy.typing import NDArray

#: The window reaches so many tau (Sokal takes 4 to 10).
_WINDOW: Final = 6.0
#: The window is never shorter, in samples: with less, a correlation that alternates is cut short.
_LEAST_LAG: Final = 10.0
#: A mean of fewer independent samples than this gets no uncertainty: its tau is not known either.
LEAST_INDEPENDENT: Final = 30.0
#: Values that differ by less than this share are equal: rounding leaves as much.
EQUAL: Final = 1e-12


@dataclass(frozen=True)
class Mean:
    """A mean with its standard uncertainty ``u`` (None: not determined) and why there is none.

    ``independent`` is how many independent samples would have the uncertainty without ``hidden``,
    the part of it in what a step of the sensor hides.
    """

    value: float
    u: float | None
    independent: float
    reason: str = ""
    hidden: float = 0.0


def hidden_by_step(values: NDArray[np.float64]) -> float:
    """Return the standard uncertainty of the mean of ``values`` (n,) in what a step hides; or 0.

    Values that come again are rounded. If there are but two, the noise may be much less than the
    step between them, and the mean off by up to half of it (JCGM 100:2008, F.2.2.1).
    """
    levels, counts = np.unique(values, return_counts=True)
    apart = np.diff(levels) > EQUAL * np.max(np.abs(levels))
    if not apart.any() or len(levels) == len(values):
        return 0.0
    most = float(np.min(np.diff(levels)[apart])) / math.sqrt(12.0)
    edges = (0.5 * (levels[1:] + levels[:-1]))[apart]
    below = (np.cumsum(counts)[:-1] / len(values))[apart]
    if len(edges) == 1:
        return most
    near = np.sort(np.argsort(np.abs(below - 0.5))[:2])
    step = float(np.diff(edges[near])[0])
    low, high = (NormalDist().inv_cdf(float(share)) for share in below[near])
    noise = 1.0 / (high - low)  # standard deviation over step: it has these shares at these edges
    return min(step / (math.pi * math.sqrt(2.0)) * math.exp(-2.0 * (math.pi * noise) ** 2), most)


def mean_of(values: NDArray[np.float64], *, rounded: bool = True) -> Mean:
    """Return the mean of ``values`` (n,), evenly spaced, with its standard uncertainty.

    That is of type A, and of what a step of the sensor hides: not of values that are not
    ``rounded``, such as those of a switch.
    """
    n, value = len(values), float(np.mean(values))
    if n < LEAST_INDEPENDENT:
        few = f"{n} samples are too few for an uncertainty"
        return Mean(value, None, float(n), few, hidden_by_step(values) if rounded else 0.0)
    deviations = values - value
    scale = float(np.max(np.abs(deviations)))
    if scale <= 1e-15 * abs(value):  # all are one number
        return Mean(value, None, 0.0, "its samples are all equal: a step of the sensor hides noise")
    hidden = hidden_by_step(values) if rounded else 0.0
    deviations /= scale  # the squares of extreme values are no numbers
    size = 1 << (2 * n - 1).bit_length()
    spectrum = np.abs(np.fft.rfft(deviations, size)) ** 2
    covariance = np.fft.irfft(spectrum, size)[:n] / (n - np.arange(n))
    tau = np.cumsum(covariance) / covariance[0] - 0.5
    lags = np.arange(n)
    enough = np.flatnonzero(lags >= np.maximum(_WINDOW * tau, _LEAST_LAG))
    lag = int(enough[0]) if enough.size else n - 1
    used = float(max(tau[lag], 0.5 / n))
    # The subtracted mean makes each covariance too small by the variance of the mean itself.
    inflation = 1.0 + (2 * lag + 1) / n
    independent = n / (2 * used * inflation)
    if not enough.size or independent < LEAST_INDEPENDENT:
        reason = (
            "its samples go together for too long: fewer than 30 are independent; a longer "
            "'during' has more"
        )
        return Mean(value, None, independent, reason, hidden)
    u = scale * float(np.sqrt(2 * used * inflation * covariance[0] * n / (n - 1) / n))
    return Mean(value, math.hypot(u, hidden), min(independent, float(n)), hidden=hidden)
