"""Table, report and JSON object agree on which numbers a person may see."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigd.analysis.parameters import ParameterEvaluation
from rigd.analysis.report import Provenance, ReportSection, summary_rows
from rigd.analysis.report.svg import drawing_style
from rigd.analysis.report.view import build_view
from rigd.analysis.result import ParameterEstimate, Verdict

ENDS = st.none() | st.floats(0.1, 10.0)
OPEN = (Verdict.UNIDENTIFIABLE, Verdict.UNRESOLVED, Verdict.CONSTANTS, Verdict.MISFIT)


@pytest.fixture(scope="module")
def section(make_section: Callable[..., ReportSection]) -> ReportSection:
    return make_section(trials=1, samples=200)


@st.composite
def parameters(draw: st.DrawFn) -> ParameterEstimate:
    return ParameterEstimate(
        "sigma_0", "σ_0", "1/m", "stiffness", draw(st.floats(0.1, 10.0)), draw(ENDS), draw(ENDS),
        draw(ENDS), draw(st.sampled_from(Verdict)), "A sentence.",
    )  # fmt: skip


@given(parameter=parameters())
def test_json_gives_numbers_where_the_table_does(
    section: ReportSection, parameter: ParameterEstimate
) -> None:
    result = replace(section.result, parameters=(parameter,), derived=())
    row = summary_rows([replace(section, result=result)])[0]
    found: Any = result.to_json()["parameters"]
    item = found["sigma_0"]
    assert item["estimate"] == row.estimate
    assert (item["estimate"] is None) == (not row.known)
    assert row.known == any(character.isdigit() for character in row.estimate_text)
    if parameter.verdict in OPEN:
        assert item["estimate"] is item["low"] is item["high"] is item["standard_error"] is None
        assert not item["identifiable"]


def test_no_open_parameter_has_number_in_terminal(
    section: ReportSection, provenance: Provenance
) -> None:
    verdicts = dict(zip("abcdefg", Verdict, strict=True))
    found = tuple(
        replace(section.result.parameters[3], name=name, verdict=verdict, estimate=7.25)
        for name, verdict in verdicts.items()
    )
    section = replace(section, result=replace(section.result, parameters=found, derived=()))
    table: Any = ParameterEvaluation("t", (section,), ((),), provenance).terminal_report()[0]
    for row in table.rows:
        shown = " ".join(row.cells[2:4])
        assert any(c.isdigit() for c in shown) == (verdicts[row.cells[1]] not in OPEN), row


def test_trials_with_equal_names_are_distinguished(section: ReportSection) -> None:
    """As in two recordings of one condition; the greatest reach may stand in either of them."""
    first = section.result.trials[0]
    further = replace(first, fitted=3.0 * first.fitted, rms=9.0)
    for trials in ((first, further), (further, first)):
        with drawing_style():
            result = replace(section.result, trials=trials)
            chapter = build_view([replace(section, result=result)]).chapters[0]
        assert chapter.featured is not None
        assert "RMS 9" in chapter.featured.quality
        assert len(chapter.trials) == 1
