"""A report opens with what may be used and what may not, at a terminal and as a page."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from rigd.analysis.fitting.residuals import ljung_box, normality, outliers
from rigd.analysis.parameters import ParameterEvaluation
from rigd.analysis.report import Heading, Provenance, ReportSection
from rigd.analysis.report.opening import listed, opening_of
from rigd.analysis.result import FitOutcome, Gate
from rigd.cli.views.evaluation import print_evaluation

Maker = Callable[..., ReportSection]


@pytest.fixture
def stone(make_section: Maker) -> ReportSection:
    return make_section(trials=1, samples=200)


def test_known_parameters_and_curve_are_usable(stone: ReportSection) -> None:
    usable, not_usable = opening_of([stone]).sentences
    assert usable.startswith("Usable: sigma_0, sigma_2, sigma_sum, mu_c (roughly), mu_s (roughly)")
    assert "from 2 to 120 mm/s (±" in usable
    assert "V_s: not identifiable from this excitation" in not_usable
    assert "sigma_1: biased by this method" in not_usable
    assert "sigma_0" not in not_usable


def test_usable_numbers_name_tests_that_fail(stone: ReportSection) -> None:
    noise = np.random.default_rng(1).standard_normal(1000)
    spoilt = np.where(np.arange(1000) % 4 == 0, 50.0, noise)
    checks = (ljung_box([spoilt], 20), normality(noise, 1.0), outliers(spoilt))
    opening = opening_of([replace(stone, result=replace(stone.result, residual_tests=checks))])
    assert opening.usable.endswith(
        ", with care: the residuals do not pass whiteness (Ljung-Box) and outliers (25 % of the "
        "samples lie beyond 5 robust standard deviations)."
    )
    passed = replace(stone.result, residual_tests=(outliers(noise),))
    assert "with care" not in opening_of([replace(stone, result=passed)]).usable
    gate = Gate(FitOutcome.FITS, "The model fits these data.")
    judged = replace(stone.result, residual_tests=checks, gate=gate)
    assert "with care" not in opening_of([replace(stone, result=judged)]).usable


def test_opening_names_group_of_each_parameter(make_section: Maker, stone: ReportSection) -> None:
    other = make_section("Paperboard", trials=1, samples=200)
    known = tuple(
        replace(p, verdict=stone.result.parameter("sigma_0").verdict, low=1.0, high=2.0)
        for p in other.result.parameters
    )
    opening = opening_of([stone, replace(other, result=replace(other.result, parameters=known))])
    assert opening.usable.startswith("Natural stone: sigma_0")
    assert "Paperboard: V_s, mu_c" in opening.usable
    assert "V_s (Natural stone): not identifiable" in opening.not_usable


def test_misfit_gives_nothing_to_use(stone: ReportSection) -> None:
    gate = Gate(FitOutcome.MISFIT, "The model does not fit these data: a radius is wrong.")
    misfit = replace(stone, result=replace(stone.result, gate=gate))
    opening = opening_of([misfit])
    assert opening.usable == "no number."
    assert opening.not_usable.endswith("does not fit these data: a radius is wrong.")


def test_wide_band_is_not_usable(stone: ReportSection) -> None:
    curve = stone.result.curve
    wide = replace(curve, low=0.5 * curve.y, high=1.5 * curve.y)
    opening = opening_of([replace(stone, result=replace(stone.result, curve=wide))])
    assert "mm/s" not in opening.usable
    assert "its band is too wide" in opening.not_usable


def test_result_without_curve_is_opened(stone: ReportSection) -> None:
    empty = np.empty(0)
    none = replace(stone.result.curve, x=empty, y=empty, low=empty, high=empty)
    opening = opening_of([replace(stone, result=replace(stone.result, curve=none))])
    assert "sigma_0" in opening.usable


def test_page_and_terminal_begin_with_both_sentences(
    stone: ReportSection, capsys: pytest.CaptureFixture[str]
) -> None:
    heading = Heading("SIMULATED", (("Rig", "lugre-1"), ("specimen", "W7"), ("Procedure", "p")))
    evaluation = ParameterEvaluation(
        "The title", (stone,), ((),), Provenance(heading=heading), ({},)
    )
    page = evaluation.report()
    order = [">The title</h1>", "Usable:", "Not usable:", "SIMULATED", "lugre-1", "W7", "<h2>"]
    places = [page.index(words) for words in order]
    assert places == sorted(places)
    print_evaluation(evaluation)
    shown = capsys.readouterr().out
    assert shown.startswith("Usable: ")
    order = ["Not usable:", "SIMULATED; Rig lugre-1; specimen W7", "parameter"]
    places = [shown.index(words) for words in order]
    assert places == sorted(places)
    assert "Procedure" not in shown


@pytest.mark.parametrize(
    ("names", "text"),
    [([], ""), (["a"], "a"), (["a", "b"], "a and b"), (["a", "b", "c"], "a, b and c")],
)
def test_names_are_listed_as_people_do(names: list[str], text: str) -> None:
    assert listed(names) == text
