"""Builds the content of a campaign's report page: tables as text, figures as drawings.

Importing this module imports matplotlib.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from rigd.analysis.report.rounding import number
from rigd.analysis.report.svg import Drawing, draw
from rigd_analyses.approach_angle.raw.run_data import Coefficient, Regime
from rigd_analyses.approach_angle.report import run_plots, set_plots
from rigd_analyses.approach_angle.report.tables import (
    BudgetRow,
    FlaggedRow,
    RunRow,
    SetRow,
    SlipRow,
    TrendRow,
    budget_rows,
    estimate,
    flagged_rows,
    label,
    run_rows,
    set_rows,
    share,
    slip_rows,
    slip_voltages,
    stop_sentences,
    trend_rows,
    trend_sentence,
    trial_of,
)
from rigd_analyses.approach_angle.result import CampaignResult, FrictionCurve, SetResult
from rigd_analyses.approach_angle.run_result import RunResult

TEMPLATES: Final = Path(__file__).parent / "templates"


@dataclass(frozen=True)
class BudgetView:
    """The budget of a set: its terms, and their sums in percent."""

    rows: tuple[BudgetRow, ...]
    conditions: str
    paper: str
    better: str
    paper_expanded: str
    better_expanded: str


@dataclass(frozen=True)
class SetChapter:
    """All about one set."""

    anchor: str
    row: SetRow
    facts: tuple[tuple[str, str], ...]
    typical: Drawing | None
    curve: Drawing | None
    budget: BudgetView | None
    runs: tuple[RunRow, ...]


@dataclass(frozen=True)
class CampaignView:
    """The whole report."""

    sets: tuple[SetRow, ...]
    reference: str
    coefficients: tuple[tuple[str, str], ...]
    trends: tuple[TrendRow, ...]
    trend_sentence: str
    maximum: Drawing | None
    friction: Drawing | None
    coated: Drawing | None
    curves: Drawing | None
    slip: Drawing | None
    slip_voltages: tuple[str, ...]
    slips: tuple[SlipRow, ...]
    stops: tuple[str, ...]
    flagged: tuple[FlaggedRow, ...]
    excluded: int
    runs: int
    statements: tuple[str, ...]
    warnings: tuple[str, ...]
    calibrations: tuple[str, ...]
    chapters: tuple[SetChapter, ...]


#: What each coefficient is, for people.
MEANING = {
    Coefficient.ROLLING: (
        "F_r/N, along the rolling direction: what the torque measures, and what Table 1 of the "
        "paper shows. It is a limit of friction only while the wheel slides."
    ),
    Coefficient.USABLE: (
        "(F_r cos α − F_a sin α)/N, the push along the travel: what is left for a vehicle, once "
        "the drag F_a of the free rollers is taken off."
    ),
    Coefficient.RESULTANT: "√(F_r² + F_a²)/N, the whole force in the plane of the floor.",
}


def build_campaign_view(result: CampaignResult, calibrations: Sequence[str]) -> CampaignView:
    """Return the view of ``result``, for :func:`rigd.analysis.report.page.render`.

    ``calibrations``: which were used for which recordings, and what they changed, a line each.
    """
    rows = set_rows(result)
    colours = {item.name: index for index, item in enumerate(result.sets)}
    return CampaignView(
        sets=rows,
        reference=result.reference,
        coefficients=tuple((item.value, MEANING[item]) for item in Coefficient),
        trends=trend_rows(result),
        trend_sentence=trend_sentence(result),
        maximum=_maximum(result),
        friction=_friction(result, colours),
        coated=_coated(result, colours),
        curves=_curves(result, colours),
        slip=_slip(result),
        slip_voltages=tuple(f"{volts:g} V" for volts in slip_voltages(result)),
        slips=slip_rows(result),
        stops=stop_sentences(result),
        flagged=flagged_rows(result),
        excluded=sum(run.excluded for run in result.runs),
        runs=len(result.runs),
        statements=result.statements,
        warnings=result.warnings,
        calibrations=tuple(calibrations),
        chapters=tuple(
            _chapter(f"s{index}", item, row, result, index)
            for index, (item, row) in enumerate(zip(result.sets, rows, strict=True))
        ),
    )


def typical_run(result: SetResult, runs: Sequence[RunResult]) -> tuple[RunResult, str] | None:
    """Return the run of a set to show at length, and why it: the median one of those that slid.

    Of the runs that were used if none slid, of all that were evaluated if none was used; None
    if not even that leaves one.
    """
    mine = [r for r in runs if r.run.set_name == result.name and r.paper.curves is not None]
    mine = [run for run in mine if np.isfinite(run.paper.mu)]
    used = [run for run in mine if not run.excluded]
    slid = [run for run in used if run.paper.regime is Regime.SLIDING]
    for chosen, what in ((slid, "used runs that slid"), (used, "used runs"), (mine, "runs")):
        if chosen:
            ordered = sorted(chosen, key=lambda run: run.paper.mu)
            run = ordered[(len(ordered) - 1) // 2]
            return run, f"the median in T/(R N) of the {len(chosen)} {what}"
    return None


def _maximum(result: CampaignResult) -> Drawing | None:
    if not result.trends:
        return None
    slopes = "; ".join(f"{row.source}: {row.slope} per degree" for row in trend_rows(result))
    caption = (
        "Bars: ± U (k = 2). Full lines: straight line over the clean sets. Dotted: (a + b sin α)/"
        "cos α, the force that mere rolling demands."
    )
    figure = set_plots.maximum_over_angle(result)
    return draw(
        figure, "maximum", f"Maximum coefficient over the approach angle. {slopes}.", caption
    )


def _friction(result: CampaignResult, colours: dict[str, int]) -> Drawing | None:
    sets = [item for item in result.sets if not _is_second_of_angle(item, result.sets)]
    if not sets:
        return None
    figure = set_plots.friction_over_slip(sets, result.runs, [colours[item.name] for item in sets])
    names = ", ".join(label(item) for item in sets)
    caption = (
        "Each marker is a run by the paper's method. Dotted: slip (as the paper defines it) of a "
        "wheel that rolls without any, cos α − 1. Dashed: the paper's maximum of the used runs."
    )
    return draw(figure, "friction", f"T/(R N) over the slip ratio for {names}.", caption)


def _is_second_of_angle(result: SetResult, sets: Sequence[SetResult]) -> bool:
    """Whether an earlier set has the same angle: it stands in the comparison of wheels."""
    first = next(s for s in sets if abs(s.angle_deg - result.angle_deg) < 1e-6)
    return first is not result


def _coated(result: CampaignResult, colours: dict[str, int]) -> Drawing | None:
    """Draw all wheels at the first angle that has several."""
    for first in result.sets:
        same = [s for s in result.sets if abs(s.angle_deg - first.angle_deg) < 1e-6]
        if len(same) > 1:
            figure = set_plots.coated_against_clean(
                same, result.runs, [colours[item.name] for item in same]
            )
            alt = f"T/(R N) over the slip ratio for {' and '.join(label(item) for item in same)}."
            return draw(figure, "coated", alt, alt)
    return None


def _curves(result: CampaignResult, colours: dict[str, int]) -> Drawing | None:
    sets = [item for item in result.sets if item.curve is not None]
    if not sets:
        return None
    caption = (
        "Pooled from the blocks of all used runs in which the wheel slid, over the sliding speeds "
        "that were reached. Bands: ± 2 u between runs; what all runs share (calibration, drags) "
        "stands in the budget."
    )
    figure = set_plots.pooled_curves(sets, [colours[item.name] for item in sets])
    alt = f"Friction limit F_r/N over the sliding speed for {', '.join(label(s) for s in sets)}."
    return draw(figure, "curves", alt, caption)


def _slip(result: CampaignResult) -> Drawing | None:
    if not result.slips:
        return None
    caption = (
        "Corrected slip of each set, the mean over the loads, a line for each voltage of the "
        "motor; open markers: other wheels. Bars: 95 % intervals."
    )
    alt = "Corrected slip over the approach angle, a line for each voltage; the table has them all."
    return draw(set_plots.slip_over_angle(result), "slip", alt, caption)


def _chapter(
    anchor: str, set_result: SetResult, row: SetRow, result: CampaignResult, colour: int
) -> SetChapter:
    return SetChapter(
        anchor=anchor,
        row=row,
        facts=_facts(set_result),
        typical=_typical(anchor, set_result, result),
        curve=None
        if set_result.curve is None
        else _pooled(anchor, set_result, set_result.curve, colour),
        budget=_budget(set_result),
        runs=run_rows(set_result.name, result),
    )


def _facts(result: SetResult) -> tuple[tuple[str, str], ...]:
    paper = result.paper
    facts = [
        ("Corrected method: maximum of the pooled curve", estimate(result.maximum)),
        ("Usable push along the travel", estimate(result.usable)),
        ("Resultant", estimate(result.resultant)),
        ("Paper's maximum, from", paper.run or "no run"),
        ("Runs recorded", str(paper.raw)),
        ("Left out", str(paper.flagged)),
        ("Used", str(paper.used)),
        ("Of these with sliding blocks", str(result.sliding_runs)),
    ]
    if paper.value_raw is not None and paper.value_raw != paper.value:
        facts.insert(4, ("Paper's maximum, had nothing been left out", number(paper.value_raw, 4)))
    if result.missing:
        facts.append(("Missing", "; ".join(result.missing)))
    if result.statistical_u is not None:
        facts.append(
            ("Standard uncertainty from the spread", number(result.statistical_u, digits=2))
        )
    return tuple(facts)


def _typical(anchor: str, set_result: SetResult, result: CampaignResult) -> Drawing | None:
    found = typical_run(set_result, result.runs)
    if found is None:
        return None
    run, why = found
    figure = run_plots.one_run(run)
    if figure is None:
        return None
    caption = (
        f"Trial {trial_of(run, result)}, {run.run.label}: {why}. Times since the relay command."
    )
    alt = (
        f"{run.run.label}: gauge signals with their Fourier fit, torque with Gaussian and steady "
        "segment, positions and speeds as recorded and smoothed, friction by blocks, over time."
    )
    return draw(figure, f"{anchor}-run", alt, caption)


def _pooled(anchor: str, result: SetResult, curve: FrictionCurve, colour: int) -> Drawing:
    alt = (
        f"{label(result)}: F_r/N of {curve.block_mu.size} blocks over the sliding speed, and the "
        f"curve pooled from them, with its maximum at {number(curve.peak_speed_m_s, 2)} m/s."
    )
    figure = set_plots.pooled_blocks(result, curve, colour)
    return draw(figure, f"{anchor}-curve", alt, f"{alt} Form: {curve.form}.")


def _budget(result: SetResult) -> BudgetView | None:
    budget = result.budget
    if budget is None:
        return None
    conditions = (
        f"For F_r/N = {number(budget.mu, 3)} at N = {number(budget.load_n, 1)} N and "
        f"{number(budget.wheel_speed_rad_s, 1)} rad/s, the medians of {budget.runs} runs"
    )
    return BudgetView(
        rows=budget_rows(budget.terms),
        conditions=conditions,
        paper=share(budget.paper),
        better=share(budget.better),
        paper_expanded=share(2.0 * budget.paper),
        better_expanded=share(2.0 * budget.better),
    )
