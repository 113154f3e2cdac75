"""Gives the mean of correlated samples a standard uncertainty that counts their correlation.

Samples of a filtered sensor, or of friction that wanders slowly, are not independent: s / sqrt(n)
is then too small, by a factor of ten and more at 1 kHz. The variance of the mean is S(0)/n, with
the spectral density S at frequency 0. An autoregression of the samples gives it (M. B. Priestley,
Spectral Analysis and Time Series, 1981, sec. 7.8): its coefficients by Burg's recursion, its order
by the criterion of Hannan and Quinn, S(0) = error variance / (1 - sum of coefficients)^2. Hum of
the mains has no part in it, as it hardly moves the mean. Many samples are first taken together to a
few hundred means of neighbours: fast noise else hides the slow wander beneath it.

An S(0) from few samples is itself uncertain: u holds that by Student's t, so that mean +- 1.96 u
holds the truth in 95 of 100 cases.

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

#: So many means of neighbours or more represent the samples: their number does not widen u by more
#: than 2 %, and less noise hides slow wander (of white noise with a tenth of wander over 100
#: samples, 5000 of them: 96 of 100 intervals hold the truth instead of 84).
_LEAST_BLOCKS: Final = 250
#: A mean of fewer samples gets no uncertainty.
LEAST_SAMPLES: Final = 30
#: Nor does one whose uncertainty has fewer degrees of freedom: that is known from fewer than ten
#: independent samples.
_LEAST_FREEDOM: Final = 5.0
#: The subtracted mean and the fit make S(0) too small, by so much in its logarithm for each part of
#: its uncertainty (1 / independent samples) and of 1/n: found on white and AR(1) noise of 30 to 200
#: samples.
_BIAS: Final = (2.5, 2.0)
#: So many of the lowest frequencies show a drift, which is named in so many cases without one.
_LOWEST: Final = 4
_FALSE_ALARM: Final = 1e-3
#: Share of the variance below which an autoregression predicts all: rounding leaves as much.
_PREDICTED: Final = 1e-12
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
    if n < LEAST_SAMPLES:
        few = f"{n} samples are too few for an uncertainty"
        return Mean(value, None, float(n), few, hidden_by_step(values) if rounded else 0.0)
    deviations = values - value
    scale = float(np.max(np.abs(deviations)))
    if scale <= 1e-15 * abs(value):  # all are one number
        return Mean(value, None, 0.0, "its samples are all equal: a step of the sensor hides noise")
    hidden = hidden_by_step(values) if rounded else 0.0
    deviations /= scale  # the squares of extreme values are no numbers
    length = max(1, n // _LEAST_BLOCKS)
    count = n // length
    blocks = deviations[: count * length].reshape(count, length).mean(axis=1)
    blocks -= blocks.mean()
    density, freedom = _at_frequency_0(blocks)
    if _wanders(blocks, density, freedom):
        freedom = 0.0
    variance = density * length / n
    independent = float(deviations @ deviations) / (n - 1) / variance if variance else float(n)
    if freedom < _LEAST_FREEDOM:
        reason = (
            "its samples go together for too long: fewer than 10 are independent; a longer "
            "'during' has more"
        )
        return Mean(value, None, min(independent, float(n)), reason, hidden)
    from scipy.stats import norm, t

    u = scale * math.sqrt(variance) * float(t.ppf(0.975, freedom) / norm.ppf(0.975))
    return Mean(value, math.hypot(u, hidden), min(independent, float(n)), hidden=hidden)


def _at_frequency_0(values: NDArray[np.float64]) -> tuple[float, float]:
    """Return the spectral density at frequency 0 of ``values`` (n,) with mean 0, and its freedom.

    The density of white noise is its variance. The coefficients a of an autoregression of order p
    have the covariance e_p/n inverse(C), with the covariance C of p samples in a row, and 1'
    inverse(C) 1 is the sum of (1 - sum of a_k)^2 / e_k over the orders k below p.
    """
    n = len(values)
    ahead, behind = values, values
    coefficients = np.zeros(0)
    error = whole = float(values @ values) / n
    if whole == 0.0:
        return 0.0, float(n - 1)
    known, least, found = 0.0, math.inf, (0.0, 0.0)
    for order in range(1, max(1, min(round(10.0 * math.log10(n)), n // 10)) + 1):
        known += float(1.0 - coefficients.sum()) ** 2 / error
        ahead, behind = ahead[1:], behind[:-1]
        reflection = 2.0 * float(ahead @ behind) / float(ahead @ ahead + behind @ behind)
        coefficients = np.append(coefficients - reflection * coefficients[::-1], reflection)
        ahead, behind = ahead - reflection * behind, behind - reflection * ahead
        error = max(error * (1.0 - reflection**2), _PREDICTED * whole)
        criterion = n * math.log(error / whole) + 2.0 * (order + 1) * math.log(math.log(n))
        if criterion < least:
            least = criterion
            gain = 1.0 / max(float(1.0 - coefficients.sum()) ** 2, _PREDICTED)
            spare = error * known * gain / n
            density = error * n / (n - order - 1) * gain
            bias = math.exp(min(_BIAS[0] * spare + _BIAS[1] / n, 100.0))
            found = density * bias, 2.0 / (2.0 / n + 4.0 * spare)
        if error <= _PREDICTED * whole:
            break
    return found


def _wanders(values: NDArray[np.float64], density: float, freedom: float) -> bool:
    """Whether ``values`` (n,) move slowly by more than noise of ``density`` does, as in a drift."""
    from scipy.stats import f

    n = len(values)
    angles = np.pi / n * (np.arange(n) + 0.5)
    lowest = np.cos(np.outer(np.arange(1, _LOWEST + 1), angles)) @ values * math.sqrt(2.0 / n)
    mean_square = float(np.mean(lowest**2))
    return mean_square > density * float(f.isf(_FALSE_ALARM, _LOWEST, max(freedom, 1.0)))
