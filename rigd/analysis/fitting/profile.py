"""Computes profile likelihood intervals, which hold even if the cost is not a parabola.

Along a grid of one parameter (or one combination of scaled parameters) the module refits all
others. With residuals of variance s^2 and inflation t (integrated autocorrelation time) it compares
the statistic n/t ln(S/S_min) with the chi-square quantile of one degree of freedom.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.stats import chi2

from rigd.analysis.fitting.fit import Affine, Fit, fit
from rigd.analysis.fitting.model import Model, scaled_bounds, to_natural, to_scaled
from rigd.analysis.fitting.uncertainty import scaled_pinv
from rigd.analysis.result import FloatArray
from rigd.model.errors import DataError

FAR = 4.0  #: refits spread no further than this multiple of the threshold
NEAR = 1e-8  #: first damping of a refit
#: Relative, of the root of the statistic: near enough to the threshold. If the root bends by so
#: much until there, the crossing that a straight line gives is a hundredth off.
AGREES = 0.1
BETTER = 1.0  #: in the statistic: a point that fits so much better shows another optimum
MOST_REFITS = 8  #: on each side
MOST_ITERATIONS = 36  #: of a refit
MOST_PARTS = 3  #: of a refit; twice as many if it begins elsewhere
HOPELESS = 2.0  #: times the least cost, after the first part
FURTHEST = 2.5  #: in scaled coordinates, from one refit to the next
TINY_STEP = 1e-9  #: in scaled coordinates
LEAST_VARIANCE = 1e-24
UNDETERMINED_SD = 0.05  #: to begin with, if the information has no value
CLEAR = 5.0  #: times an interval: no effect is that far from what was found
NEXT = 0.3  #: of the way to an end, beyond which another branch is looked for
FAR_OUT = 20.0  #: root of the statistic that counts at most


#: Returns natural parameters (p,) near a ridge, of a point on it and of another value (scaled).
Bend = Callable[[FloatArray, float], FloatArray]
#: Returns natural parameters (p,) of another branch that have a value (scaled); None: none has.
Branch = Callable[[float], "FloatArray | None"]


@dataclass(frozen=True, eq=False)
class ProfileScan:
    """A profile in scaled coordinates: (n,) ``values``, (n,) ``statistic``, (n, p) ``thetas``.

    ``inverses`` (n, p, p) are those of the information at each point, all parameters free; of a
    profile over a grid there are none. ``direction`` (p,) makes the value of scaled parameters.
    ``better`` (p,) are natural parameters that fit better than what was taken for the best.
    ``slack`` is the factor on the threshold up to which a point stands for the end next to it.
    """

    values: FloatArray
    statistic: FloatArray
    thetas: FloatArray
    threshold: float
    low: float | None
    high: float | None
    better: FloatArray | None = None
    slack: float = 1.0
    inverses: FloatArray = field(default_factory=lambda: np.zeros((0, 0, 0)))
    direction: FloatArray = field(default_factory=lambda: np.zeros(0))

    @property
    def accepted(self) -> FloatArray:
        """Return the natural parameters (m, p) of the points that are below the threshold."""
        return self.thetas[self.statistic <= self.slack * self.threshold]

    def held(self, index: int) -> FloatArray:
        """Return what a point leaves of its inverse (p, p) if the value of the profile is known."""
        inverse: FloatArray = self.inverses[index]
        moved = inverse @ self.direction
        variance = float(self.direction @ moved)
        if not variance > LEAST_VARIANCE:
            return inverse
        return np.asarray(inverse - np.outer(moved, moved) / variance)


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
    on that side within the grid, or does so at a refit that has not converged, or not beyond the
    best fit.
    """
    costs = np.full(len(grid), np.inf)
    settled = np.zeros(len(grid), bool)
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
        try:
            point = fit(
                model, start, affine=held, weights=best.weights, max_iterations=max_iterations,
                relative_decrease=0.1 * worth,
            )  # fmt: skip
        except DataError:  # the model has no finite cost there: the point is not accepted
            continue
        if not point.cost < costs[index] * (1.0 - worth):
            continue
        costs[index], thetas[index], settled[index] = point.cost, point.theta, point.converged
        if point.cost <= beyond:
            waiting += [(i, point.theta) for i in (index - 1, index + 1) if 0 <= i < len(grid)]
    done = np.flatnonzero(np.isfinite(costs))
    grid, costs, thetas, settled = grid[done], costs[done], thetas[done], settled[done]
    floor = min(best.cost, float(np.min(costs)))
    statistic = effective * np.log(np.maximum(costs, floor) / max(floor, np.finfo(float).tiny))
    low, high = crossing(grid, statistic, threshold)
    inside = np.flatnonzero(statistic <= threshold)
    # What a refit that has not converged excludes is not excluded, nor is the best fit itself.
    value = float(direction @ best.scaled)
    if low is not None and not (low < value and inside.size and settled[inside[0] - 1]):
        low = None
    if high is not None and not (high > value and inside.size and settled[inside[-1] + 1]):
        high = None
    return ProfileScan(grid, statistic, thetas, threshold, low, high)


