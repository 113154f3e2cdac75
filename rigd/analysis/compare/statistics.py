"""Differences of estimates that rest on common constants, tests that all are equal, trends.

An estimate is value + own error + the sum over constants of share times error of the constant, each
constant's error of standard deviation 1. Estimates of several campaigns have own errors that are
independent, and the errors of equal constants in common: in a difference these cancel as far as
the shares are equal (JCGM 100:2008, 5.2.2, with the correlation that a common input makes).
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.optimize import brentq
from scipy.stats import chi2, f, t

from rigd.analysis.result import FloatArray

COVERAGE = 0.95
TAIL = 0.5 + COVERAGE / 2.0


@dataclass(frozen=True)
class Level:
    """An estimate in the coordinate of the comparison.

    ``below`` and ``above`` are standard deviations of its own error to either side, without the
    ``shares`` of constants; infinite if that end is open. ``freedom`` are those of its own error.
    """

    value: float
    below: float
    above: float
    shares: Mapping[Hashable, float] = field(default_factory=dict)
    freedom: float = math.inf

    @property
    def own(self) -> float:
        """Standard deviation of its own error, both sides together."""
        return math.hypot(self.below, self.above) / math.sqrt(2.0)

    @property
    def total(self) -> float:
        """Standard deviation of all errors."""
        return math.hypot(self.own, *self.shares.values())


@dataclass(frozen=True)
class LevelDifference:
    """Second less first: ``value`` with its 95 % interval; an end is infinite if open.

    ``p_value`` is that of no difference; it is below 5 % where the interval leaves 0 out.
    ``cancelled`` is the share of the variance that common constants take away.
    """

    value: float
    low: float
    high: float
    p_value: float
    cancelled: float


def difference(first: Level, second: Level) -> LevelDifference:
    """Return second less first.

    Each side of the interval joins the sides of both estimates that lie towards it (MOVER: Zou and
    Donner, Statistics in Medicine 27, 2008), with the mean of their quantiles, weighted by the
    variances (Cochran and Cox, Experimental Designs, 1957, sec. 4.14). One quantile for the degrees
    of freedom of Welch and Satterthwaite holds the truth in 90 of 100 cases for two runs beside
    five that scatter a third as much; this one in 95 to 99.
    """
    value = second.value - first.value
    common = _common(first, second)
    parts = _Parts(first.own, second.own, common, first.freedom, second.freedom)
    low_sd = math.hypot(first.above, second.below, common)
    high_sd = math.hypot(first.below, second.above, common)
    reach = parts.quantile(1.0 - TAIL)
    towards_zero = low_sd if value > 0.0 else high_sd
    if not math.isfinite(towards_zero):
        p_value = 1.0
    elif towards_zero == 0.0:
        p_value = 0.0 if value else 1.0
    else:
        p_value = 2.0 * parts.beyond(abs(value) / towards_zero)
    apart = math.hypot(first.total, second.total)
    together = math.hypot(first.own, second.own, common)
    cancelled = 1.0 - (together / apart) ** 2 if 0.0 < apart < math.inf else 0.0
    return LevelDifference(
        value, value - reach * low_sd, value + reach * high_sd, p_value, cancelled
    )


@dataclass(frozen=True)
class Homogeneity:
    """Test that all levels are one; ``statistic`` has ``freedom`` degrees of freedom."""

    statistic: float
    freedom: int
    p_value: float


def homogeneity(levels: Sequence[Level]) -> Homogeneity:
    """Return the test that all ``levels`` are equal; of two, that of their difference.

    Of more, (Cx)'(C V C')^-1 (Cx) with the contrasts C and the covariance V of all, constants
    included. Levels with few degrees of freedom: Welch, Biometrika 38, 1951. An open level cannot
    differ from any.
    """
    freedom = len(levels) - 1
    if any(not math.isfinite(item.own) for item in levels) or freedom < 1:
        return Homogeneity(0.0, freedom, 1.0)
    if freedom == 1:
        found = difference(*levels)
        sd = math.hypot(levels[0].own, levels[1].own, _common(*levels))
        return Homogeneity((found.value / sd) ** 2 if sd else 0.0, 1, found.p_value)
    levels, _ = _scaled(levels)
    values = np.array([item.value for item in levels])
    contrasts = np.eye(freedom + 1)[1:] - np.eye(freedom + 1)[:1]
    among = contrasts @ covariance(levels) @ contrasts.T
    apart = contrasts @ values
    if not np.all(np.linalg.eigvalsh(among) > 0.0):
        return Homogeneity(math.inf, freedom, 0.0 if np.any(apart) else 1.0)
    statistic = float(apart @ np.linalg.solve(among, apart))
    own = np.array([item.own for item in levels])
    # Those without an error of their own have all the weight: the limit of a small error.
    weights = 1.0 / own**2 if np.all(own > 0.0) else np.where(own > 0.0, 0.0, 1.0)
    few = np.array([1.0 / item.freedom for item in levels])
    spare = float(np.sum((1.0 - weights / weights.sum()) ** 2 * few))
    if spare == 0.0:
        return Homogeneity(statistic, freedom, float(chi2.sf(statistic, freedom)))
    k = freedom + 1
    scaled = statistic / freedom / (1.0 + 2.0 * (k - 2) / (k**2 - 1) * spare)
    return Homogeneity(statistic, freedom, float(f.sf(scaled, freedom, (k**2 - 1) / (3.0 * spare))))


@dataclass(frozen=True)
class Slope:
    """Change for each unit of ``at``, with its 95 % interval and the chance if there is none."""

    value: float
    low: float
    high: float
    p_value: float


def trend(levels: Sequence[Level], at: FloatArray) -> Slope | None:
    """Return the line through ``levels`` at ``at`` (k,), by generalised least squares.

    None: there are fewer than three different places, or a level is open. If the levels scatter
    more about the line than their errors allow, the interval is wider by that (Birge, Phys. Rev.
    40, 1932), with k - 2 degrees of freedom.
    """
    if len(set(at.tolist())) < 3 or any(not math.isfinite(item.own) for item in levels):
        return None
    levels, scale = _scaled(levels)
    together = covariance(levels)
    if not np.all(np.linalg.eigvalsh(together) > 0.0):
        return None
    design = np.stack([np.ones(len(at)), at - at.mean()], axis=1)
    weighted = np.linalg.solve(together, design)
    inverse = np.linalg.inv(design.T @ weighted)
    line = inverse @ (weighted.T @ [item.value for item in levels])
    left = np.array([item.value for item in levels]) - design @ line
    freedom = len(at) - 2
    birge = float(left @ np.linalg.solve(together, left)) / freedom
    few = min(item.freedom for item in levels)
    sd, dof = math.sqrt(inverse[1, 1]), few
    if birge > 1.0:
        sd, dof = sd * math.sqrt(birge), min(few, float(freedom))
    reach = float(t.ppf(TAIL, dof)) * sd
    value = float(line[1])
    p_value = float(2.0 * t.sf(abs(value) / sd, dof))
    return Slope(value * scale, (value - reach) * scale, (value + reach) * scale, p_value)


def _scaled(levels: Sequence[Level]) -> tuple[list[Level], float]:
    """Return ``levels`` over their largest error, and that: the squares of others may overflow."""
    scale = max(item.total for item in levels) or 1.0
    found = [
        replace(
            item, value=item.value / scale, below=item.below / scale, above=item.above / scale,
            shares={key: share / scale for key, share in item.shares.items()},
        )
        for item in levels
    ]  # fmt: skip
    return found, scale


def covariance(levels: Sequence[Level]) -> FloatArray:
    """Return the covariance (k, k) of ``levels``: own errors, and those of constants in common."""
    found = np.diag([item.own**2 for item in levels])
    for key in {key for item in levels for key in item.shares}:
        column = np.array([item.shares.get(key, 0.0) for item in levels])
        found += np.outer(column, column)
    return np.asarray(found)


def holm(p_values: Sequence[float]) -> list[float]:
    """Return the p values for all tests together (Holm, Scand. J. Statist. 6, 1979)."""
    count = len(p_values)
    adjusted, least = [1.0] * count, 0.0
    for rank, index in enumerate(sorted(range(count), key=lambda k: p_values[k])):
        least = max(least, min(1.0, (count - rank) * p_values[index]))
        adjusted[index] = least
    return adjusted


@dataclass(frozen=True)
class _Parts:
    """What the error of a difference consists of: two own errors, and those of constants."""

    first: float
    second: float
    common: float
    first_freedom: float
    second_freedom: float

    def quantile(self, tail: float) -> float:
        """Return how many standard deviations of the difference leave ``tail`` above."""
        sizes = np.array([self.first, self.second, self.common])
        if not (np.all(np.isfinite(sizes)) and sizes.any()):
            return float(t.isf(tail, min(self._freedom)))
        return float(np.average(t.isf(tail, self._freedom), weights=(sizes / sizes.max()) ** 2))

    def beyond(self, reach: float) -> float:
        """Return the chance above ``reach`` (>= 0) standard deviations."""
        ends = [math.log(max(float(t.sf(reach, nu)), 1e-300)) for nu in self._freedom]
        least, most = min(ends) - 1e-6, max(ends) + 1e-6  # the quantiles of both round
        if self.quantile(math.exp(least)) <= reach:
            return math.exp(least)
        return math.exp(brentq(lambda at: self.quantile(math.exp(at)) - reach, least, most))

    @property
    def _freedom(self) -> tuple[float, float, float]:
        return self.first_freedom, self.second_freedom, math.inf


def _common(first: Level, second: Level) -> float:
    """Return the standard deviation that constants leave in the difference of two levels."""
    keys = first.shares.keys() | second.shares.keys()
    return math.hypot(
        *(second.shares.get(key, 0.0) - first.shares.get(key, 0.0) for key in keys), 0.0
    )
