"""Checks the choice of tests against closed forms and against exhaustive search."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from rigd.analysis import DataError
from rigd.analysis.design.optimal import DesignTarget, PossibleTest, choose, half_widths
from rigd.analysis.fitting.identifiability import Z_95
from rigd.analysis.result import FloatArray

CASES = 40
PARAMETERS = 3


def test_half_width_equals_that_of_mean_of_samples() -> None:
    # n samples of one value with standard deviation s: 1.96 s / sqrt(n).
    information = np.array([[[25.0 / 0.1**2]]])
    width = half_widths(information, [DesignTarget("mean", 0, np.ones(1))])
    assert width == pytest.approx([Z_95 * 0.1 / 5.0])


def test_half_width_holds_uncertainty_no_test_takes() -> None:
    target = DesignTarget("mean", 0, np.ones(1), other_sd=0.3)
    assert half_widths(np.array([[[1.0 / 0.16]]]), [target]) == pytest.approx([Z_95 * 0.5])


def test_half_width_of_badly_scaled_parameters_is_exact() -> None:
    scale = np.array([1e-9, 1.0, 1e6])
    covariance = np.array([[2.0, 0.5, 0.1], [0.5, 1.0, 0.2], [0.1, 0.2, 3.0]])
    information = np.linalg.inv(covariance) / np.outer(scale, scale)
    gradient = np.array([1.0, -2.0, 1.0]) / scale
    expected = np.array([1.0, -2.0, 1.0]) @ covariance @ np.array([1.0, -2.0, 1.0])
    width = half_widths(information[None], [DesignTarget("mix", 0, gradient)])
    assert width == pytest.approx([Z_95 * np.sqrt(expected)])


def test_budget_is_shared_as_theory_has_it() -> None:
    # Two parameters, each measured alone with variances 1 and 4: A-optimal shares are 1 to 2.
    tests = [PossibleTest(np.diag(info)[None], 1.0) for info in ([1.0, 0.0], [0.0, 0.25])]
    targets = [DesignTarget(name, 0, axis) for name, axis in zip("ab", np.eye(2), strict=True)]
    chosen = choose(tests, 1e-9 * np.eye(2)[None], targets, 30.0)
    assert chosen.counts == (10, 20)
    assert chosen.duration_s == 30.0


@pytest.mark.parametrize("seed", range(CASES))
def test_choice_is_as_good_as_exhaustive_search(seed: int) -> None:
    random = np.random.default_rng(seed)
    tests, known, targets = _problem(random, groups=1 + seed % 2)
    budget = 8.0
    chosen = choose(tests, known, targets, budget)
    durations = np.array([test.duration_s for test in tests])
    assert chosen.duration_s == pytest.approx(np.array(chosen.counts) @ durations)
    assert chosen.duration_s <= budget
    best = min(
        _criterion(np.array(counts), tests, known, targets)
        for counts in product(*(range(int(budget / each) + 1) for each in durations))
        if np.array(counts) @ durations <= budget
    )
    # A local search may end beside the optimum; 2 % of the variance is 1 % of an interval.
    assert best * (1.0 - 1e-9) <= chosen.criterion <= 1.02 * best


def test_choice_is_mostly_the_optimum_itself() -> None:
    hits = 0
    for seed in range(CASES):
        tests, known, targets = _problem(np.random.default_rng(seed), groups=1)
        chosen = choose(tests, known, targets, 6.0)
        durations = np.array([test.duration_s for test in tests])
        best = min(
            _criterion(np.array(counts), tests, known, targets)
            for counts in product(*(range(int(6.0 / each) + 1) for each in durations))
            if np.array(counts) @ durations <= 6.0
        )
        hits += chosen.criterion <= best * (1.0 + 1e-9)
    assert hits >= 0.9 * CASES


def test_test_that_tells_nothing_is_not_chosen() -> None:
    useless = PossibleTest(np.zeros((1, 1, 1)), 1.0)
    useful = PossibleTest(np.ones((1, 1, 1)), 1.0)
    chosen = choose(
        [useless, useful], np.full((1, 1, 1), 1e-6), [DesignTarget("a", 0, np.ones(1))], 3.5
    )
    assert chosen.counts == (0, 3)


def test_budget_below_shortest_test_is_refused() -> None:
    test = PossibleTest(np.ones((1, 1, 1)), 7.0)
    with pytest.raises(DataError, match="the shortest one takes 7 s"):
        choose([test], np.ones((1, 1, 1)), [DesignTarget("a", 0, np.ones(1))], 6.0)


def _problem(
    random: np.random.Generator, groups: int
) -> tuple[list[PossibleTest], FloatArray, list[DesignTarget]]:
    tests = []
    for _ in range(4):
        rows = random.normal(size=(groups, 2, PARAMETERS)) * random.uniform(0.3, 3.0, PARAMETERS)
        tests.append(PossibleTest(rows.transpose(0, 2, 1) @ rows, random.uniform(1.0, 2.5)))
    known = np.tile(1e-2 * np.eye(PARAMETERS), (groups, 1, 1))
    targets = [
        DesignTarget(f"{k} of {group}", group, axis)
        for group in range(groups)
        for k, axis in enumerate(np.eye(PARAMETERS))
    ]
    return tests, known, targets


def _criterion(
    counts: FloatArray, tests: list[PossibleTest], known: FloatArray, targets: list[DesignTarget]
) -> float:
    total = known + sum(n * test.information for n, test in zip(counts, tests, strict=True))
    return float(np.sum(half_widths(total, targets) ** 2))
