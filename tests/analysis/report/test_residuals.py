from collections.abc import Callable

import numpy as np

from rigd.analysis.report import ReportSection
from rigd.analysis.report.residuals import end_to_end, normal_quantiles, pooled, residual


def test_residual_is_only_where_samples_were_used(
    make_section: Callable[..., ReportSection],
) -> None:
    trials = make_section(trials=3, samples=400).result.trials
    first = residual(trials[0])
    assert np.array_equal(np.isfinite(first), trials[0].used)
    assert pooled(trials).size == sum(int(t.used.sum()) for t in trials)


def test_trials_follow_one_another(make_section: Callable[..., ReportSection]) -> None:
    trials = make_section(trials=3, samples=400).result.trials
    time, values, starts = end_to_end(trials)
    assert time.size == values.size == 1200
    assert np.all(np.diff(time) >= 0)
    assert starts == [0.0, time[399], time[799], time[1199]]


def test_normal_values_lie_on_diagonal_unlike_heavy_tails() -> None:
    rng = np.random.default_rng(8)
    expected, found = normal_quantiles(rng.normal(3.0, 2.0, 20_000))
    middle = np.abs(expected) < 2.5
    assert np.abs(expected - found)[middle].max() < 0.08
    expected, found = normal_quantiles(rng.standard_t(3, 20_000))
    assert found[-1] > expected[-1] + 1.0


def test_residual_plots_accept_constant_or_no_values() -> None:
    assert normal_quantiles(np.ones(50))[0].size == 0
    assert normal_quantiles(np.array([1.0, 2.0]))[0].size == 0
    assert pooled(()).size == 0
    assert end_to_end(())[0].size == 0
