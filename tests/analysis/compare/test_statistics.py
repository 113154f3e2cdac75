"""Differences, tests and trends: against referees, and by how often they are right."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from rigd.analysis.api import ResultOrigin
from rigd.analysis.compare.campaign import MEASURES, Campaign, campaign_of_measures
from rigd.analysis.compare.comparison import compare
from rigd.analysis.compare.statistics import (
    Level,
    covariance,
    difference,
    holm,
    homogeneity,
    trend,
)
from rigd.analysis.measures.result import MeasureResult, TrialReading, summary_of
from rigd.model.constants import Uncertainty
from rigd.procedure.program import Measure, Window

linear_model = pytest.importorskip("statsmodels.regression.linear_model")
multitest = pytest.importorskip("statsmodels.stats.multitest")
oneway = pytest.importorskip("statsmodels.stats.oneway")

TRIES = 1500
#: 95 % of them, with three standard errors of a count.
RIGHT = (0.95 - 0.017, 0.95 + 0.017)


def of_samples(samples: Sequence[float]) -> Level:
    u = float(np.std(samples, ddof=1)) / math.sqrt(len(samples))
    return Level(float(np.mean(samples)), u, u, {}, len(samples) - 1)


def drawn(random: np.random.Generator, shares: Sequence[Sequence[float]], own: Sequence[float],
          truth: Sequence[float]) -> list[Level]:  # fmt: skip
    """Return levels around the truth; row k of ``shares`` is that of the constants in level k."""
    constants = random.standard_normal(len(shares[0]))
    return [
        Level(
            centre + sd * random.standard_normal() + float(np.dot(row, constants)),
            sd, sd, dict(enumerate(row)),
        )
        for row, sd, centre in zip(shares, own, truth, strict=True)
    ]  # fmt: skip


@pytest.mark.parametrize("shares", [[[3.0, 1.0], [3.0, 1.0]], [[3.0, 0.0], [0.0, 3.0]],
                                    [[3.0, -1.0], [2.0, 1.0]]])  # fmt: skip
def test_interval_of_difference_holds_truth(shares: list[list[float]]) -> None:
    random, held, widths = np.random.default_rng(1), 0, []
    for _ in range(TRIES):
        found = difference(*drawn(random, shares, [1.0, 0.5], [0.0, 2.0]))
        held += found.low <= 2.0 <= found.high
        widths.append(found.high - found.low)
    assert RIGHT[0] < held / TRIES < RIGHT[1]
    apart = np.subtract(*np.array(shares))
    assert widths[0] == pytest.approx(2 * 1.96 * math.hypot(1.0, 0.5, *apart), rel=1e-3)


def test_equal_shares_cancel() -> None:
    first, second = Level(1.0, 0.1, 0.1, {"g": 5.0}), Level(1.3, 0.1, 0.1, {"g": 5.0})
    found = difference(first, second)
    assert found.high - found.value == pytest.approx(1.96 * 0.1 * math.sqrt(2.0), rel=1e-3)
    assert found.cancelled > 0.999
    other = difference(first, Level(1.3, 0.1, 0.1, {"another g": 5.0}))
    assert other.high - other.value > 13.0
    assert other.cancelled == pytest.approx(0.0)


@pytest.mark.parametrize(("few", "more", "ratio"), [(2, 5, 3.0), (2, 10, 2.0), (5, 5, 1.0)])
def test_interval_between_few_runs_holds_truth(few: int, more: int, ratio: float) -> None:
    """Degrees of freedom of Welch and Satterthwaite: 90, 88 and 96 of 100."""
    random, held = np.random.default_rng(2), 0
    for _ in range(TRIES):
        first, second = random.normal(0.0, ratio, few), random.normal(0.0, 1.0, more)
        found = difference(of_samples(list(first)), of_samples(list(second)))
        assert (found.p_value < 0.05) == (not found.low <= 0.0 <= found.high)
        held += found.low <= 0.0 <= found.high
    assert 0.93 < held / TRIES < 0.99


def test_two_groups_are_tested_by_cochran_and_cox() -> None:
    """A group without an error of its own leaves Student's t of the other."""
    samples = [1.0, 1.2, 0.9, 1.4]
    referee = stats.ttest_1samp(samples, 0.8)
    found = difference(Level(0.8, 0.0, 0.0), of_samples(samples))
    assert found.p_value == pytest.approx(referee.pvalue, rel=1e-9)
    assert (found.low, found.high) == pytest.approx(
        [end - 0.8 for end in referee.confidence_interval(0.95)], rel=1e-9
    )


def test_several_means_are_tested_as_by_welch() -> None:
    random = np.random.default_rng(3)
    samples = [random.normal(0.5 * k, 1.0 + k, 4 + 2 * k) for k in range(4)]
    found = homogeneity([of_samples(list(item)) for item in samples])
    referee = oneway.anova_oneway(samples, use_var="unequal")
    assert found.p_value == pytest.approx(referee.pvalue, rel=1e-9)


