"""Method A on noisy, vibrating, counted data against the known truth (lugre.md section 7).

One experiment per floor; `benchmarks/every_case.py` plays three.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from support.cases import some

from rigd.analysis.fitting.fit import Loss
from rigd.analysis.result import IdentificationResult, Verdict
from rigd_analyses.lugre.slip_force.identify import Settings, identify_lugre
from rigd_analyses.lugre.trials.trial import LugreConstants, LugreTrial

#: Section 7 item 3: sigma_0, sigma_2, and g at 5, 20 and 50 mm/s, as shares of the truth.
BOUNDS = {
    "stone": (0.02, 0.015, 0.02),
    "pvc": (0.025, 0.015, 0.02),
    "paperboard": (0.06, 0.04, 0.07),
}
SEEDS = some((1, 2, 3), 3)
SLIP = np.array([0.005, 0.02, 0.05])

Identify = Callable[[str, int], IdentificationResult]


@pytest.fixture(scope="module")
def identified(bench: Callable[..., Any]) -> Identify:
    @cache
    def run(floor: str, seed: int) -> IdentificationResult:
        rig = bench(floor)
        return identify_lugre(rig.sweep(seed), rig.constants)

    return run


@pytest.mark.parametrize("floor", BOUNDS)
@pytest.mark.parametrize("seed", SEEDS)
def test_accuracy_on_the_papers_procedure(
    identified: Identify, bench: Callable[..., Any], floor: str, seed: int
) -> None:
    truth, result = bench(floor).truth, identified(floor, seed)
    s0, s2, g = BOUNDS[floor]
    assert result.parameter("sigma_0").estimate == pytest.approx(truth.s0, rel=s0)
    assert result.parameter("sigma_2").estimate == pytest.approx(truth.s2, rel=s2)
    found = np.interp(SLIP, result.curve.x, result.curve.y)
    np.testing.assert_allclose(found, truth.g(SLIP), rtol=g)


@pytest.mark.parametrize("floor", BOUNDS)
def test_intervals_cover_the_truth(
    identified: Identify, bench: Callable[..., Any], floor: str
) -> None:
    truth = bench(floor).truth
    covered = []
    for seed in SEEDS:
        result = identified(floor, seed)
        for name, value in (("sigma_0", truth.s0), ("sigma_2", truth.s2)):
            entry = result.parameter(name)
            assert entry.low is not None and entry.high is not None
            covered.append(entry.low <= value <= entry.high)
            assert entry.high - entry.low < 0.4 * entry.estimate
        low = np.interp(SLIP, result.curve.x, result.curve.low)
        high = np.interp(SLIP, result.curve.x, result.curve.high)
        covered += list((low <= truth.g(SLIP)) & (truth.g(SLIP) <= high))
        assert np.all(high - low < 0.2 * truth.g(SLIP))
    assert np.mean(covered) >= 0.88


@pytest.mark.parametrize(
    ("floor", "names"),
    [
        ("stone", ("V_s", "mu_s-mu_c")),
        ("paperboard", ("V_s", "mu_c")),
    ],
)
@pytest.mark.parametrize("seed", SEEDS)
def test_constants_unknown_to_the_paper_are_flagged(
    identified: Identify, floor: str, names: tuple[str, ...], seed: int
) -> None:
    for name in names:
        entry = identified(floor, seed).parameter(name)
        assert entry.verdict is Verdict.UNIDENTIFIABLE, entry
        assert entry.low is None and entry.high is None
        assert not entry.identifiable
        assert entry.sentence and entry.advice


@pytest.mark.parametrize("floor", BOUNDS)
def test_sigma_1_never_reads_as_known(identified: Identify, floor: str) -> None:
    entry = identified(floor, 1).parameter("sigma_1")
    assert entry.verdict in (Verdict.BIASED, Verdict.UNIDENTIFIABLE)
    assert not entry.identifiable
    assert "biased by this method" in entry.flags


def test_the_curve_stays_on_the_visited_slip(
    identified: Identify, bench: Callable[..., Any]
) -> None:
    result = identified("stone", 1)
    fastest = max(float(np.max(t.signals["V_r"].values)) for t in result.trials)
    assert result.curve.x[-1] <= fastest
    assert np.all(result.curve.low < result.curve.y)
    assert np.all(result.curve.y < result.curve.high)
    assert "extrapolation" in result.visited


@pytest.mark.parametrize("floor", BOUNDS)
def test_the_curve_begins_where_the_slip_is_resolved(identified: Identify, floor: str) -> None:
    result = identified(floor, 1)
    assert 0.001 <= result.curve.x[0] <= 0.005  # counts leave 0.2 mm/s of noise in the slip
    assert np.all(result.curve.high - result.curve.low < 0.3 * result.curve.y)


@pytest.mark.parametrize("floor", BOUNDS)
@pytest.mark.parametrize("seed", SEEDS)
def test_friction_is_unknown_if_V_s_is_open(identified: Identify, floor: str, seed: int) -> None:
    result = identified(floor, seed)
    speed = {p.name: p for p in result.profiles}["V_s"]
    if speed.high is None:
        assert not result.parameter("mu_c").identifiable
        assert not result.parameter("mu_s-mu_c").identifiable
    if speed.low is None:
        assert not result.parameter("mu_s").identifiable


@pytest.mark.parametrize("floor", BOUNDS)
@pytest.mark.parametrize("seed", SEEDS)
def test_quoted_friction_interval_contains_the_truth(
    identified: Identify, bench: Callable[..., Any], floor: str, seed: int
) -> None:
    truth, result = bench(floor).truth, identified(floor, seed)
    for name, value in (("V_s", truth.v_s), ("mu_c", truth.mu_c), ("mu_s", truth.mu_s)):
        entry = result.parameter(name)
        if entry.low is not None and entry.high is not None:
            assert entry.low <= value <= entry.high, entry


@pytest.mark.parametrize("floor", BOUNDS)
def test_sentences_keep_to_the_allowed_and_the_possible(identified: Identify, floor: str) -> None:
    result = identified(floor, 1)
    limits = {"V_s": (1e-4, 10.0), "mu_c": (1e-4, 2.0), "mu_s": (1e-4, 110.0)}
    for name, (least, most) in {**limits, "mu_s-mu_c": (0.0, 110.0)}.items():
        entry = result.parameter(name)
        bounded = entry.sentence if entry.verdict is Verdict.UNIDENTIFIABLE else ""
        for number in re.findall(r"-?\d+\.?\d*(?:e-?\d+)?", bounded):
            assert least <= float(number) <= most, entry.sentence
        for words in ("fit the slip position", "reversals"):
            assert words not in entry.advice
        if "No test" in entry.advice:
            assert "predicted" not in entry.advice


def test_json_has_the_promised_form(identified: Identify) -> None:
    text = json.dumps(identified("pvc", 1).to_json(), allow_nan=False)
    data = json.loads(text)
    assert list(data["parameters"]) == ["V_s", "mu_c", "mu_s", "sigma_0", "sigma_1", "sigma_2"]
    for entry in data["parameters"].values():
        assert {"estimate", "low", "high", "unit", "identifiable"} <= set(entry)
        assert entry["identifiable"] == (entry["low"] is not None)
    assert set(data["friction_curve"][0]) == {"V_r", "g", "low", "high"}
    assert data["parameters"]["V_s"]["unit"] == "m/s"


def test_two_runs_agree_bit_for_bit(identified: Identify, bench: Callable[..., Any]) -> None:
    rig = bench("pvc")
    again = identify_lugre(rig.sweep(1), rig.constants)
    assert again.to_json() == identified("pvc", 1).to_json()


def test_residuals_are_reported_as_coloured(identified: Identify) -> None:
    result = identified("pvc", 1)
    whiteness = {t.name: t for t in result.residual_tests}["whiteness (Ljung-Box)"]
    assert not whiteness.passed
    # The 31 ms filter alone correlates white noise over 13.8 samples; vibration takes some of it.
    assert 1.5 < result.inflation < 5.0
    assert result.effective_samples <= result.samples
    assert all(0.1 < t.rms < 0.35 for t in result.trials)  # N; vibration is 0.2 N


def test_robust_loss_reduces_error_from_accelerometer_spikes(bench: Callable[..., Any]) -> None:
    rig = bench("stone")
    rng = np.random.default_rng(21)
    spoiled = []
    for trial in rig.sweep(1):
        a = trial.acceleration_m_s2.copy()
        a[rng.choice(np.arange(400, len(a)), 8, replace=False)] += 60.0
        spoiled.append(replace(trial, acceleration_m_s2=a))
    errors: Mapping[Loss, float] = {
        loss: abs(
            identify_lugre(spoiled, rig.constants, Settings(loss=loss, starts=2))
            .parameter("sigma_2")
            .estimate
            / rig.truth.s2
            - 1.0
        )
        for loss in (Loss.SQUARES, Loss.HUBER)
    }
    assert errors[Loss.HUBER] < 0.5 * errors[Loss.SQUARES]


def test_forgotten_rolling_resistance_moves_sigma_0_as_documented(
    bench: Callable[..., Any],
) -> None:
    rig = bench("pvc")
    known: LugreConstants = rig.constants
    forgotten = LugreConstants(known.mass_kg, known.wheel_radius_m, known.guide_friction_n, 0.0)
    trials: list[LugreTrial] = rig.sweep(1)
    found = identify_lugre(trials, forgotten, Settings(starts=2)).parameter("sigma_0").estimate
    assert found < 0.8 * rig.truth.s0  # section 8: -38 % on PVC
