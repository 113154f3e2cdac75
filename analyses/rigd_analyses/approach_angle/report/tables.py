"""Makes the tables of a campaign as text ready to print, for the terminal and the report page.

A value that the data do not give is a dash, never a number.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from rigd.analysis.report.rounding import number, places_for
from rigd_analyses.approach_angle.budget import BudgetTerm
from rigd_analyses.approach_angle.campaign.stops import stops_of
from rigd_analyses.approach_angle.raw.run_data import Flag, Regime, Severity
from rigd_analyses.approach_angle.result import (
    CampaignResult,
    MeasuredCoefficient,
    SetResult,
    SlipPoint,
    Trend,
    file_names,
)
from rigd_analyses.approach_angle.run_result import RunResult

#: Text in place of a missing number.
NONE: Final = "–"
#: Decimals of a coefficient that comes without an uncertainty, as in the paper's Table 1.
PLACES: Final = 4
#: The names of the sources of numbers, for people.
SOURCES: Final = {
    "published": "published",
    "paper": "paper's method",
    "better": "corrected method",
}


def label(result: SetResult) -> str:
    """Return a set in words, such as ``clean, 15°``; the wheel if it is known."""
    angle = f"{number(result.angle_deg, digits=3)}°"
    return f"{result.wheel}, {angle}" if result.wheel else angle


def coefficient(value: float | None) -> str:
    """Return a coefficient to the digits of the paper's Table 1, or a dash."""
    return NONE if value is None or not np.isfinite(value) else number(value, PLACES)


def quantity(value: float, places: int) -> str:
    """Return a number with so many decimals, or a dash if there is none."""
    return number(value, places) if np.isfinite(value) else NONE


def estimate(item: MeasuredCoefficient | None) -> str:
    """Return ``0.1873 ± 0.0052`` with U = 2 u, or a dash."""
    if item is None:
        return NONE
    places = places_for(item.expanded)
    return f"{number(item.value, places)} ± {number(item.expanded, places)}"


@dataclass(frozen=True)
class SetRow:
    """A row of Table 1; ``notes`` are what a reader must know before they use a number of it."""

    name: str
    label: str
    published: str
    paper: str
    paper_regime: str  #: empty if the wheel slid in that run, as it must for a limit
    counts: str
    maximum: str
    deviation: str  #: of the better value from the published one; empty without both
    usable: str
    resultant: str
    coefficient: str
    notes: tuple[str, ...]


def set_rows(result: CampaignResult) -> tuple[SetRow, ...]:
    """Return Table 1 of the paper for this campaign, beside the published one."""
    return tuple(_set_row(item) for item in result.sets)


def _set_row(result: SetResult) -> SetRow:
    paper = result.paper
    slid = paper.regime in (None, Regime.SLIDING)
    return SetRow(
        name=result.name,
        label=label(result),
        published=coefficient(result.published),
        paper=_paper(result),
        paper_regime="" if slid or paper.regime is None else paper.regime.value,
        counts=f"{paper.used} used, {paper.flagged} left out",
        maximum=estimate(result.maximum),
        deviation=_deviation(result),
        usable=estimate(result.usable),
        resultant=estimate(result.resultant),
        coefficient=paper.coefficient.value,
        notes=result.warnings,
    )


def _paper(result: SetResult) -> str:
    """Return the paper's maximum with the U of its budget, if there is one."""
    value, expanded = result.paper.value, result.paper_expanded
    if value is None or expanded is None:
        return coefficient(value)
    places = places_for(expanded)
    return f"{number(value, places)} ± {number(expanded, places)}"


def _deviation(result: SetResult) -> str:
    if result.maximum is None or result.published is None or not result.maximum.u > 0.0:
        return ""
    off = round((result.maximum.value - result.published) / result.maximum.u, 1)
    return f"{number(off + 0.0, 1)} u"  # 0.0, never -0.0


@dataclass(frozen=True)
class TrendRow:
    """The straight line over the angle by one source, and the demand form beside it."""

    source: str
    slope: str  #: per degree
    slope_interval: str  #: 95 %, t distribution
    intercept: str
    r_squared: str
    rms: str
    demand: str
    demand_rms: str
    dof: int


