"""What a mean, an interval and a verdict claim, against data whose truth is known."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import stats
from scipy.signal import lfilter

from rigd.analysis.measures.mean import LEAST_SAMPLES, mean_of
from rigd.analysis.measures.ranges import Sensors
from rigd.analysis.measures.result import Judgement, TrialReading, outcome_of, summary_of
from rigd.analysis.measures.trend import trend_of
from rigd.model.channels import Channel
from rigd.model.constants import Uncertainty
from rigd.procedure.program import Measure, Window

FILE = Path("run.mcap")


def correlated(rng: np.random.Generator, n: int, phi: float) -> np.ndarray:
    """Return a series of an AR(1) process with mean 0, after it has forgotten its beginning."""
    return lfilter([1.0], [1.0, -phi], rng.standard_normal(n + 500))[500:]


@pytest.mark.parametrize("phi", [-0.5, 0.0, 0.5, 0.9])
def test_uncertainty_of_mean_counts_correlation(phi: float) -> None:
    rng, n = np.random.default_rng(1), 2000
    found = [mean_of(correlated(rng, n, phi)) for _ in range(200)]
    true = 1 / (1 - phi) / math.sqrt(n)  # of the mean of an AR(1) process
    stated = [mean.u for mean in found if mean.u is not None]
    assert len(stated) > 190
    assert np.mean(stated) == pytest.approx(true, rel=0.1)
    hit = np.mean([abs(mean.value) <= 1.96 * mean.u for mean in found if mean.u is not None])
    assert 0.90 < hit < 0.99  # 95 % of 200 series, with three standard deviations of that count


@pytest.mark.parametrize(
    ("n", "phi"),
    [
        (n, phi)
        for n in (30, 50, 100, 200, 1000)
        for phi in (-0.9, -0.5, 0.0, 0.3, 0.5, 0.8)
        if (1 - phi) / (1 + phi) * n >= 20  # are independent: fewer make no statement
    ],
)
def test_interval_of_few_samples_holds_truth(n: int, phi: float) -> None:
    rng = np.random.default_rng([n, round(10 * phi) + 10])
    held = []
    for _ in range(300):
        mean = mean_of(correlated(rng, n, phi))
        if mean.u is not None:
            held.append(abs(mean.value) <= 1.96 * mean.u)
    assert len(held) > 200
    assert 0.90 < np.mean(held) <= 0.99  # 95 %, with three standard deviations of that count


@pytest.mark.parametrize("phi", [0.8, 0.9])
def test_few_independent_samples_seldom_claim(phi: float) -> None:
    """Which series seem independent is chance, and those that do by chance are wrong."""
    rng = np.random.default_rng(7)
    found = [mean_of(correlated(rng, 30, phi)) for _ in range(300)]
    wrong = [abs(mean.value) > 1.96 * mean.u for mean in found if mean.u is not None]
    assert sum(wrong) < 0.09 * len(found)


def test_hum_hides_no_noise_of_mean() -> None:
    """Hum of the mains beside noise a third as large: it does not move the mean, noise does."""
    rng, n, held = np.random.default_rng(5), 1000, []
    for _ in range(200):
        hum = 3.0 * np.sin(2.0 * np.pi * (0.05 * np.arange(n) + rng.random()))
        mean = mean_of(hum + rng.standard_normal(n))
        if mean.u is not None:
            held.append(abs(mean.value) <= 1.96 * mean.u)
    assert len(held) > 150
    assert 0.90 < np.mean(held) <= 0.99


def test_noise_hides_no_slow_wander() -> None:
    """Friction wanders over 100 samples, by 0.3 of the noise of its sensor."""
    rng, n, held = np.random.default_rng(6), 5000, []
    for _ in range(200):
        wander = 0.3 * math.sqrt(1 - 0.99**2) * correlated(rng, n, 0.99)
        mean = mean_of(wander + rng.standard_normal(n))
        if mean.u is not None:
            held.append(abs(mean.value) <= 1.96 * mean.u)
    assert len(held) > 150
    assert 0.90 < np.mean(held) <= 0.99


def toggling(rng: np.random.Generator, truth: float, noise: float, n: int) -> np.ndarray:
    """Return samples of a sensor that shows steps of 1."""
    return np.round(truth + noise * rng.standard_normal(n))


@pytest.mark.parametrize("noise", [0.1, 0.2, 0.3, 0.4, 0.5, 1.0])
def test_uncertainty_of_mean_holds_steps(noise: float) -> None:
    """Noise below a step leaves the mean of any number of samples up to half of it off."""
    rng = np.random.default_rng([8, round(10 * noise)])
    held = []
    for _ in range(300):
        truth = rng.uniform(7.0, 8.0)
        mean = mean_of(toggling(rng, truth, noise, 1000))
        if mean.u is not None:  # else all are one number
            held.append(abs(mean.value - truth) <= 1.96 * mean.u)
    assert len(held) > 150
    assert np.mean(held) >= 0.92


def test_noise_above_steps_averages_them_out() -> None:
    mean = mean_of(toggling(np.random.default_rng(9), 7.3, 0.7, 4000))
    assert mean.u == pytest.approx(math.hypot(0.7, 1 / math.sqrt(12)) / math.sqrt(4000), rel=0.15)


def test_states_of_switches_are_not_rounded() -> None:
    on = np.random.default_rng(3).random(1000) < 0.3
    mean = mean_of(on.astype(float), rounded=False)
    assert mean.u == pytest.approx(math.sqrt(0.3 * 0.7 / 1000), rel=0.2)
    share = Channel("on", low=0.0, high=1.0)
    assert not Sensors({"heater.on": share}, {}).rounds("heater.on")
    assert Sensors({"heater.on": replace(share, high=10.0)}, {}).rounds("heater.on")


@pytest.mark.parametrize(("noise", "between"), [(0.1, 1.0), (0.2, 0.0), (0.3, 0.2)])
def test_interval_of_toggling_trials_holds_truth(noise: float, between: float) -> None:
    """Equal trials have the same error of rounding: their scatter does not show it."""
    rng = np.random.default_rng([9, round(10 * noise), round(10 * between)])
    held = []
    for _ in range(200):
        truth, found = rng.uniform(7.0, 8.0), []
        for number in range(5):
            samples = toggling(rng, truth + between * rng.standard_normal(), noise, 400)
            mean = mean_of(samples)
            reading = TrialReading(FILE, number, mean.value, mean.u, hidden=mean.hidden)
            found.append(reading)
        summary = summary_of(measure(), {}, found)
        if summary.low is not None and summary.high is not None:
            held.append(summary.low <= truth <= summary.high)
    assert np.mean(held) >= 0.92


def test_naive_uncertainty_would_be_far_too_small() -> None:
    values = correlated(np.random.default_rng(2), 5000, 0.95)
    naive = values.std() / math.sqrt(len(values))
    u = mean_of(values).u
    assert u is not None
    assert u > 4 * naive


@pytest.mark.parametrize("phi", [0.99, 0.999])
def test_mean_without_independent_samples_claims_nothing(phi: float) -> None:
    rng = np.random.default_rng(3)
    wrong = 0
    for _ in range(100):
        mean = mean_of(correlated(rng, 500, phi))
        assert mean.u is not None or "fewer than 10" in mean.reason
        wrong += mean.u is not None
    assert wrong < 10
    drift = mean_of(np.linspace(0, 1, 1000))
    assert drift.u is None
    assert drift.value == pytest.approx(0.5)


@pytest.mark.parametrize("n", [1, 2, 29])
def test_few_samples_have_mean_without_uncertainty(n: int) -> None:
    mean = mean_of(np.arange(n, dtype=float))
    assert mean.value == pytest.approx((n - 1) / 2)
    assert mean.u is None
    assert n < LEAST_SAMPLES


@pytest.mark.parametrize("values", [np.arange(100) % 2, np.arange(100) % 3, np.eye(100)[50]])
def test_regular_samples_have_no_uncertain_crash(values: np.ndarray) -> None:
    mean = mean_of(values.astype(float))
    assert mean.u is None or 0.0 <= mean.u < 1.0


def test_equal_samples_have_no_uncertainty() -> None:
    found = mean_of(np.full(100, 2.5))
    assert found.value == 2.5
    assert found.u is None  # not 0: noise is hidden by a step of the sensor, or it is stuck
    assert "all equal" in found.reason


def measure(
    low: float = -math.inf, high: float = math.inf, u: Uncertainty | None = None
) -> Measure:
    judged = math.isfinite(low) or math.isfinite(high)
    return Measure("mu", "mean", "a.b", Window(), "1", systematic=u, low=low, high=high,
                   is_judged=judged)  # fmt: skip


def readings(*values: float | None) -> list[TrialReading]:
    return [TrialReading(FILE, number, value) for number, value in enumerate(values, 1)]


def test_interval_is_that_of_students_t() -> None:
    values = [0.121, 0.118, 0.125, 0.119, 0.122]
    summary = summary_of(measure(), {}, readings(*values))
    low, high = stats.t.interval(0.95, 4, np.mean(values), stats.sem(values))
    assert summary.mean == pytest.approx(np.mean(values))
    assert summary.std == pytest.approx(np.std(values, ddof=1))
    assert summary.low == pytest.approx(low)
    assert summary.high == pytest.approx(high)
    assert summary.judgement is None


def test_systematic_uncertainty_does_not_average_out() -> None:
    rng = np.random.default_rng(4)
    halves = {}
    for n in (4, 400):
        u = Uncertainty(0.01)
        summary = summary_of(measure(u=u), {}, readings(*(1 + 0.002 * rng.standard_normal(n))))
        assert summary.low is not None
        assert summary.high is not None
        halves[n] = (summary.high - summary.low) / 2
    assert halves[400] == pytest.approx(1.96 * 0.01, rel=0.01)
    assert halves[4] > halves[400]


def test_freedom_is_that_of_welch_and_satterthwaite() -> None:
    values, u = [1.0, 1.2, 1.1], 0.05
    summary = summary_of(measure(u=Uncertainty(u)), {}, readings(*values))
    a = stats.sem(values)
    together = math.hypot(a, u)
    freedom = together**4 / (a**4 / 2)  # GUM G.2b, the systematic part with infinitely many
    half = stats.t.ppf(0.975, freedom) * together
    assert summary.high == pytest.approx(1.1 + half, rel=1e-12)


def test_share_is_of_the_mean() -> None:
    summary = summary_of(measure(u=Uncertainty(0.01, is_share=True)), {}, readings(2.0, 2.0))
    assert summary.systematic == pytest.approx(0.02)


@pytest.mark.parametrize(
    ("values", "bounds", "expected", "why"),
    [
        ([0.12, 0.121, 0.119], (0.10, 0.14), Judgement.ACCEPTED, ""),
        ([0.12, 0.121, 0.119], (0.13, 0.14), Judgement.REJECTED, "outside"),
        ([0.12, 0.121, 0.119], (-math.inf, 0.11), Judgement.REJECTED, "outside"),
        # The mean alone would pass: its interval reaches beyond the bound.
        ([0.12, 0.13, 0.11], (0.11, 0.14), Judgement.UNDECIDED, "across a bound"),
        # The mean alone would fail.
        ([0.12, 0.13, 0.11], (0.125, 0.2), Judgement.UNDECIDED, "across a bound"),
        # An interval wider than what is allowed is not outside.
        ([0.12, 0.2, 0.04], (0.119, 0.121), Judgement.UNDECIDED, "across a bound"),
        ([0.12], (0.10, 0.14), Judgement.UNDECIDED, "one trial shows no repeatability"),
        ([0.5], (0.10, 0.14), Judgement.UNDECIDED, "repeatability: give 'repeats: 2' or more"),
        ([0.12, None], (0.10, 0.14), Judgement.UNDECIDED, "the other 1 could not be read"),
        ([0.12, 0.121, None], (0.10, 0.14), Judgement.UNDECIDED, "1 of 3 trials could not be"),
        ([None, None], (0.10, 0.14), Judgement.UNDECIDED, "in no trial"),
        # A step of the sensor, or a simulation without noise: no scatter is no certainty.
        ([0.12, 0.12], (0.10, 0.14), Judgement.UNDECIDED, "all trials gave the same value"),
        ([0.12, 0.12 + 1e-17], (0.10, 0.14), Judgement.UNDECIDED, "gave the same value"),
    ],
)
def test_verdict_is_by_the_whole_interval(
    values: list[float | None], bounds: tuple[float, float], expected: Judgement, why: str
) -> None:
    summary = summary_of(measure(*bounds), {}, readings(*values))
    assert summary.judgement is expected
    assert why in summary.why
    assert bool(why) == bool(summary.why)


@pytest.mark.parametrize(
    ("values", "u", "words"),
    [
        ([0.138, 0.136, 0.140], None, "about 7 trials would decide it"),
        ([0.139, 0.141], None, "the mean lies at the bound, and more repeats do not help"),
        ([0.1389, 0.1409], None, "100 trials would not decide it"),
        ([0.139, 0.1391], 0.002, "'u' alone reaches the bound, and more repeats do not help"),
    ],
)
def test_advice_promises_only_what_repeats_can_do(
    values: list[float], u: float | None, words: str
) -> None:
    stated = None if u is None else Uncertainty(u)
    summary = summary_of(measure(0.10, 0.14, stated), {}, readings(*values))
    assert summary.judgement is Judgement.UNDECIDED
    assert words in summary.why


def test_trials_that_are_advised_decide() -> None:
    values = [0.138, 0.136, 0.140]
    summary = summary_of(measure(0.10, 0.14), {}, readings(*values, *values, 0.138))
    assert summary.judgement is Judgement.ACCEPTED


def test_stated_u_gives_equal_trials_an_interval() -> None:
    summary = summary_of(measure(0.10, 0.14, Uncertainty(0.001)), {}, readings(0.12, 0.12))
    assert summary.judgement is Judgement.ACCEPTED
    assert summary.high == pytest.approx(0.12 + 1.96e-3, rel=1e-3)


@pytest.mark.parametrize("noise", [0.02, 0.1, 0.2, 0.5])
@pytest.mark.parametrize("n", [4, 6, 10])
def test_step_above_the_scatter_leaves_intervals_right(noise: float, n: int) -> None:
    """Nearly all of the values are one: the truth lies up to half a step beside it."""
    rng = np.random.default_rng([6, n])
    held: list[bool] = []
    while len(held) < 200:
        truth = rng.uniform(1.0, 2.0)
        values = np.round(truth + noise * rng.standard_normal(n))
        if np.ptp(values) > 0.0:  # else there is no interval
            found = summary_of(measure(), {}, readings(*values.tolist()))
            assert found.low is not None
            assert found.high is not None
            held.append(found.low <= truth <= found.high)
    assert np.mean(held) >= 0.92


def test_hidden_scatter_never_cancels_in_comparisons() -> None:
    stated = summary_of(measure(u=Uncertainty(0.3)), {}, readings(*[5.0] * 9, 6.0))
    assert stated.u is not None
    assert stated.u > 1 / math.sqrt(12)  # of the group alone, beside what all groups share


def test_trend_has_its_stated_rate_of_false_alarms() -> None:
    rng = np.random.default_rng(5)
    for n in (4, 6, 12):
        named = sum(trend_of(rng.standard_normal(n).tolist()) is not None for _ in range(2000))
        assert 6 <= named <= 36  # 20 expected; three and a half standard deviations


def test_drift_is_named_in_order_of_play() -> None:
    drifting = [0.120, 0.122, 0.1245, 0.126, 0.1275]
    played = [TrialReading(FILE, number, value, start_ns=number)
              for number, value in enumerate(drifting)]  # fmt: skip
    trend = summary_of(measure(), {}, played[::-1]).trend
    assert trend is not None
    assert trend.per_trial == pytest.approx(0.0019)
    assert summary_of(measure(), {}, readings(0.12, 0.12, 0.12, 0.12, 0.12)).trend is None
    assert summary_of(measure(), {}, readings(*drifting[:3])).trend is None


def test_runs_that_begin_together_are_not_mixed() -> None:
    steps = (0.1200, 0.1201, 0.1199)  # of each run; the runs differ
    played = [
        TrialReading(Path(f"{run}.mcap"), number, run + value, start_ns=number)
        for run in range(4)
        for number, value in enumerate(steps)
    ]
    mixed = sorted(played, key=lambda item: item.start_ns)  # as it was: each run in turn
    assert trend_of([item.value for item in mixed if item.value is not None]) is None
    trend = summary_of(measure(), {}, played).trend
    assert trend is not None
    assert trend.per_trial == pytest.approx(0.315, rel=0.01)


def test_one_rejected_result_rejects_all() -> None:
    accepted, undecided = Judgement.ACCEPTED, Judgement.UNDECIDED
    assert outcome_of([None, accepted, Judgement.REJECTED, undecided]) is Judgement.REJECTED
    assert outcome_of([accepted, undecided]) is undecided
    assert outcome_of([accepted, None]) is accepted
    assert outcome_of([None, None]) is None


def runs_of(*runs: list[float]) -> list[TrialReading]:
    """Return the readings of several recordings, each with its values."""
    return [
        TrialReading(Path(f"run_{run}.mcap"), number, value)
        for run, values in enumerate(runs)
        for number, value in enumerate(values, 1)
    ]


def test_several_runs_count_by_their_means() -> None:
    clusters = ([0.3071, 0.3075, 0.3079], [0.3372, 0.3375, 0.3378])  # two specimens
    found = summary_of(measure(low=0.2, high=0.4), {}, runs_of(*clusters))
    mean, half = 0.3225, float(stats.t.ppf(0.975, 1)) * 0.03 / 2
    assert found.runs == 2
    assert (found.low, found.high) == pytest.approx((mean - half, mean + half))
    assert found.judgement is Judgement.UNDECIDED
    assert "runs would decide" in found.why


@pytest.mark.parametrize(("runs", "trials"), [(3, 3), (5, 4), (8, 2)])
@pytest.mark.parametrize("between", [0.0, 0.5, 1.0, 3.0])
def test_interval_over_runs_holds_true_mean(runs: int, trials: int, between: float) -> None:
    rng, tries = np.random.default_rng([runs, trials, round(10 * between)]), 400
    hit = 0
    for _ in range(tries):
        values = between * rng.standard_normal((runs, 1)) + rng.standard_normal((runs, trials))
        found = summary_of(measure(), {}, runs_of(*values.tolist()))
        assert found.low is not None
        assert found.high is not None
        hit += found.low <= 0.0 <= found.high
    assert 0.917 < hit / tries < 0.983  # 95 %, with three standard deviations of that count


def test_equal_means_of_runs_are_not_decided() -> None:
    found = summary_of(measure(low=0.0), {}, runs_of([1.0, 2.0], [2.0, 1.0]))
    assert found.low is None
    assert found.judgement is Judgement.UNDECIDED
    assert "all runs gave the same mean" in found.why


def test_single_trial_runs_count_as_trials() -> None:
    found = summary_of(measure(), {}, runs_of([1.0], [2.0], [4.0]))
    assert found.runs is None
    assert found.low is not None


@pytest.mark.parametrize("scale", [1e200, 1e-200])
def test_extreme_values_have_their_scatter(scale: float) -> None:
    values = [1.0, 1.1, 1.22, 1.3, 1.39, 1.52]
    plain, extreme = (
        summary_of(measure(), {}, readings(*[value * k for value in values])) for k in (1.0, scale)
    )
    assert plain.std is not None and plain.high is not None and plain.trend is not None
    assert extreme.std == pytest.approx(plain.std * scale)
    assert extreme.high == pytest.approx(plain.high * scale)
    assert extreme.trend is not None
    assert extreme.trend.per_trial == pytest.approx(plain.trend.per_trial * scale)
    assert extreme.trend.p == pytest.approx(plain.trend.p)


@pytest.mark.parametrize("scale", [1e200, 1e-200])
def test_extreme_samples_have_uncertainty_of_mean(scale: float) -> None:
    samples = 3.0 + correlated(np.random.default_rng(4), 2000, 0.5)
    plain, extreme = mean_of(samples), mean_of(samples * scale)
    assert plain.u is not None
    assert extreme.u == pytest.approx(plain.u * scale)
