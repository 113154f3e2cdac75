"""Fits the friction limit of one set as a function of the sliding speed, to all its runs together.

ln mu = a + b L + c L^2 with L = log10(v/1 m/s). This is the maximum of rubber friction over the
logarithm of the sliding speed (Grosch 1963), in the form mu_max exp(-h log10(v/v_peak)^2), h = -c.

Each block mean during which the wheel slides is one point. Points of one run share its surface, its
load and the drift of its gauges. The covariance is therefore the sandwich with one score per run
(Liang and Zeger 1986), corrected for a small number of runs. Tukey's biweight (started from
Huber's, on the median absolute deviation) reduces the influence of outliers.

The maximum of the curve is not the largest point. The largest point belongs to the run with the
largest error and is 3 to 6 % too high even with good runs (angle.md 3.4).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from rigd.analysis.fitting.fit import HUBER_K
from rigd_analyses.approach_angle.raw.run_data import FloatArray
from rigd_analyses.approach_angle.result import FrictionCurve

FORM = "mu = mu_max exp(-h log10(v/v_peak)^2)"
TUKEY = 4.685  #: 95 % efficient for a normal distribution, as HUBER_K (Huber 1981)
ITERATIONS = 30
PARAMETERS = 3
GRID = 60
#: Share of the points left out at either end of the range on which the curve is quoted.
ENDS = 0.05
#: How far beyond the edge a maximum that was not reached may lie: a factor of 2.5 in speed, the
#: most of 47 such sets of 26 simulated rigs.
BEYOND = math.log10(2.5)


@dataclass(frozen=True)
class Pooled:
    """The fit: the curve, its maximum and the spread between runs.

    ``maximum_u`` is its standard uncertainty from the spread between runs (k = 1; with few runs
    widened so that 2 u covers 95 %), ``scatter`` the robust relative standard deviation of the
    runs about the curve. ``at_edge``: "slow" or "fast" if the curve still rises at that end of
    the speeds; ``maximum_u`` then holds what it may rise further.
    """

    curve: FrictionCurve
    maximum: float
    maximum_u: float
    scatter: float
    at_edge: str


def pool(
    speed_m_s: Sequence[FloatArray], mu: Sequence[FloatArray], numbers: Sequence[int]
) -> Pooled:
    """Return the curve through the sliding blocks of the runs, one array per run each.

    ``numbers`` name the runs in the result. Raises ValueError for fewer runs than the curve has
    parameters plus one, for which the spread between runs has no meaning.
    """
    if len(mu) <= PARAMETERS:
        raise ValueError(f"{len(mu)} runs for a curve of {PARAMETERS} parameters")
    run = np.repeat(np.arange(len(mu)), [m.size for m in mu])
    v, y = np.concatenate(speed_m_s), np.concatenate(mu)
    good = y > 0.0
    run, v, y = run[good], v[good], y[good]
    log_v, log_mu = np.log10(v), np.log(y)
    basis = _basis(log_v)
    q, weights = _robust(basis, log_mu)
    cov = _covariance(basis, log_mu - basis @ q, weights, run)

    low, high = (float(x) for x in np.quantile(log_v, [ENDS, 1.0 - ENDS]))
    peak, edge = _peak(q, low, high)
    row = _basis(np.array([peak]))[0]
    widening = _widening(int(np.unique(run[weights > 0.0]).size))
    relative_u = widening * math.sqrt(float(row @ cov @ row))
    if edge:
        # A slope that falls to 0 over the distance d adds slope d/2; d is between 0 and BEYOND.
        slope = abs(float(q[1] + 2.0 * q[2] * peak))
        relative_u = math.hypot(relative_u, 0.5 * slope * BEYOND / math.sqrt(3.0))
    maximum = math.exp(float(row @ q))

    grid = np.linspace(low, high, GRID)
    rows = _basis(grid)
    value = np.exp(rows @ q)
    band = 2.0 * widening * np.sqrt(np.einsum("ij,jk,ik->i", rows, cov, rows)) * value
    curve = FrictionCurve(
        speed_m_s=10.0**grid, mu=value, low=value - band, high=value + band,
        block_speed_m_s=v, block_mu=y, block_weight=weights,
        block_run=tuple(numbers[int(k)] for k in run), peak_speed_m_s=10.0**peak, form=FORM,
    )  # fmt: skip
    return Pooled(curve, maximum, relative_u * maximum, _scatter(log_mu - basis @ q, run), edge)


def _basis(log_v: FloatArray) -> FloatArray:
    return np.column_stack([np.ones_like(log_v), log_v, log_v**2])


def _robust(basis: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return coefficients (3,) and Tukey weights (n,)."""
    q = np.linalg.lstsq(basis, y, rcond=None)[0]
    weights = np.ones_like(y)
    for k in range(2 * ITERATIONS):
        rest = np.abs(y - basis @ q)
        scale = max(1.4826 * float(np.median(rest)), 1e-12)
        if k < ITERATIONS:
            weights = np.minimum(1.0, HUBER_K * scale / np.maximum(rest, 1e-300))
        else:
            weights = np.maximum(1.0 - (rest / (TUKEY * scale)) ** 2, 0.0) ** 2
        root = np.sqrt(weights)
        q = np.linalg.lstsq(root[:, None] * basis, root * y, rcond=None)[0]
    return np.asarray(q), np.asarray(weights)


def _covariance(
    basis: FloatArray,
    rest: FloatArray,
    weights: FloatArray,
    run: np.ndarray[tuple[int], np.dtype[np.intp]],
) -> FloatArray:
    """Return the sandwich covariance (3, 3) with one score per run."""
    scores = (weights * rest)[:, None] * basis
    sums = np.zeros((int(run.max()) + 1, PARAMETERS))
    np.add.at(sums, run, scores)
    inverse = np.linalg.pinv((weights[:, None] * basis).T @ basis)
    runs = int(np.unique(run[weights > 0.0]).size)
    factor = runs / max(runs - PARAMETERS, 1)
    return np.asarray(factor * inverse @ (sums.T @ sums) @ inverse)


def _widening(runs: int) -> float:
    """Return the factor on u by which 2 u covers 95 % with so few runs."""
    return float(student.ppf(0.975, max(runs - PARAMETERS, 1))) / 1.96


def _peak(q: FloatArray, low: float, high: float) -> tuple[float, str]:
    """Return log10 of the speed of the maximum in [low, high], and at which edge it lies."""
    if q[2] < 0.0:
        peak = -float(q[1]) / (2.0 * float(q[2]))
        if low <= peak <= high:
            return peak, ""
    ends = _basis(np.array([low, high])) @ q
    return (low, "slow") if ends[0] > ends[1] else (high, "fast")


def _scatter(rest: FloatArray, run: np.ndarray[tuple[int], np.dtype[np.intp]]) -> float:
    """Return the robust standard deviation of the runs' mean residuals, relative to mu."""
    means = np.array([np.mean(rest[run == k]) for k in np.unique(run)])
    return 1.4826 * float(np.median(np.abs(means - np.median(means))))