def trend_rows(result: CampaignResult) -> tuple[TrendRow, ...]:
    """Return the trend over the angle by each source."""
    return tuple(_trend_row(trend) for trend in result.trends.values())


def trend_sentence(result: CampaignResult) -> str:
    """Return what may be concluded from the best trend there is; empty without any."""
    trends = [
        result.trends[item] for item in ("better", "paper", "published") if item in result.trends
    ]
    return trends[0].sentence if trends else ""


def _trend_row(trend: Trend) -> TrendRow:
    line, demand = trend.line, trend.demand
    known = np.isfinite(line.slope_u)
    places = (places_for(line.slope_u) if known else None) or 6
    return TrendRow(
        source=SOURCES.get(trend.source, trend.source),
        slope=f"{number(line.slope_per_deg, places)} ± {quantity(line.slope_u, places)}",
        slope_interval=f"{quantity(line.slope_low, places)} … {quantity(line.slope_high, places)}",
        intercept=quantity(line.intercept, PLACES),
        r_squared=quantity(line.r_squared, 3),
        rms=quantity(line.rms, 3),
        demand=f"({number(demand.a, 3)} + {number(demand.b, 3)} sin α)/cos α",
        demand_rms=quantity(demand.rms, 3),
        dof=line.dof,
    )


@dataclass(frozen=True)
class SlipRow:
    """The slip of one set over the voltages; a cell is ``0.41 ± 0.03`` or a dash."""

    label: str
    cells: tuple[str, ...]


def slip_voltages(result: CampaignResult) -> tuple[float, ...]:
    """Return the voltages of the campaign's slips, in V, rising."""
    return tuple(sorted({point.voltage_v for point in result.slips}))


def slip_rows(result: CampaignResult) -> tuple[SlipRow, ...]:
    """Return the corrected slip of each set at each voltage, as :func:`slip_voltages` has them."""
    known = {(point.set_name, point.voltage_v): point for point in result.slips}
    voltages = slip_voltages(result)
    return tuple(
        SlipRow(label(item), tuple(_slip(known.get((item.name, volts))) for volts in voltages))
        for item in result.sets
        if any(point.set_name == item.name for point in result.slips)
    )


def _slip(point: SlipPoint | None) -> str:
    if point is None:
        return NONE
    rolls = " r" if point.regimes == (Regime.ROLLING,) else ""
    if not np.isfinite(point.expanded):
        return f"{number(point.slip, 2)}{rolls}"
    places = places_for(point.expanded)
    return f"{number(point.slip, places)} ± {number(point.expanded, places)}{rolls}"


def stop_sentences(result: CampaignResult) -> tuple[str, ...]:
    """Return what the campaign shows of its automatic stop; nothing if it was not recorded."""
    stops = stops_of([item.run.run_on for item in result.runs])
    found = []
    if stops.overshoot_s.size:
        found.append(
            f"{stops.overshoot_s.size} runs were stopped by the travel. The relay was commanded "
            f"{1e3 * float(np.mean(stops.overshoot_s)):.1f} ms behind the threshold on average, "
            f"which is {1e3 * float(np.mean(stops.overshoot_m)):.0f} mm of travel, at most "
            f"{1e3 * float(np.max(stops.overshoot_m)):.0f} mm."
        )
    if stops.final_travel_m.size and stops.final_turning_rad.size:
        rest = f" In {stops.unrested} runs something still moved." if stops.unrested else ""
        found.append(
            f"The platform came to rest at {np.min(stops.final_travel_m):.3f} m to "
            f"{np.max(stops.final_travel_m):.3f} m, the wheel at "
            f"{np.min(stops.final_turning_rad):.1f} rad to "
            f"{np.max(stops.final_turning_rad):.1f} rad.{rest}"
        )
    return tuple(found)


@dataclass(frozen=True)
class BudgetRow:
    """One term of a budget: relative standard uncertainties (k = 1) in percent."""

    name: str
    input_u: str
    unit: str
    kind: str
    paper: str
    better: str
    uncorrected: bool
    systematic: bool
    source: str


