"""Chooses tests by the information that they give, within a budget of time.

A test is worth what it adds to the Fisher information of the estimator, constants with their priors
included. The criterion is A-optimality in relative half widths: the sum of (half width / value)^2
over the targets (Atkinson, Donev and Tobias, Optimum Experimental Designs, with SAS, 2007, sec.
10.1). The choice is greedy, then refined by exchanges (Fedorov, Theory of Optimal Experiments,
1972, sec. 3.5). A test may be chosen more than once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement

import numpy as np
from numpy.typing import NDArray

from rigd.analysis.fitting.identifiability import Z_95
from rigd.analysis.result import FloatArray
from rigd.model.errors import DataError

WORTHWHILE = 1e-6  #: relative decrease of the criterion for which a test is exchanged
MOST_EXCHANGES = 200
TRIED = 4  #: tests that are tried in the place of one that is taken away


@dataclass(frozen=True, eq=False)
class PossibleTest:
    """A test that can be chosen.

    ``information`` (g, p, p) is what it adds in each of g groups, such as floors, in scaled
    coordinates; values of the trial alone are eliminated. ``duration_s`` includes its way back.
    """

    information: FloatArray
    duration_s: float


@dataclass(frozen=True, eq=False)
class DesignTarget:
    """A positive quantity that the tests are chosen for.

    ``gradient`` (p,) is that of its logarithm to the scaled coordinates of group ``group``.
    ``other_sd`` is the relative standard uncertainty that no test takes away.
    """

    name: str
    group: int
    gradient: FloatArray
    other_sd: float = 0.0


@dataclass(frozen=True, eq=False)
class Choice:
    """How often each test is chosen, (n,), and the relative half widths (t,) of the targets."""

    counts: tuple[int, ...]
    half_widths: FloatArray
    duration_s: float

    @property
    def criterion(self) -> float:
        """The sum of the squares of the half widths."""
        return float(self.half_widths @ self.half_widths)


def half_widths(information: FloatArray, targets: Sequence[DesignTarget]) -> FloatArray:
    """Return the relative 95 % half widths (..., t) of ``targets`` by the Cramer-Rao bound.

    ``information`` (..., g, p, p) must be positive definite: what the data leave open needs a
    prior, however wide.
    """
    root = np.sqrt(np.diagonal(information, axis1=-2, axis2=-1))
    inverse = np.linalg.inv(information / (root[..., :, None] * root[..., None, :]))
    widths = []
    for target in targets:
        scaled = target.gradient / root[..., target.group, :]
        variance = np.einsum(
            "...i,...ij,...j->...", scaled, inverse[..., target.group, :, :], scaled
        )
        widths.append(Z_95 * np.sqrt(np.maximum(variance, 0.0) + target.other_sd**2))
    return np.stack(widths, axis=-1)


def choose(
    tests: Sequence[PossibleTest],
    known: FloatArray,
    targets: Sequence[DesignTarget],
    budget_s: float,
) -> Choice:
    """Return the tests for ``targets`` that fit into ``budget_s``; ``known`` (g, p, p) is a prior.

    Greedy choices by gain and by gain per second are refined, and the better one is returned. An
    exchange takes one test or two away and fills what is left with others.

    Raises:
        DataError: no test fits into the budget.
    """
    choosing = _Choosing(tests, known, tuple(targets), budget_s)
    if not np.any(choosing.durations <= budget_s):
        shortest = float(np.min(choosing.durations, initial=np.inf))
        raise DataError(
            f"no test fits into {budget_s:.3g} s; the shortest one takes {shortest:.3g} s",
            hint="give more minutes",
        )
    empty = np.zeros(len(tests), dtype=int)
    ends = [choosing.refined(choosing.filled(empty, by_time)) for by_time in (True, False)]
    counts = min(ends, key=choosing.criterion)
    return Choice(
        tuple(int(count) for count in counts),
        half_widths(choosing.sum(counts), targets),
        float(counts @ choosing.durations),
    )


class _Choosing:
    """The search for one set of tests."""

    def __init__(
        self,
        tests: Sequence[PossibleTest],
        known: FloatArray,
        targets: tuple[DesignTarget, ...],
        budget_s: float,
    ) -> None:
        self._each = np.stack([test.information for test in tests])
        self._known, self._targets, self._budget_s = known, targets, budget_s
        self.durations = np.array([test.duration_s for test in tests])

    def sum(self, counts: FloatArray) -> FloatArray:
        """Return the information (g, p, p) of prior and tests."""
        return np.asarray(self._known + np.tensordot(counts, self._each, 1))

    def criterion(self, counts: FloatArray) -> float:
        """Return what is to be small."""
        return float(self._criteria(self.sum(counts)))

    def filled(self, counts: FloatArray, by_time: bool) -> FloatArray:
        """Return ``counts`` with the best test added, again and again, until none fits."""
        counts = counts.copy()
        while True:
            fits = self._fitting(counts)
            if not fits.size:
                return counts
            have = self.sum(counts)
            gain = self._criteria(have) - self._criteria(have + self._each[fits])
            if by_time:
                gain /= self.durations[fits]
            counts[fits[int(np.argmax(gain))]] += 1

    def refined(self, counts: FloatArray) -> FloatArray:
        """Return ``counts`` after all exchanges that help: of one test, then of two at once."""
        best = self.criterion(counts)
        for _ in range(MOST_EXCHANGES):
            for removed in (1, 2):
                other = self._exchanged(counts, removed)
                found = self.criterion(other)
                if found < best * (1.0 - WORTHWHILE):
                    break
            else:
                break
            counts, best = other, found
        return counts

    def _exchanged(self, counts: FloatArray, removed: int) -> FloatArray:
        """Return the best of ``counts`` with ``removed`` tests less and others in their place."""
        ends = [counts]
        for taken in combinations_with_replacement(np.flatnonzero(counts), removed):
            less = counts - np.bincount(taken, minlength=len(counts))
            if np.min(less) < 0:
                continue
            ends += [self.filled(less, by_time) for by_time in (True, False)]
            fits = self._fitting(less)
            values = self._criteria(self.sum(less) + self._each[fits])
            for k in fits[np.argsort(values)[:TRIED]]:
                another = less.copy()
                another[k] += 1
                ends.append(self.filled(another, by_time=True))
        return min(ends, key=self.criterion)

    def _fitting(self, counts: FloatArray) -> NDArray[np.intp]:
        left = self._budget_s - counts @ self.durations
        return np.flatnonzero(self.durations <= left)

    def _criteria(self, information: FloatArray) -> FloatArray:
        """Return the criteria (...) of ``information`` (..., g, p, p)."""
        return np.asarray(np.sum(half_widths(information, self._targets) ** 2, axis=-1))
