"""Friction laws are compared on data of an independent simulation: the law that made them wins."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from support.cases import some
from support.lugre.bench import FLOORS, PAPER_CURRENTS_A, Bench
from support.lugre.law_bench import SURFACES, LawBench

from rigd.analysis import ConfigError, Options
from rigd.analysis.result import FitOutcome, IdentificationResult, ModelComparison
from rigd_analyses.lugre.slip_force.by_law import compare_by_law, identify_by_law
from rigd_analyses.lugre.slip_force.identify import Settings

#: What each surface has that its law must find, with a tolerance; the stiffness of Maxwell-slip
#: elements adds up. Of a law with a bristle the smoothing moves the damping.
TRUTH: dict[str, dict[str, tuple[float, float]]] = {
    "dahl-viscous": {"mu": (0.11, 0.02), "sigma_0": (45.0, 0.05), "sigma_2": (2.6, 0.02)},
    "magic-formula": {"D": (0.32, 0.01), "C": (1.5, 0.01), "B": (35.0, 0.01)},
    "lugre-rolling": {"kappa": (12.0, 0.05), "sigma_0": (45.0, 0.05), "sigma_2": (2.5, 0.03)},
    "maxwell-slip": {"sigma_0": (85.0, 0.05), "spread": (4.0, 0.05), "sigma_2": (2.2, 0.02)},
}  # fmt: skip


@pytest.mark.parametrize("law", some(list(SURFACES), 4, 2))
def test_the_law_that_made_the_data_wins(law: str) -> None:
    bench = LawBench("stone", law=law)
    found = _compared(bench, (0.3, 0.6, 0.9, 1.2, 1.5))
    best = found.scores[0]
    assert best.name == law
    assert found.scores[1].delta_bic > 2.0
    assert f"The data support {best.parameters} parameters: {law}." in found.sentences
    for name, (value, tolerance) in TRUTH[law].items():
        assert best.estimates[name] == pytest.approx(value, rel=tolerance), name


@pytest.mark.parametrize("floor", some(list(FLOORS), 3, 1))
def test_a_floor_of_the_paper_supports_4_parameters(
    floor: str, bench: Callable[..., Bench]
) -> None:
    """As lugre.md section 9 has it, in BIC over the best."""
    scores = {score.name: score for score in _compared(bench(floor)).scores}
    assert scores["lugre-4"].delta_bic < 2.0
    for name, least in (("lugre", 3.0), ("lugre-rolling", 5.0), ("coulomb-viscous", 1000.0)):
        assert scores[name].delta_bic > least, name
    assert not scores["coulomb-viscous"].fits
    assert not scores["dahl"].fits
    assert scores["lugre-4"].cv_error < 1.03 * min(score.cv_error for score in scores.values())


def test_another_law_gets_intervals_verdicts_and_curve(bench: Callable[..., Bench]) -> None:
    stone = bench("stone")
    found = _by_law("lugre-4", stone)
    assert found.gate is not None
    assert found.gate.outcome is FitOutcome.FITS
    known = {entry.name: entry for entry in found.parameters}
    for name, truth in (("sigma_0", stone.truth.s0), ("sigma_2", stone.truth.s2)):
        low, high = known[name].low, known[name].high
        assert low is not None
        assert high is not None
        assert low < truth < high, name
        assert high - low < 0.2 * truth
    assert known["sigma_1"].quoted is None
    curve = found.curve
    steady = stone.truth.g(curve.x) + stone.truth.s2 * curve.x
    inside = (curve.x > 0.005) & (curve.x < 0.05)
    np.testing.assert_allclose(curve.y[inside], steady[inside], rtol=0.02)
    assert np.mean((curve.low <= steady) & (steady <= curve.high)) > 0.9


def test_band_holds_laws_not_ruled_out(bench: Callable[..., Bench]) -> None:
    """Below 10 mm/s PVC has a Stribeck effect of 8 % that lugre-4 lacks, at a ΔBIC of 5."""
    pvc = bench("pvc")
    found = _by_law("lugre-4", pvc)
    assert found.gate is not None
    assert found.gate.outcome is FitOutcome.FITS
    assert any("do not rule out lugre" in warning for warning in found.warnings)
    curve = found.curve
    steady = pvc.truth.g(curve.x) + pvc.truth.s2 * curve.x
    assert np.mean((curve.low <= steady) & (steady <= curve.high)) > 0.9


def test_law_that_does_not_fit_gives_no_number(bench: Callable[..., Bench]) -> None:
    found = _by_law("coulomb-viscous", bench("stone"))
    assert found.gate is not None
    assert found.gate.outcome is FitOutcome.MISFIT
    assert {entry.quoted for entry in found.parameters} == {None}


def test_a_comparison_with_robust_loss_is_refused(bench: Callable[..., Bench]) -> None:
    stone = bench("stone")
    with pytest.raises(ConfigError, match="--compare: BIC needs the least squares"):
        compare_by_law(stone.sweep(), stone.constants, Settings(), Options(robust=True))


def _compared(bench: Bench, currents: tuple[float, ...] = PAPER_CURRENTS_A) -> ModelComparison:
    trials, options = bench.sweep(currents=currents), Options(starts=2, compare=True)
    return compare_by_law(trials, bench.constants, Settings(), options)[0]


def _by_law(law: str, bench: Bench) -> IdentificationResult:
    options = Options(starts=2, law=law)
    return identify_by_law(bench.sweep(), bench.constants, Settings(), options)