def budget_rows(terms: Sequence[BudgetTerm]) -> tuple[BudgetRow, ...]:
    """Return the terms of a budget, the largest of the corrected method first."""
    ordered = sorted(terms, key=lambda term: -abs(term.better))
    return tuple(
        BudgetRow(
            name=term.name,
            input_u=number(term.input_u, digits=2),
            unit=term.unit,
            kind=term.kind,
            paper=share(term.paper),
            better=share(term.better),
            uncorrected=term.uncorrected,
            systematic=term.systematic,
            source=term.source,
        )
        for term in ordered
    )


def share(value: float) -> str:
    """Return a relative uncertainty in percent, to two decimals."""
    return f"{number(100.0 * value, 2)} %"


def trial_of(run: RunResult, result: CampaignResult) -> str:
    """Return ``6``, or ``6 of second.mcap`` if the campaign is in several recordings."""
    names = file_names(item.run.recording for item in result.runs)
    trial = str(run.run.number)
    return f"{trial} of {names[run.run.recording]}" if len(names) > 1 else trial


@dataclass(frozen=True)
class FlaggedRow:
    """One reason for a flag, with the runs that have it."""

    code: str
    excluded: bool
    runs: tuple[RunResult, ...]
    trials: tuple[str, ...]  #: number of each run, with its file if there are several
    reasons: tuple[str, ...]  #: one for each run

    @property
    def count(self) -> int:
        """How many runs have it."""
        return len(self.runs)


def flagged_rows(result: CampaignResult) -> tuple[FlaggedRow, ...]:
    """Return every reason that a run was flagged for: excluding ones first, the most frequent."""
    found: dict[tuple[str, Severity], list[tuple[RunResult, Flag]]] = {}
    for run in result.runs:
        for flag in run.flags:
            found.setdefault((flag.code, flag.severity), []).append((run, flag))
    rows = [
        FlaggedRow(
            code,
            severity is Severity.EXCLUDED,
            tuple(run for run, _ in of_code),
            tuple(trial_of(run, result) for run, _ in of_code),
            tuple(flag.reason for _, flag in of_code),
        )
        for (code, severity), of_code in found.items()
    ]
    return tuple(sorted(rows, key=lambda row: (not row.excluded, -row.count, row.code)))


@dataclass(frozen=True)
class RunRow:
    """One run: its settings, the results of both methods, and the reasons to doubt it."""

    label: str
    trial: str
    load: str
    torque: str
    regime: str
    paper: str  #: only a friction coefficient if the wheel slid
    slip: str
    slip_corrected: str
    better: str
    demand: str
    overshoot: str  #: at the stop, in mm
    final_travel: str  #: of the platform, in mm
    excluded: bool
    flags: tuple[str, ...]


def run_rows(name: str, result: CampaignResult) -> tuple[RunRow, ...]:
    """Return a row for each run of the set ``name``, in their order."""
    return tuple(
        RunRow(
            label=run.run.label,
            trial=trial_of(run, result),
            load=quantity(run.run.load_n, 1),
            torque=quantity(run.paper.torque_nm, 3),
            regime=NONE if run.paper.regime is None else run.paper.regime.value,
            paper=quantity(run.paper.mu, PLACES),
            slip=quantity(run.paper.slip, 3),
            slip_corrected=quantity(run.better.slip_corrected, 3),
            better=_with_u(run.better.mu, run.better.mu_u),
            demand=quantity(run.better.demand, PLACES),
            overshoot=quantity(1e3 * run.run.run_on.overshoot_m, 1),
            final_travel=quantity(1e3 * run.run.run_on.final_travel_m, 0),
            excluded=run.excluded,
            flags=tuple(flag.reason for flag in run.flags),
        )
        for run in result.runs
        if run.run.set_name == name
    )


def _with_u(value: float, u: float) -> str:
    if not np.isfinite(value):
        return NONE
    if not np.isfinite(u):
        return number(value, PLACES)
    places = places_for(2.0 * u) or PLACES
    return f"{number(value, places)} ± {number(2.0 * u, places)}"