def test_lopsided_interval_counts_on_its_side() -> None:
    first, second = Level(0.0, 0.1, 1.0), Level(1.0, 0.2, 3.0)
    found = difference(first, second)
    assert found.value - found.low == pytest.approx(1.96 * math.hypot(1.0, 0.2), rel=1e-3)
    assert found.high - found.value == pytest.approx(1.96 * math.hypot(0.1, 3.0), rel=1e-3)


@pytest.mark.parametrize("gap", [-3.0, -1.0, 0.0, 0.7, 2.5])
def test_small_p_is_an_interval_without_zero(gap: float) -> None:
    found = difference(Level(0.0, 0.2, 0.6), Level(gap, 0.3, 0.9, freedom=4.0))
    assert (found.p_value < 0.05) == (not found.low <= 0.0 <= found.high)


def test_open_end_shows_no_difference() -> None:
    found = difference(Level(0.0, 0.1, math.inf), Level(9.0, 0.1, 0.1))
    assert (found.low, found.p_value) == (-math.inf, 1.0)
    assert homogeneity([Level(0.0, 0.1, math.inf), Level(9.0, 0.1, 0.1)]).p_value == 1.0
    assert difference(Level(0.0, 0.1, math.inf), Level(-9.0, 0.1, 0.1)).p_value < 1e-6


def test_equal_campaigns_are_seldom_named() -> None:
    random = np.random.default_rng(4)
    shares = [[2.0, 0.5], [2.0, 0.0], [2.0, 0.5], [1.5, 0.5]]
    own = [0.3, 0.6, 1.0, 0.5]
    named = sum(
        homogeneity(drawn(random, shares, own, [1.0] * 4)).p_value < 0.05 for _ in range(TRIES)
    )
    assert 1.0 - RIGHT[1] < named / TRIES < 1.0 - RIGHT[0]


def test_two_without_any_error_are_equal_or_not() -> None:
    assert homogeneity([Level(1.0, 0.0, 0.0)] * 2).p_value == 1.0
    assert homogeneity([Level(1.0, 0.0, 0.0), Level(2.0, 0.0, 0.0)]).p_value == 0.0
    assert homogeneity([Level(1.0, 0.0, 0.0)] * 3).p_value == 1.0


def test_one_of_three_without_error_is_tested() -> None:
    others = [Level(1.1, 0.1, 0.1, freedom=3.0), Level(1.2, 0.2, 0.2, freedom=2.0)]
    found = homogeneity([Level(1.0, 0.0, 0.0, freedom=1.0), *others])
    nearly = homogeneity([Level(1.0, 1e-7, 1e-7, freedom=1.0), *others])
    assert 0.0 < found.p_value < 1.0
    assert found.p_value == pytest.approx(nearly.p_value, rel=1e-6)


def test_trend_is_that_of_least_squares() -> None:
    random, at = np.random.default_rng(5), np.array([0.0, 1.0, 2.5, 4.0, 4.5])
    levels = drawn(random, [[0.4]] * 5, [0.5, 0.2, 0.4, 0.3, 0.6], list(1.0 + 0.1 * at))
    found = trend(levels, at)
    design = np.stack([np.ones(5), at], axis=1)
    referee = linear_model.GLS(
        [item.value for item in levels], design, sigma=covariance(levels)
    ).fit()
    assert found is not None
    assert found.value == pytest.approx(referee.params[1], rel=1e-9)
    sd = math.sqrt(referee.normalized_cov_params[1, 1])
    assert found.high - found.value >= 1.96 * sd * (1.0 - 1e-3)


