"""Profile likelihood: the interval to trust where the cost is not a parabola.

Along a grid of one parameter (or one combination of scaled parameters) all others are refitted.
With residuals of variance s^2 and inflation t (integrated autocorrelation time) the statistic
n/t ln(S/S_min) is compared with the chi-square quantile of one degree of freedom.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from rigd.analysis.fit import Affine, Fit, fit
from rigd.analysis.model import Model, to_scaled
from rigd.analysis.result import FloatArray

FAR = 4.0  #: refits spread no further than this multiple of the threshold


@dataclass(frozen=True, eq=False)
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
    others: Sequence[FloatArray] = (),
    confidence: float = 0.95,
    max_iterations: int = 25,
) -> ProfileScan:
    """Return the profile of ``direction @ scaled`` over ``grid`` (scaled, ascending).

    Refits spread from the best fit, from both ends of the grid, and from ``others`` (natural
    parameters (p,) of other optima, or of points that another profile accepts). A point that gets
    better offers itself to both its neighbours as a start, so that a second branch is followed
    wherever one of the origins touches it; points are passed on while the statistic is below
    ``FAR`` times the threshold. An end stays None when the statistic does not cross the threshold
    on that side within the grid.
    """
    costs = np.full(len(grid), np.inf)
    thetas = np.tile(best.theta, (len(grid), 1))
    effective = float(np.count_nonzero(model.mask)) / inflation
    threshold = float(chi2.ppf(confidence, 1))
    beyond = best.cost * np.exp(FAR * threshold / effective)
    # A gain that moves the statistic by less than a hundredth of the threshold is none.
    worth = 1e-2 * threshold / effective

    def nearest(theta: FloatArray) -> int:
        value = float(direction @ to_scaled(model.parameters, theta))
        return int(np.argmin(np.abs(grid - value)))

    origins = [(nearest(theta), theta) for theta in (best.theta, *others)]
    waiting = deque([*origins, (0, best.theta), (len(grid) - 1, best.theta)])
    while waiting:
        index, start = waiting.popleft()
        held = Affine.holding(direction, float(grid[index]))
        point = fit(
            model, start, affine=held, weights=best.weights, max_iterations=max_iterations,
            relative_decrease=0.1 * worth,
        )  # fmt: skip
        if not point.cost < costs[index] * (1.0 - worth):
            continue
        costs[index], thetas[index] = point.cost, point.theta
        if point.cost <= beyond:
            waiting += [(i, point.theta) for i in (index - 1, index + 1) if 0 <= i < len(grid)]
    done = np.flatnonzero(np.isfinite(costs))
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
