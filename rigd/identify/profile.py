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

FAR = 4.0  #: the scan of a side ends where the statistic is this multiple of the threshold


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

    Each point starts from its inner neighbour, outwards from the best fit until the statistic is
    ``FAR`` times the threshold; a point that ends below its inner neighbour gives that one a
    second start. An end stays None when the statistic does not cross the threshold on that side
    within the grid.
    """
    costs = np.full(len(grid), np.inf)
    thetas = np.tile(best.theta, (len(grid), 1))
    effective = float(np.count_nonzero(model.mask)) / inflation
    threshold = float(chi2.ppf(confidence, 1))
    beyond = best.cost * np.exp(FAR * threshold / effective)

    def refit(index: int, start: FloatArray) -> None:
        held = Affine.holding(direction, float(grid[index]))
        point = fit(model, start, affine=held, weights=best.weights, max_iterations=max_iterations)
        if point.cost < costs[index]:
            costs[index], thetas[index] = point.cost, point.theta

    middle = int(np.argmin(np.abs(grid - float(direction @ best.scaled))))
    refit(middle, best.theta)
    reached = [middle]
    for way in (range(middle - 1, -1, -1), range(middle + 1, len(grid))):
        previous = middle
        for index in way:
            refit(index, thetas[previous])
            reached.append(index)
            previous = index
            if costs[index] > beyond:
                break
    for index in sorted(reached, key=lambda i: -abs(i - middle)):
        inward = index + (1 if index < middle else -1)
        if index != middle and costs[index] < costs[inward]:
            refit(inward, thetas[index])
    done = np.array(sorted(reached))
    grid, costs, thetas = grid[done], costs[done], thetas[done]
    floor = min(best.cost, float(np.min(costs)))
    statistic = effective * np.log(np.maximum(costs, floor) / max(floor, np.finfo(float).tiny))
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
