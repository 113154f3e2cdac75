"""The posterior of the friction of a rig: as its profiles, where these are right."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from support.lugre_bench import known_rig

from rigd.analysis import ConfigError, Options
from rigd.analysis.fitting.model import to_scaled
from rigd.analysis.output_error.marginal import Marginal
from rigd.analysis.result import FitOutcome, IdentificationResult
from rigd_analyses.lugre.conclusion import conclude_group
from rigd_analyses.lugre.identify import Settings
from rigd_analyses.lugre.reading import identify
from rigd_analyses.lugre.rig.found import FRICTION
from rigd_analyses.lugre.rig.identify import FirstFit, fit_group, profiles, visited_slip

CURRENTS_A = (0.3, 0.7, 1.2)
Bench = Callable[..., Any]


@pytest.fixture(scope="module")
def begun(bench: Bench) -> FirstFit:
    rig = bench("pvc")
    settings = Settings(starts=1)
    return fit_group(rig.sweep(3, CURRENTS_A), rig.constants, known_rig(rig.constants), settings)


@pytest.fixture(scope="module")
def result(begun: FirstFit) -> IdentificationResult:
    return conclude_group(begun, posterior=True)


def test_marginal_is_what_refits_give(begun: FirstFit) -> None:
    density = Marginal(begun.whole, FRICTION)
    parameters = begun.whole.model.parameters
    visited = visited_slip(begun.system, begun.whole)
    for name, line in profiles(begun.whole, visited).items():
        for theta, refitted in zip(line.thetas, line.statistic, strict=True):
            found = density.statistic(to_scaled(parameters, theta)[:FRICTION])
            assert found == pytest.approx(refitted, abs=0.15), name  # 3.84 is the threshold


def test_credible_intervals_are_those_of_profiles(result: IdentificationResult) -> None:
    assert result.posterior is not None
    assert result.posterior.agreed
    for item in result.posterior.parameters:
        beside = result.parameter(item.name)
        assert beside.identifiable, item.name
        assert None not in (item.low, item.high, beside.low, beside.high)
        half, other = (
            0.5 * math.log((found.high or 0.0) / (found.low or 1.0)) for found in (item, beside)
        )
        assert half == pytest.approx(other, rel=0.1), item.name
        assert item.estimate == pytest.approx(beside.estimate, rel=0.1 * other), item.name


def test_posterior_needs_output_error() -> None:
    with pytest.raises(ConfigError, match="output error alone") as refused:
        identify([], Options(method="slip-force", posterior=True))
    assert "--method slip-force" in str(refused.value.hint)


def test_model_that_does_not_fit_has_no_posterior(begun: FirstFit) -> None:
    gate = replace(begun.gate, outcome=FitOutcome.MISFIT)
    assert conclude_group(replace(begun, gate=gate), posterior=True).posterior is None
