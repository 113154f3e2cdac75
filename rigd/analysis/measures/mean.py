"""Gives the mean of correlated samples a standard uncertainty that counts their correlation.

Samples of a filtered sensor, or of friction that wanders slowly, are not independent: s / sqrt(n)
is then too small, by a factor of ten and more at 1 kHz. The integrated autocorrelation time tau (in
samples, 1/2 for white noise) is summed up to a window that the data choose, and the variance of the
mean is 2 tau s^2 / n (Sokal, Monte Carlo Methods in Statistical Mechanics, 1996, sec. 3). The mean
that is subtracted makes it too small by a share of (2 window + 1) / n, which is added again (Wolff,
Comput. Phys. Commun. 156, 143, sec. 3.1).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

#: The window reaches so many tau (Sokal takes 4 to 10).
_WINDOW: Final = 6.0
#: The window is never shorter, in samples: with less, a correlation that alternates is cut short.
_LEAST_LAG: Final = 10.0
#: A mean of fewer independent samples than this gets no uncertainty: its tau is not known either.
LEAST_INDEPENDENT: Final = 30.0


@dataclass(frozen=True)
class Mean:
    """A mean with its standard uncertainty ``u`` (None: not determined) and why there is none.

    ``independent`` is how many independent samples would have that uncertainty.
    """

    value: float
    u: float | None
    independent: float
    reason: str = ""


def mean_of(values: NDArray[np.float64]) -> Mean:
    """Return the mean of ``values`` (n,), evenly spaced, with its type A standard uncertainty."""
    n, value = len(values), float(np.mean(values))
    if n < LEAST_INDEPENDENT:
        return Mean(value, None, float(n), f"{n} samples are too few for an uncertainty")
    deviations = values - value
    scale = float(np.max(np.abs(deviations)))
    if scale <= 1e-15 * abs(value):  # all are one number
        return Mean(value, None, 0.0, "its samples are all equal: a step of the sensor hides noise")
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
        return Mean(value, None, independent, reason)
    u = scale * float(np.sqrt(2 * used * inflation * covariance[0] * n / (n - 1) / n))
    return Mean(value, u, min(independent, float(n)))