def follow(
    model: Model,
    best: Fit,
    direction: FloatArray,
    inverse: FloatArray,
    limits: tuple[float, float],
    *,
    others: Sequence[FloatArray] = (),
    confidence: float = 0.95,
    none: float | None = None,
    bend: Bend | None = None,
    branch: Branch | None = None,
) -> ProfileScan:
    """Return the profile of ``direction @ scaled`` to the crossing of the threshold, in few refits.

    ``inverse`` (p, p) is that of the information at ``best``. Each refit begins at the point that
    the model, linearised at the point before, moves the other parameters (Bates and Watts,
    Nonlinear Regression Analysis, 1988, section 6.1). The first stands at the crossing of a
    quadratic; if the signed root of the statistic is there within ``AGREES`` the end is found, else
    a secant on the root follows. An end stays None when the statistic does not
    cross within ``limits``, or when a refit beyond the threshold does not converge. ``others`` are
    other optima (natural parameters (p,)): if one is accepted too, the interval reaches around it.
    ``none`` is a value that stands for no effect: it has a refit too, unless it is further from the
    best than ``CLEAR`` times the end on its side. ``bend`` gives the begin of each refit along a
    ridge that is known not to be straight. ``branch`` is one that no path from the best may reach:
    if it is accepted a little beyond an end, the interval goes on along it.
    """
    threshold = float(chi2.ppf(confidence, 1))
    path = _Path(model, best, direction, inverse, limits, threshold, bend)
    begin = path.points[0]
    ends = [path.end(begin, side) for side in (-1, 1)]
    for other in others:
        if path.better is not None:
            break
        start = to_scaled(model.parameters, other)
        value = float(direction @ start)
        side = -1 if value < begin.value else 1
        end = ends[side > 0]
        if end is not None and (value - end) * side > 0.0:
            point = path.refit(value, start, elsewhere=True)
            if point.statistic <= threshold:
                ends[side > 0] = path.end(point, side)
    for side in (-1, 1):
        end = ends[side > 0]
        if branch is None or end is None or path.better is not None:
            continue
        value = float(np.clip(end + NEXT * (end - begin.value), *limits))
        there = branch(value)
        if there is None:
            continue
        point = path.refit(value, to_scaled(model.parameters, there), elsewhere=True)
        if point.statistic <= threshold:
            ends[side > 0] = path.end(point, side)
    if none is not None and path.better is None:
        end = ends[none > begin.value]
        near = end is None or abs(none - begin.value) < CLEAR * abs(end - begin.value)
        if near and none not in [point.value for point in path.points]:
            closest = min(path.points, key=lambda point: abs(point.value - none))
            path.refit(none, path.predicted(closest, none))
    points = sorted(path.points, key=lambda point: point.value)
    return ProfileScan(
        np.array([point.value for point in points]),
        np.array([point.statistic for point in points]),
        np.array([to_natural(model.parameters, point.scaled) for point in points]),
        threshold, ends[0], ends[1], path.better, (1.0 + AGREES) ** 2,
        np.array([point.inverse for point in points]), direction,
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Point:
    value: float
    statistic: float
    scaled: FloatArray
    along: FloatArray  #: d(scaled)/d(value) of the linearised model
    inverse: FloatArray  #: of the information, all parameters free
    converged: bool = True  #: else the statistic may be too large

    @property
    def root(self) -> float:
        """The root of the statistic, which is straight if the cost is a parabola."""
        return float(np.sqrt(self.statistic))


class _Path:
    """The refits along one direction from a best fit."""

    def __init__(
        self,
        model: Model,
        best: Fit,
        direction: FloatArray,
        inverse: FloatArray,
        limits: tuple[float, float],
        threshold: float,
        bend: Bend | None,
    ) -> None:
        self._bend = bend
        self._model, self._best, self._direction = model, best, direction
        self._limits, self._root = limits, float(np.sqrt(threshold))
        self._samples = float(np.count_nonzero(model.mask))
        # A gain that moves the statistic by less than a hundredth of the threshold is none.
        self._worth = 1e-2 * threshold / self._samples
        variance = float(direction @ inverse @ direction)
        self.sd = float(np.sqrt(variance)) if variance > LEAST_VARIANCE else UNDETERMINED_SD
        self.better: FloatArray | None = None
        value = float(direction @ best.scaled)
        self.points = [_Point(value, 0.0, best.scaled, self._along(inverse), inverse)]

    def _along(self, inverse: FloatArray) -> FloatArray:
        """Return how the linearised model moves all parameters with the one that is held."""
        moved, variance = inverse @ self._direction, self._direction @ inverse @ self._direction
        if not variance > LEAST_VARIANCE:
            moved, variance = self._direction, self._direction @ self._direction
        return np.asarray(moved / variance)

    def predicted(self, inside: _Point, value: float) -> FloatArray:
        """Return the scaled parameters at which a refit at ``value`` begins."""
        if self._bend is None:
            return np.asarray(inside.scaled + (value - inside.value) * inside.along)
        parameters = self._model.parameters
        return to_scaled(parameters, self._bend(to_natural(parameters, inside.scaled), value))

    def end(self, begin: _Point, side: int) -> float | None:
        """Return the crossing of the threshold on ``side`` (-1, 1) of ``begin``."""
        limit = self._limits[0] if side < 0 else self._limits[1]
        inside, reach = begin, min(self._root * self.sd, FURTHEST)
        outside: _Point | None = None
        for _ in range(MOST_REFITS):
            if self.better is not None:
                return None
            target = float(np.clip(inside.value + side * reach, *self._limits))
            moved = target - inside.value
            if abs(moved) < TINY_STEP:
                return None
            point = self.refit(target, self.predicted(inside, target))
            if not point.converged and point.root > (1.0 - AGREES) * self._root:
                return None  # what a refit that has not converged excludes is not excluded
            share = self._share(inside, point)
            if abs(point.root - self._root) < AGREES * self._root:
                found = inside.value + share * moved
                return found if (limit - found) * side > 0.0 else None
            if point.root > self._root:
                outside = point
                reach = min(max(share, 0.1), 0.9) * abs(moved)
                continue
            if target == limit:
                return None
            if outside is None:
                reach = min(max(share - 1.0, 0.5) * abs(moved), FURTHEST)
            else:
                reach = self._share(point, outside) * abs(outside.value - target)
            inside = point
        if outside is None:
            return None
        return inside.value + self._share(inside, outside) * (outside.value - inside.value)

    def refit(self, value: float, start: FloatArray, *, elsewhere: bool = False) -> _Point:
        """Return the best fit that has ``value``; of infinite statistic if there is none.

        A fit that begins ``elsewhere`` ends early if it comes nowhere near the best.
        """
        low, high = scaled_bounds(self._model.parameters)
        held = Affine.holding(self._direction, value)
        theta = to_natural(self._model.parameters, np.clip(start, low, high))
        try:
            parts = 2 * MOST_PARTS if elsewhere else MOST_PARTS
            for _ in range(parts):
                found = fit(
                    self._model, theta, affine=held, weights=self._best.weights,
                    max_iterations=MOST_ITERATIONS // parts, relative_decrease=self._worth,
                    damping=NEAR, thorough=True, ridges=True,
                )  # fmt: skip
                theta = found.theta
                if found.converged or (elsewhere and found.cost > HOPELESS * self._best.cost):
                    break
        except DataError:  # the model has no finite cost there: the point is not accepted
            return _Point(value, np.inf, start, self._direction, np.zeros((0, 0)))
        ratio = found.cost / max(self._best.cost, np.finfo(float).tiny)
        statistic = self._samples * float(np.log(ratio))
        if statistic < -BETTER:
            self.better = found.theta
        whole = scaled_pinv(found.information)
        inverse, free = whole, np.flatnonzero((found.scaled > low) & (found.scaled < high))
        if free.size < len(start):
            inverse = np.zeros_like(whole)
            inverse[np.ix_(free, free)] = scaled_pinv(found.information[np.ix_(free, free)])
        point = _Point(
            value, max(statistic, 0.0), found.scaled, self._along(inverse), whole, found.converged
        )
        self.points.append(point)
        return point

    def _share(self, inside: _Point, point: _Point) -> float:
        """Return how far from ``inside`` to ``point`` the root of the statistic is that sought."""
        rise = min(point.root, FAR_OUT) - inside.root
        return (self._root - inside.root) / rise if rise > 0.0 else np.inf


def crossing(
    grid: FloatArray, statistic: FloatArray, threshold: float
) -> tuple[float | None, float | None]:
    """Return the first and the last crossing of ``threshold``; None if there is none.

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