def test_trend_holds_truth() -> None:
    random, at, held = np.random.default_rng(6), np.linspace(0.0, 1.0, 8), 0
    for _ in range(TRIES // 4):
        found = trend(drawn(random, [[0.5]] * 8, [0.3] * 8, list(0.4 * at)), at)
        assert found is not None
        held += found.low <= 0.4 <= found.high
    assert held / (TRIES // 4) > 0.94


def test_two_dates_make_no_trend() -> None:
    assert trend([Level(0.0, 1.0, 1.0)] * 3, np.array([1.0, 1.0, 2.0])) is None


def test_holm_is_that_of_statsmodels() -> None:
    p_values = list(np.random.default_rng(7).uniform(0.0, 0.1, 9))
    assert holm(p_values) == pytest.approx(
        list(multitest.multipletests(p_values, method="holm")[1])
    )


def of_runs(name: str, values: np.ndarray, u: Uncertainty | None = None) -> Campaign:
    """Return the campaign of a measure: a run for each row of ``values``, a trial for each value.

    ``u`` is the stated uncertainty of what measures it.
    """
    said = Measure("mu", "mean", "a.b", Window(), "1", systematic=u)
    read = [
        TrialReading(Path(f"{name}-{run}.mcap"), trial, float(value))
        for run, row in enumerate(values)
        for trial, value in enumerate(row, 1)
    ]
    origins = tuple(
        ResultOrigin(f"{name}-{run}.mcap", "bench", "wear", MEASURES, "", {}, {})
        for run in range(len(values))
    )
    return campaign_of_measures(name, origins, MeasureResult((summary_of(said, {}, read),)))


def test_runs_that_differ_make_no_difference() -> None:
    random, named, tries = np.random.default_rng(11), 0, 600
    for _ in range(tries):
        before, after = (
            of_runs(name, random.standard_normal((4, 1)) + 0.3 * random.standard_normal((4, 10)))
            for name in ("before", "after")
        )
        (row,) = compare([before, after]).compared
        named += row.differs
    assert 0.02 < named / tries < 0.08


def test_groups_of_one_run_are_not_judged() -> None:
    random = np.random.default_rng(12)
    before, after = (
        of_runs(name, mean + 0.01 * random.standard_normal((1, 10)))
        for name, mean in (("before", 1.0), ("after", 1.1))
    )
    (row,) = compare([before, after]).compared
    assert row.differences["after"].value == pytest.approx(0.1, abs=0.02)
    assert (row.test, row.slope, row.verdict) == (None, None, "not judged")
    assert row.why.startswith("before, after: one run")


def test_group_of_one_run_spares_the_others() -> None:
    random = np.random.default_rng(13)
    groups = [
        of_runs(name, mean + 0.01 * random.standard_normal((runs, 10)))
        for name, mean, runs in (("dry", 1.0, 1), ("oiled", 1.1, 4), ("worn", 1.3, 4))
    ]
    (row,) = compare(groups).compared
    (alone,) = compare(groups[1:]).compared
    assert row.test == alone.test and row.differs
    assert (row.base, set(row.differences)) == ("oiled", {"dry", "worn"})
    assert row.why.startswith("dry: one run") and not alone.why


#: Of a sensor with steps of 0.05 mm; three equal values have a scatter of 1e-19 by rounding.
STEPS = Uncertainty(0.05e-3)


@pytest.mark.parametrize("trials", [1, 3])
def test_step_of_sensor_makes_no_difference(trials: int) -> None:
    before, after = (
        of_runs(name, np.full((2, trials), mean), STEPS)
        for name, mean in (("before", 1.00e-3), ("after", 1.01e-3))
    )
    (row,) = compare([before, after]).compared
    found = row.differences["after"]
    assert found.value == pytest.approx(0.01e-3)
    assert found.high - found.value == pytest.approx(1.96 * math.sqrt(2.0) * STEPS.size, rel=1e-3)
    assert row.verdict == "none found" and found.p_value > 0.5


def test_scatter_of_runs_lets_u_cancel() -> None:
    before, after = (
        of_runs(name, np.array([[mean], [mean + 0.02e-3]]), Uncertainty(5e-3))
        for name, mean in (("before", 1.0e-3), ("after", 1.5e-3))
    )
    found = compare([before, after]).compared[0].differences["after"]
    assert found.high - found.value < 0.2e-3 and found.cancelled > 0.999


def test_group_all_alike_is_tested_among_three() -> None:
    groups = [
        of_runs("dry", np.full((3, 1), 1.00e-3), STEPS),
        of_runs("oiled", np.array([[1.01e-3], [1.02e-3], [1.06e-3]]), STEPS),
        of_runs("worn", np.array([[1.00e-3], [1.01e-3], [0.98e-3]]), STEPS),
    ]
    (row,) = compare(groups).compared
    assert row.verdict == "none found"


@pytest.mark.parametrize("scale", [1e200, 1e-200])
def test_extreme_levels_are_compared_as_plain_ones(scale: float) -> None:
    rows = [(1.0, 0.2, 0.1), (1.5, 0.1, 0.1), (2.2, 0.3, 0.1)]
    plain, extreme = (
        [Level(value * k, own * k, own * k, {"u": share * k}, 5.0) for value, own, share in rows]
        for k in (1.0, scale)
    )
    usual, other = difference(*plain[:2]), difference(*extreme[:2])
    assert other.high == pytest.approx(usual.high * scale)
    assert other.p_value == pytest.approx(usual.p_value)
    assert homogeneity(extreme).p_value == pytest.approx(homogeneity(plain).p_value)
    at = np.array([0.0, 1.0, 2.0])
    line, steep = trend(plain, at), trend(extreme, at)
    assert line is not None and steep is not None
    assert steep.high == pytest.approx(line.high * scale)
    assert steep.p_value == pytest.approx(line.p_value)
