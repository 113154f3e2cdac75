"""The page of a campaign: whole, self-contained, and honest about what its numbers are."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from html import escape, unescape

import numpy as np
import pytest
from matplotlib.container import ErrorbarContainer
from support.approach_angle.recording import small_campaign
from support.approach_angle.runs import TABLE_1, drawn_rig
from support.panel.markup import outline

from rigd.analysis.report import Facts, Provenance, ReportAttachment
from rigd.analysis.report.page import render
from rigd_analyses.approach_angle.campaign.campaign import analyse_campaign
from rigd_analyses.approach_angle.raw.run_data import (
    AngleCalibration,
    AngleRun,
    Flag,
    Known,
    KnownRun,
    Regime,
    SetReference,
)
from rigd_analyses.approach_angle.report.run_plots import one_run
from rigd_analyses.approach_angle.report.set_plots import maximum_over_angle
from rigd_analyses.approach_angle.report.view import TEMPLATES, build_campaign_view, typical_run
from rigd_analyses.approach_angle.result import CampaignResult
from rigd_analyses.approach_angle.run_result import RunResult

HOSTILE = "<script>alert(1)</script> & \"x\" 'y' $\\alpha$ ]]> --> {{ 7*7 }}"
PROVENANCE = Provenance(
    (Facts("campaign.mcap", {"sha256": "9f2c"}),), (ReportAttachment("a", "b: 1"),)
)


def known_runs() -> list[KnownRun]:
    """Return the small campaign, its fourth run without weights on the scale."""
    found = []
    for number, item in enumerate(small_campaign(), start=1):
        run = item.run
        label = f"{run.set_name}, {run.voltage_v:g} V, repeat {item.repeat}"
        raw = AngleRun(
            label=label, set_name=run.set_name, alpha_rad=run.alpha_rad,
            announced_load_kg=run.announced_load_kg, voltage_v=run.voltage_v, repeat=item.repeat,
            t_s=run.t_s, gauge_a_v=run.gauge_a_v, gauge_b_v=run.gauge_b_v, wheel_v=run.wheel_v,
            platform_v=run.platform_v, stop_s=run.stop_s,
            load_n=float("nan") if number == 4 else 9.81 * run.scale_kg,
            number=number,
            wheel=run.set_name.partition("_")[0],
        )  # fmt: skip
        calibration = AngleCalibration(
            torque=Known(run.torque_scale, 0.005),
            wheel=Known(run.wheel_scale, 0.025),
            platform=Known(run.platform_scale, 4e-4),
            load=Known(1.0, 0.002),
        )
        found.append(KnownRun(raw, calibration, drawn_rig(1)))
    return found


def page_of(
    result: CampaignResult, provenance: Provenance, title: str, calibrations: Sequence[str] = ()
) -> str:
    """Return the page that a campaign has."""
    return render(
        "campaign.html.jinja",
        lambda: build_campaign_view(result, calibrations),
        provenance,
        title,
        TEMPLATES,
    )


@pytest.fixture(scope="module")
def result() -> CampaignResult:
    return analyse_campaign(known_runs(), SetReference("Table 1 of the paper", TABLE_1))


@pytest.fixture(scope="module")
def page(result: CampaignResult) -> str:
    return page_of(result, PROVENANCE, "A campaign", ["Calibration c."])


def chapter(page: str, name: str) -> str:
    """Return the part of the page on one set."""
    return unescape(page).split(f'<span class="meaning">{name}</span></h2>')[1].split("<section")[0]


def test_tags_nest_references_resolve_and_nothing_is_loaded(page: str) -> None:
    found = outline(page)
    assert found.faults == []
    assert found.open == []
    assert len(found.ids) == len(set(found.ids))
    assert found.targets <= set(found.ids)
    assert "http" not in page
    assert not {"script", "link", "iframe", "object", "image", "img"} & set(found.tags)
    assert not re.search(r"\ssrc=|url\((?!#)", page)


def test_page_of_200_runs_stays_below_three_megabytes(page: str) -> None:
    """Figures do not grow with the runs, but the markers do: 24 runs are an eighth of 200."""
    markers = page.count("<use ")
    assert len(page.encode()) + 8 * 120 * markers < 3e6


def test_the_same_input_gives_the_same_page(result: CampaignResult, page: str) -> None:
    again = page_of(result, PROVENANCE, "A campaign", ["Calibration c."])
    assert again == page


def test_every_set_has_every_figure_of_the_paper(page: str, result: CampaignResult) -> None:
    labels = outline(page).labels
    assert all(labels)
    assert sum("Maximum coefficient over the approach angle" in label for label in labels) == 1
    assert "T/(R N) over the slip ratio for clean, 0°, clean, 15°, clean, 45°." in labels
    assert "T/(R N) over the slip ratio for clean, 0° and coated, 0°." in labels
    for item in result.sets:
        text = chapter(page, item.name)
        for figure in ("(Fig. 6)", "(Figs. 7 and 8)", "(Fig. 9)", "(Fig. 10)"):
            assert figure in text
        chosen = typical_run(item, result.runs)
        assert chosen is not None
        assert f"Trial {chosen[0].run.number}, {chosen[0].run.label}: {chosen[1]}." in text


def test_nothing_is_drawn_beneath_legend_of_blocks(result: CampaignResult) -> None:
    run = next(item for item in result.runs if np.isfinite(item.better.mu))
    figure = one_run(run)
    assert figure is not None
    figure.draw_without_rendering()
    (axes,) = [ax for ax in figure.axes if "blocks" in ax.get_title()]
    legend = axes.get_legend()
    assert legend is not None
    bottom = axes.transData.inverted().transform(legend.get_window_extent())[0][1]
    drawn = np.concatenate([np.ravel(line.get_ydata()) for line in axes.lines])
    assert drawn.max() < bottom


def test_table_1_has_three_sources_and_names_coefficients(
    page: str, result: CampaignResult
) -> None:
    table = unescape(page).split('<table class="overview">')[1].split("</table>")[0]
    for name in ("rolling-direction", "usable", "resultant", "Table 1 of the paper"):
        assert name in table
    for item in result.sets:
        row = table.split(f'<span class="meaning">{item.name}</span>')[1].split("</tr>")[0]
        assert f">{TABLE_1[item.name]:.4f}<" in row
        assert item.paper.value is not None
        assert item.budget is not None
        shown = [(float(value), float(u)) for value, u in re.findall(r"([\d.]+) ± ([\d.]+)", row)]
        expected = [(item.paper.value, 2 * item.budget.paper * item.paper.value)]
        for estimate in (item.maximum, item.usable, item.resultant):
            assert estimate is not None
            expected.append((estimate.value, estimate.expanded))
        assert shown == [pytest.approx(pair, abs=6e-4) for pair in expected]
        used = "5 used, 1 left out" if item.name == "clean_0" else "6 used, 0 left out"
        assert used in row


def test_maximum_has_bars_by_both_methods(result: CampaignResult) -> None:
    (ax,) = maximum_over_angle(result).axes
    bars = {
        container.get_label(): container.lines[2]
        for container in ax.containers
        if isinstance(container, ErrorbarContainer) and container.has_yerr
    }
    for source, label in (("paper", "paper's method"), ("better", "corrected method")):
        trend = result.trends[source]
        drawn = bars[label][0].get_segments()
        assert len(drawn) == len(trend.sets)
        for segment, name, value in zip(drawn, trend.sets, trend.mu, strict=True):
            (item,) = (s for s in result.sets if s.name == name)
            assert item.maximum is not None
            u = item.paper_expanded if source == "paper" else 2.0 * item.maximum.u
            assert segment[1][1] - value == pytest.approx(u)


def test_every_budget_term_has_both_columns(page: str, result: CampaignResult) -> None:
    for item in result.sets:
        assert item.budget is not None
        text = chapter(page, item.name)
        for term in item.budget.terms:
            row = text.split(f'<th scope="row">{term.name}')[1].split("</tr>")[0]
            assert f"{100 * term.paper:.2f} %" in row
            assert f"{100 * term.better:.2f} %" in row
        assert f"{200 * item.budget.better:.2f} %" in text


def test_flagged_run_has_its_reason_and_no_number(page: str, result: CampaignResult) -> None:
    bad = result.runs[3]
    assert bad.excluded
    reason = next(flag.reason for flag in bad.flags if flag.code == "load_missing")
    flagged = unescape(page).split('<section id="flagged">')[1].split("</section>")[0]
    assert f"Trial 4, {bad.run.label}: {reason}" in re.sub(r"\s+", " ", flagged)
    row = (
        chapter(page, "clean_0").split(f'<th scope="row">{bad.run.label}</th>')[1].split("</tr>")[0]
    )
    assert row.count("<td>–</td>") + row.count('<td class="value">–</td>') >= 4
    assert reason in row


def test_typical_run_is_one_that_slid_if_any(result: CampaignResult) -> None:
    for item in result.sets:
        chosen = typical_run(item, result.runs)
        assert chosen is not None
        slid = [r for r in result.runs if r.run.set_name == item.name and not r.excluded
                and r.paper.regime is Regime.SLIDING]  # fmt: skip
        if slid:
            assert chosen[0] in slid
            below = sum(r.paper.mu < chosen[0].paper.mu for r in slid)
            assert below == (len(slid) - 1) // 2
    assert typical_run(replace(result.sets[0], name="none"), result.runs) is None


def test_text_of_users_stays_text(result: CampaignResult) -> None:
    spoilt = [
        RunResult(
            replace(run.run, label=HOSTILE),
            run.paper,
            run.better,
            (*run.flags, Flag("hostile", HOSTILE)),
        )
        for run in result.runs[:6]
    ]
    hostile = replace(
        result,
        runs=tuple(spoilt),
        sets=(replace(result.sets[0], warnings=(HOSTILE,), wheel=HOSTILE),),
        warnings=(HOSTILE,),
        reference=HOSTILE,
    )
    facts = Provenance((Facts(HOSTILE, {HOSTILE: HOSTILE}),))
    page = page_of(hostile, facts, HOSTILE, [HOSTILE])
    found = outline(page)
    assert found.faults == []
    assert "script" not in found.tags
    assert "<script>" not in page
    assert escape(HOSTILE, quote=False)[:30] in page


def test_campaign_of_only_bad_runs_shows_no_numbers() -> None:
    known = [
        replace(known_run, run=replace(known_run.run, load_n=float("nan")))
        for known_run in known_runs()[:2]
    ]
    result = analyse_campaign(known)
    page = page_of(result, PROVENANCE, "Bad")
    assert outline(page).faults == []
    assert "2 of them left out" in page
    assert result.sets[0].maximum is None
    table = page.split('<table class="overview">')[1].split("</tbody>")[0]
    assert table.count(">–<") == 5
    assert not re.search(r"\d\.\d{3}", table.split("<tbody>")[1])
