"""The posterior in terminal, page and JSON object, from draws that are made up."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from html import unescape

import numpy as np
import pytest
from support.markup import outline

from rigd.analysis.parameters import ParameterEvaluation
from rigd.analysis.posterior_result import CredibleInterval, Mode, Posterior, Ridge
from rigd.analysis.report import Provenance, ReportSection
from rigd.analysis.terminal import TerminalTable

NAMES = ("sigma_0", "sigma_2")
NOTE = "sigma_0 and sigma_2 lie on a ridge (rank correlation +0.990)."


def interval(name: str, centre: float, *, agreed: bool) -> CredibleInterval:
    median, low, high = (centre * share if agreed else None for share in (1.0, 0.9, 1.1))
    return CredibleInterval(
        name, name, "s/m", median, low, high, 1.002, 900.0, 700.0, (Mode(centre, 1.0),),
        "" if agreed else "The chains do not agree yet.",
    )  # fmt: skip


def posterior(*, agreed: bool) -> Posterior:
    rng = np.random.default_rng(1)
    first = 11.0 + 0.1 * rng.standard_normal((4, 300))
    draws = np.stack([first, first / 5.0], axis=-1)
    parameters = tuple(
        interval(name, centre, agreed=agreed)
        for name, centre in zip(NAMES, (11.0, 2.2), strict=True)
    )
    return Posterior(
        agreed, parameters, (Ridge(*NAMES, 0.99),), (NOTE,), 1.1, 1, 4000, draws
    )  # fmt: skip


@pytest.fixture(params=[True, False], ids=["agreed", "not agreed"])
def evaluation(
    request: pytest.FixtureRequest, make_section: Callable[..., ReportSection]
) -> ParameterEvaluation:
    section = make_section(trials=1, samples=200)
    result = replace(section.result, posterior=posterior(agreed=request.param))
    section = replace(section, result=result)
    return ParameterEvaluation("Friction", (section,), ((),), Provenance(), ({},), ((),))


def agreed(evaluation: ParameterEvaluation) -> bool:
    found = evaluation.sections[0].result.posterior
    return found is not None and found.agreed


def test_terminal_shows_intervals_and_notes(evaluation: ParameterEvaluation) -> None:
    *_, table, text = evaluation.terminal_report()
    assert isinstance(table, TerminalTable)
    assert [row.faint for row in table.rows] == [not agreed(evaluation)] * 2
    cells = table.rows[0].cells
    assert cells[:3] == (
        ("sigma_0", "11.0", "9.9 … 12.1") if agreed(evaluation) else ("sigma_0", "–", "–")
    )
    assert "1.002" in cells
    assert "900 (700)" in cells
    assert isinstance(text, str)
    assert NOTE in text
    assert "4 independent chains" in text


def test_page_has_densities_and_the_ridge(evaluation: ParameterEvaluation) -> None:
    page = evaluation.report()
    assert outline(page).faults == []
    text = unescape(page)
    assert NOTE in text
    assert "Draws of pairs that lie on a ridge: sigma_0 and sigma_2." in text
    assert ("The chains do not agree yet." in text) is not agreed(evaluation)


def test_json_object_has_no_draws(evaluation: ParameterEvaluation) -> None:
    found = evaluation.to_json()["posterior"]
    assert isinstance(found, dict)
    assert found["draws"] == 1200
    known = found["parameters"]["sigma_0"]
    assert known["r_hat"] == 1.002
    assert (known["low"] is None) is not agreed(evaluation)
