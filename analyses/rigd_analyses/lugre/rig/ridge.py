"""Moves along the ridge on which V_s, mu_c and mu_s stand in for one another.

With slip far from V_s the data show g at that slip alone: any V_s fits about as well, with its own
mu_c and mu_s. The ridge is bent, and a straight line from a fit soon leaves it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from scipy.stats import chi2

from rigd.analysis.fitting.profile import ProfileScan
from rigd.analysis.output_error.estimator import OutputErrorFit
from rigd.analysis.result import FloatArray
from rigd_analyses.lugre.model import MU_C, PARAMETERS, RATIO, V_S, friction
from rigd_analyses.lugre.rig.standard_errors import FRICTION

SHOWN = 0.999  #: level at which the data show a Stribeck effect
RIDGE_M_S = (5e-3, 5e-2, 0.5)  #: V_s of starts along the ridge
KEPT_M_S = (5e-3, 0.1)  #: slips whose friction they keep
FAR = 10.0  #: V_s over the end of the slip, or the other way round
KNOWN_SD = 0.1  #: standard deviation of ln V_s below which there is no ridge


def along_ridge(whole: OutputErrorFit) -> list[FloatArray]:
    """Return points (p,) with another V_s each, and the same friction at two slips.

    None, if the data determine V_s by itself.
    """
    theta = whole.fit.theta
    return [with_speed(theta, speed) for speed in RIDGE_M_S] if on_ridge(whole) else []


def on_ridge(whole: OutputErrorFit) -> bool:
    """Whether the data may not tell V_s from other ways to have the same friction."""
    sd = math.sqrt(max(float(whole.covariance[V_S, V_S]), 0.0))
    return not (sd < KNOWN_SD and KEPT_M_S[0] / 5.0 < whole.fit.theta[V_S] < KEPT_M_S[1])


def with_speed(theta: FloatArray, speed: float) -> FloatArray:
    """Return ``theta`` (p,) with V_s = ``speed`` in m/s and the same friction at two slips.

    That is at the first alone if both would take mu_s below mu_c, or no mu_c (Eq. 6).
    """
    kept = friction(theta[:FRICTION], np.array(KEPT_M_S))
    low, high = (math.exp(-math.sqrt(slip / speed)) for slip in KEPT_M_S)
    least = PARAMETERS[MU_C].low
    coulomb = max((kept[1] * low - kept[0] * high) / (low - high), least)
    static = max((kept[0] - coulomb * (1.0 - low)) / low, coulomb)
    out = theta.copy()
    out[[V_S, MU_C, RATIO]] = speed, coulomb, math.log(static / coulomb)
    return out


def unseen(
    theta: FloatArray, visited: tuple[float, float], index: int
) -> Callable[[float], FloatArray | None]:
    """Return the branch of a profile on which V_s is beyond the ``visited`` slip in m/s, or below.

    Of the logarithm of mu_c (``MU_C``) it has V_s above, of that of mu_s (``RATIO``) V_s below, and
    the same friction at the end of the slip: within the slip it hardly changes, and one of the two
    is g where no data are. No path may lead there from a fit with V_s elsewhere, or with mu_s =
    mu_c, at which V_s means nothing.
    """
    there = float(friction(theta[:FRICTION], np.array([visited[1]]))[0])

    def point(value: float) -> FloatArray | None:
        held = math.exp(value)
        speed = (FAR if index == MU_C else 1.0 / FAR) * visited[1]
        fallen = math.exp(-math.sqrt(visited[1] / speed))
        if index == MU_C:
            coulomb, static = held, held + (there - held) / fallen
        else:
            coulomb, static = (there - held * fallen) / (1.0 - fallen), held
        if not 0.0 < coulomb <= static:
            return None
        out = theta.copy()
        out[[V_S, MU_C, RATIO]] = speed, coulomb, math.log(static / coulomb)
        return out

    return point


def bent(theta: FloatArray, value: float) -> FloatArray:
    """Return ``theta`` (p,) with ln V_s = ``value``: where a refit of its profile begins."""
    return with_speed(theta, math.exp(value))


def effect_shown(ratio: ProfileScan, doubt: float) -> bool:
    """Whether mu_s = mu_c fits worse than chance and doubt make it: only then there is a V_s.

    ``doubt`` is the standard error of the effect over that by which the profile rises. The V_s that
    fits chance best is chosen from all, so that the statistic of no effect has no distribution of
    one degree of freedom (Davies, Biometrika 64, 1977); and a wrong V_s is far off.
    """
    if ratio.low is None:
        return False
    best = float(ratio.values[np.argmin(ratio.statistic)])
    none = ratio.statistic[ratio.values == 0.0]
    # Far from the interval no refit was made: there the root of the statistic is straight.
    rise = float(none[0]) if none.size else ratio.threshold * (best / (best - ratio.low)) ** 2
    return bool(rise / doubt**2 > chi2.ppf(SHOWN, 2))


def without_effect(scans: Mapping[str, ProfileScan]) -> dict[str, ProfileScan]:
    """Return ``scans`` as data that show no Stribeck effect leave them: V_s is open."""
    open_ratio = replace(scans["ratio"], low=None)
    return {**scans, "ratio": open_ratio, "V_s": replace(scans["V_s"], low=None, high=None)}
