"""Estimates the noise of a sensor from its samples alone."""

from __future__ import annotations

import math

import numpy as np

from rigd.analysis.result import FloatArray

MAD_TO_SIGMA = 1.4826  #: standard deviation over the median of the sizes, of a normal distribution
USUAL_SDS = 5.0  #: by the median, of differences that are noise


def white_noise(values: FloatArray, order: int = 2, jump: float = math.inf) -> float:
    """Return the standard deviation of white noise and of rounding in ``values`` (n,).

    It is that of the differences of ``order``: a smooth motion leaves them alone.
    """
    return noise_of_differences(np.diff(values, order), order, jump)


def noise_of_differences(differences: FloatArray, order: int, jump: float = math.inf) -> float:
    """Return the standard deviation of the noise whose ``differences`` of ``order`` (n,) these are.

    They have (2 order)!/order!^2 times the variance. Those that noise does not explain do not
    count: jumps and spikes; if most are 0, those beyond ``jump``. Medians of rounded differences
    are whole steps: of noise of two steps they are up to 30 % off.
    """
    sizes = np.abs(differences)
    if not sizes.size:
        return 0.0
    typical = MAD_TO_SIGMA * float(np.median(sizes))
    usual = sizes[sizes <= (USUAL_SDS * typical if typical > 0.0 else jump)]
    return float(np.sqrt(np.mean(usual**2) / math.comb(2 * order, order))) if usual.size else 0.0
