"""Compared models on page and terminal: what the data support, a table, the curves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from html import unescape

import numpy as np
import pytest
from support.panel.markup import outline

from rigd.analysis.parameters import ParameterEvaluation
from rigd.analysis.report import Provenance, ReportSection
from rigd.analysis.report.plots.models import models
from rigd.analysis.report.tables.models import model_rows
from rigd.analysis.result import ModelComparison, ModelScore
from rigd.analysis.terminal import TerminalTable

X = np.geomspace(0.002, 0.08, 30)


def score(name: str, delta: float, error: float, fits: bool, slope: float) -> ModelScore:
    return ModelScore(
        name, f"The law {name}", 4, delta, error, fits, () if fits else ("mu",), {"mu": 0.1},
        0.1 + slope * X,
    )  # fmt: skip


COMPARISON = ModelComparison(
    sentences=("The data support 4 parameters: short.", "Cross-validation agrees."),
    scores=(
        score("short", 0.0, 0.00604, True, 2.0),
        score("long", 12.34, 0.006, True, 2.1),
        score("wrong", 1741.1, 0.0605, False, 900.0),
    ),
    effective_samples=390.0,
    unit="F/F_N",
    x=X,
    x_name="V_r",
    x_unit="m/s",
    y_name="steady_friction",
)


@pytest.fixture
def evaluation(make_section: Callable[..., ReportSection]) -> ParameterEvaluation:
    section = make_section(trials=1, samples=200)
    with_models = replace(section, result=replace(section.result, comparison=COMPARISON))
    return ParameterEvaluation("Friction", (with_models,), ((),), Provenance(), ({},), ((),))


def test_rows_give_differences_and_reasons() -> None:
    rows = model_rows(COMPARISON)
    assert [row.cells for row in rows] == [
        ("short", "4", "0.0", "0.00604 (+0.7 %)", ""),
        ("long", "4", "12.3", "0.00600", ""),
        ("wrong", "4", "1741.1", "0.06050 (+908 %)", "does not fit; on a bound: mu"),
    ]


def test_page_reports_what_the_data_support(evaluation: ParameterEvaluation) -> None:
    page = evaluation.report()
    found = outline(page)
    assert found.faults == []
    text = unescape(page)
    for sentence in COMPARISON.sentences:
        assert sentence in text
    assert "The law wrong" in text
    assert "390 samples as independent ones" in text


def test_page_without_comparison_has_no_such_part(
    make_section: Callable[..., ReportSection],
) -> None:
    section = make_section(trials=1, samples=200)
    page = ParameterEvaluation("Friction", (section,), ((),), Provenance()).report()
    assert "Which model the data support" not in page


def test_terminal_ends_with_what_the_data_support(evaluation: ParameterEvaluation) -> None:
    *_, table, said = evaluation.terminal_report()
    assert isinstance(table, TerminalTable)
    assert [row.faint for row in table.rows] == [False, False, True]
    assert all(len(row.cells) == len(table.columns) for row in table.rows)
    assert said == "\n".join(COMPARISON.sentences)


def test_json_gives_no_estimate_of_a_misfit(evaluation: ParameterEvaluation) -> None:
    found = evaluation.to_json()["comparison"]
    assert isinstance(found, dict)
    assert [model["estimates"] for model in found["models"]] == [{"mu": 0.1}, {"mu": 0.1}, None]
    assert found["models"][1]["delta_bic"] == 12.34


def test_a_wrong_model_does_not_flatten_the_curves() -> None:
    ax = models(COMPARISON).axes[0]
    assert [line.get_label() for line in ax.get_lines()] == ["short", "long", "wrong"]
    assert [line.get_linestyle() for line in ax.get_lines()] == ["-", "-", ":"]
    assert ax.get_ylim()[1] < 0.5
    assert float(np.max(COMPARISON.scores[2].curve)) > 10.0
