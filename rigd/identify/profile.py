"""Profile likelihood: the interval to trust where the cost is not a parabola.

Along a grid of one parameter (or one combination of scaled parameters) all others are refitted.
With residuals of variance s^2 and inflation t (integrated autocorrelation time) the statistic
n/t ln(S/S_min) is compared with the chi-square quantile of one degree of freedom.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from rigd.identify.fit import Affine, Fit, fit
from rigd.identify.model import Model
from rigd.identify.result import FloatArray


@dataclass(frozen=True)
class ProfileScan:
    """A profile in scaled coordinates: (n,) ``values``, (n,) ``statistic``, (n, p) ``thetas``."""

    values: FloatArray
    statistic: FloatArray
    thetas: FloatArray
    threshold: float
    low: float | None
    high: float | None

    @property
    def accepted(self) -> FloatArray:
        """Return the natural parameters (m, p) of the grid points below the threshold."""
        return self.thetas[self.statistic <= self.threshold]


def scan(
    model: Model,
    best: Fit,
    direction: FloatArray,
    grid: FloatArray,
    *,
    inflation: float,
    confidence: float = 0.95,
    max_iterations: int = 25,
) -> ProfileScan:
    """Return the profile of ``direction @ scaled`` over ``grid`` (scaled, ascending).

    Each point starts from its neighbour, outwards from the best fit and back again, so that a
    valley found on one side is not missed on the other. An end stays None when the statistic
    does not cross the threshold on that side within the grid.
    """
    centre = float(direction @ best.scaled)
    order = np.argsort(np.abs(grid - centre))
    costs = np.full(len(grid), np.inf)
    thetas = np.tile(best.theta, (len(grid), 1))
    weights = best.weights
    for sweep in (order, order[::-1]):
        for index in sweep:
            start = _nearest_start(grid, costs, thetas, int(index), best.theta)
            point = fit(
                model, start, affine=Affine.holding(direction, float(grid[index])),
                weights=weights, max_iterations=max_iterations,
            )  # fmt: skip
            if point.cost < costs[index]:
                costs[index] = point.cost
                thetas[index] = point.theta
    effective = float(np.count_nonzero(model.mask)) / inflation
    floor = min(best.cost, float(np.min(costs)))
    statistic = effective * np.log(np.maximum(costs, floor) / max(floor, np.finfo(float).tiny))
    threshold = float(chi2.ppf(confidence, 1))
    low, high = crossing(grid, statistic, threshold)
    return ProfileScan(grid, statistic, thetas, threshold, low, high)


def crossing(
    grid: FloatArray, statistic: FloatArray, threshold: float
) -> tuple[float | None, float | None]:
    """Return where ``statistic`` first and last passes ``threshold``; None where it never does.

    All that lies between the outermost accepted points counts as accepted, also across a hump.
    """
    inside = np.flatnonzero(statistic <= threshold)
    if inside.size == 0:
        nearest = float(grid[int(np.argmin(statistic))])
        return nearest, nearest
    first, last = int(inside[0]), int(inside[-1])
    low = None if first == 0 else _between(grid, statistic, first - 1, first, threshold)
    high = None if last == len(grid) - 1 else _between(grid, statistic, last + 1, last, threshold)
    return low, high


def _between(
    grid: FloatArray, statistic: FloatArray, outside: int, inside: int, threshold: float
) -> float:
    """Return the crossing between two grid points, linear in the root of the statistic."""
    a, b = np.sqrt(statistic[outside]), np.sqrt(statistic[inside])
    share = (a - np.sqrt(threshold)) / (a - b)
    return float(grid[outside] + share * (grid[inside] - grid[outside]))


def _nearest_start(
    grid: FloatArray, costs: FloatArray, thetas: FloatArray, index: int, fallback: FloatArray
) -> FloatArray:
    """Return the best of the two neighbours' parameters, or the fit's where none is done yet."""
    neighbours = [i for i in (index - 1, index + 1) if 0 <= i < len(grid) and np.isfinite(costs[i])]
    if not neighbours:
        return fallback
    return np.asarray(thetas[min(neighbours, key=lambda i: float(costs[i]))])


def natural_ends(
    model: Model, index: int, scan_result: ProfileScan
) -> tuple[float | None, float | None]:
    """Return the ends of a profile along parameter ``index`` in its unit."""
    parameter = model.parameters[index]
    low = None if scan_result.low is None else parameter.natural(scan_result.low)
    high = None if scan_result.high is None else parameter.natural(scan_result.high)
    return low, high


def axis(count: int, index: int) -> FloatArray:
    """Return the direction of parameter ``index`` among ``count``."""
    direction = np.zeros(count)
    direction[index] = 1.0
    return direction
