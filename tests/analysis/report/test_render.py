import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from html import escape, unescape

import matplotlib as mpl
import pytest
from support.panel.markup import outline

from rigd.analysis.parameters import ParameterEvaluation
from rigd.analysis.report import (
    Facts,
    Provenance,
    ReportAttachment,
    ReportSection,
    summary_rows,
)
from rigd.analysis.report.palette import VARIABLES
from rigd.analysis.result import Verdict

HOSTILE = "<script>alert(1)</script> & \"x\" 'y' $\\alpha$ ]]> --> {{ 7*7 }} fill: #1c2024 0.123456"


def test_tags_nest_and_references_resolve(page: str) -> None:
    found = outline(page)
    assert found.faults == []
    assert found.open == []
    assert len(found.ids) == len(set(found.ids))
    assert found.targets <= set(found.ids)


def test_page_loads_nothing(page: str) -> None:
    assert "http" not in page
    assert "@import" not in page
    found = outline(page)
    assert not {"script", "link", "iframe", "object", "image", "img"} & set(found.tags)
    assert not re.search(r"\ssrc=|url\((?!#)", page)


def test_page_of_9_trials_stays_below_1300_kilobytes(page: str) -> None:
    """One of 30 trials is then below 4 MB: half of it does not grow with the trials."""
    assert len(page.encode()) < 1.3e6


def test_every_parameter_and_verdict_is_there(page: str, three_floors: list[ReportSection]) -> None:
    text = unescape(page)
    for section in three_floors:
        chapter = text.split(f'class="chapter">\n<h2>{section.label}</h2>')[1].split("<section")[0]
        for row in summary_rows([section]):
            assert row.meaning in chapter
            assert row.sentence in chapter
            assert row.advice in chapter
            assert row.verdict.value in chapter
            assert row.interval_text in chapter
        for trial in section.result.trials:
            assert f"<strong>{trial.label}</strong>" in chapter or f"<h4>{trial.label}" in chapter
        assert section.result.preprocessing.rejected[0].reason in chapter
        assert section.result.warnings[0] in chapter
        assert section.result.residual_tests[0].sentence in chapter


def test_every_trial_has_figure_with_all_its_signals(
    page: str, three_floors: list[ReportSection]
) -> None:
    described = outline(page).labels
    assert all(described)
    for section in three_floors:
        for trial in section.result.trials:
            own = [label for label in described if label.startswith(f"Trial {trial.label}:")]
            assert len(own) == len(three_floors)
            for signal in ("wheel speed", "carriage speed", "relative speed", "traction force"):
                assert signal in own[0]


def test_unidentifiable_value_appears_only_in_the_starts(
    make_section: Callable[..., ReportSection],
) -> None:
    section = make_section(trials=1, samples=200)
    lost = section.result.parameter("V_s")
    assert lost.verdict is Verdict.UNIDENTIFIABLE
    telltale = replace(lost, estimate=7.3519, low=7.1917, high=7.5137)
    result = replace(section.result, parameters=(telltale, *section.result.parameters[1:]))
    html = ParameterEvaluation(
        "t", tuple([replace(section, result=result)]), (), Provenance()
    ).report()
    for number in ("7.35", "7.19", "7.51"):
        assert number not in html


def test_biased_without_interval_is_not_called_unidentifiable(
    make_section: Callable[..., ReportSection],
) -> None:
    section = make_section(trials=1, samples=200)
    biased = replace(section.result.parameter("sigma_1"), low=None, high=None)
    result = replace(section.result, parameters=(biased,), derived=(), starts=())
    html = ParameterEvaluation(
        "t", tuple([replace(section, result=result)]), (), Provenance()
    ).report()
    assert "biased, no value" in html
    assert "not identifiable" not in html


def test_bytes_do_not_depend_on_settings_of_matplotlib(
    make_section: Callable[..., ReportSection], provenance: Provenance
) -> None:
    sections = [make_section(trials=1, samples=300)]
    first = ParameterEvaluation("t", tuple(sections), (), provenance).report()
    with mpl.rc_context({"font.size": 31.0, "svg.fonttype": "path", "axes.grid": False}):
        before = dict(mpl.rcParams)
        second = ParameterEvaluation("t", tuple(sections), (), provenance).report()
        assert dict(mpl.rcParams) == before
    assert first == second


def test_hostile_text_is_shown_as_it_is(make_section: Callable[..., ReportSection]) -> None:
    section = make_section(trials=2, samples=200)
    result = section.result
    trials = tuple(
        replace(
            trial,
            label=f"{HOSTILE}{i}",
            condition=HOSTILE,
            output=HOSTILE,
            unit=HOSTILE,
            signals={HOSTILE: next(iter(trial.signals.values()))},
        )
        for i, trial in enumerate(result.trials)
    )
    parameters = tuple(
        replace(p, symbol=HOSTILE, meaning=HOSTILE, sentence=HOSTILE, unit=HOSTILE)
        for p in result.parameters
    )
    hostile = ReportSection(
        HOSTILE,
        replace(result, trials=trials, parameters=parameters, title=HOSTILE, warnings=(HOSTILE,)),
        reference_label=HOSTILE,
    )
    provenance = Provenance(
        (Facts(HOSTILE, {HOSTILE: HOSTILE}),), (ReportAttachment(HOSTILE, HOSTILE),)
    )
    html = ParameterEvaluation(HOSTILE, tuple([hostile]), (), provenance).report()
    found = outline(html)
    assert found.faults == []
    assert "script" not in found.tags
    assert f"<title>{escape(HOSTILE).replace('&quot;', '&#34;').replace('&#x27;', '&#39;')}" in html
    inside_figures = "".join(found.text)
    assert f"{HOSTILE} [{HOSTILE}]" in inside_figures


def test_figures_follow_the_colours_of_the_page(page: str) -> None:
    figures = "".join(re.findall(r"<svg.*?</svg>", page, re.DOTALL))
    for shade, (name, _) in VARIABLES.items():
        assert f"--{name}:" in page
        assert shade not in figures
    assert not re.search(r"(fill|stroke): #(?!fff)", figures)


def test_section_of_an_almost_empty_result_is_drawn(bare_section: ReportSection) -> None:
    html = ParameterEvaluation("Bare", tuple([bare_section]), (), Provenance()).report()
    found = outline(html)
    assert found.faults == []
    assert "cannot be traced to recordings" in html
    assert "Profile likelihoods" not in html
    assert "Correlation" not in html


def test_error_of_plain_number_has_no_unit(bare_section: ReportSection) -> None:
    plain = tuple(replace(trial, unit="1") for trial in bare_section.result.trials)
    section = replace(bare_section, result=replace(bare_section.result, trials=plain))
    html = ParameterEvaluation("Plain", (section,), (), Provenance()).report()
    assert re.search(r"RMS [\d.]+, R²", html)


def test_section_without_trials(bare_section: ReportSection) -> None:
    empty = replace(bare_section, result=replace(bare_section.result, trials=()))
    assert (
        outline(ParameterEvaluation("Empty", tuple([empty]), (), Provenance()).report()).faults
        == []
    )


@pytest.mark.parametrize("copies", [0, 2])
def test_sections_must_exist_and_differ(bare_section: ReportSection, copies: int) -> None:
    with pytest.raises(ValueError, match="section"):
        ParameterEvaluation("t", tuple([bare_section] * copies), (), Provenance()).report()


def test_naming_the_report_does_not_import_matplotlib() -> None:
    code = "import sys, rigd.analysis.report; sys.exit('matplotlib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
