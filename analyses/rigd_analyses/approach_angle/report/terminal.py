"""Makes the text that the terminal shows for a campaign: result tables, warnings and bad runs.

A campaign is all runs that one analysis evaluates together. A set is the runs of a campaign that
share wheel and approach angle (between the wheel's rolling direction and the movement). The text
consists of

- Table 1 of the paper with our results beside the published ones: the largest friction coefficient
  of each set, by the paper's method and by the corrected one;
- the fits of the friction coefficient over the approach angle (the trend);
- the warnings;
- how many runs were left out, and the flagged runs, counted by reason;
- the calibrations that were used.

The paper is "Omni-wheel friction coefficient measuring methodology for various angles".
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from rigd.analysis.terminal import Column, TableRow, TerminalReport, TerminalTable
from rigd_analyses.approach_angle.raw.run_data import Coefficient
from rigd_analyses.approach_angle.report.tables import (
    NONE,
    FlaggedRow,
    SetRow,
    flagged_rows,
    set_rows,
    slip_rows,
    slip_voltages,
    stop_sentences,
    trend_rows,
    trend_sentence,
)
from rigd_analyses.approach_angle.result import CampaignResult

#: Runs of one reason that are named; the report names all.
NAMED: Final = 3
SLIP_LEGEND: Final = (
    "Corrected slip w R_eff/(V cos α) - 1, the mean over the loads ± its 95 % interval; r: the "
    "wheel rolled in all of these runs."
)


def campaign_terminal_report(result: CampaignResult, calibrations: Sequence[str]) -> TerminalReport:
    """Return tables and paragraphs on ``result``; ``calibrations`` names those used."""
    rows = set_rows(result)
    shown: list[TerminalTable | str] = [_table_1(rows), _legend(rows)]
    if result.trends:
        shown.append(_trends(result))
        shown.append(trend_sentence(result))
    if result.slips:
        shown += [_slips(result), SLIP_LEGEND]
    if stops := stop_sentences(result):
        shown.append("\n".join(stops))
    if result.warnings:
        shown.append("\n".join(["warnings:", *(f"  {warning}" for warning in result.warnings)]))
    shown.append(_flagged(result))
    if calibrations:
        shown.append("\n".join(calibrations))
    return tuple(shown)


def _table_1(rows: Sequence[SetRow]) -> TerminalTable:
    columns = (
        Column("set"),
        Column("published", right=True),
        Column("paper's ± U", right=True),
        Column("(runs)"),
        Column("corrected ± U (k=2)", right=True),
        Column("coefficient"),
        Column("usable ± U", right=True),
    )
    return TerminalTable(
        columns,
        tuple(
            TableRow(
                (
                    row.name,
                    row.published,
                    row.paper + (f" ({row.paper_regime})" if row.paper_regime else ""),
                    row.counts,
                    row.maximum,
                    row.coefficient,
                    row.usable,
                ),
                faint=row.paper == NONE and row.maximum == NONE,
            )
            for row in rows
        ),
    )


def _legend(rows: Sequence[SetRow]) -> str:
    lines = [
        f"{Coefficient.ROLLING.value}: F_r/N, of the published values, the paper's method and the "
        f"corrected one alike. {Coefficient.USABLE.value}: what is left of it along the travel, "
        "once the drag of the free rollers is taken off."
    ]
    if any(row.paper_regime for row in rows):
        lines.append(
            "(mixed), (rolling): what the wheel did in the run of the paper's maximum; not a limit "
            "of friction."
        )
    return "\n".join(lines)


def _trends(result: CampaignResult) -> TerminalTable:
    columns = (
        Column("over the angle"),
        Column("slope ± u per degree", right=True),
        Column("95 % interval", right=True),
        Column("intercept", right=True),
        Column("r²", right=True),
        Column("rms", right=True),
        Column("rms of demand form", right=True),
    )
    return TerminalTable(
        columns,
        tuple(
            TableRow(
                (
                    row.source,
                    row.slope,
                    row.slope_interval,
                    row.intercept,
                    row.r_squared,
                    row.rms,
                    row.demand_rms,
                )
            )
            for row in trend_rows(result)
        ),
    )


def _slips(result: CampaignResult) -> TerminalTable:
    voltages = (Column(f"{volts:g} V", right=True) for volts in slip_voltages(result))
    rows = tuple(TableRow((row.label, *row.cells)) for row in slip_rows(result))
    return TerminalTable((Column("slip over the angle"), *voltages), rows)


def _flagged(result: CampaignResult) -> str:
    """Return the flagged runs counted by reason, the first few of each named."""
    excluded = sum(run.excluded for run in result.runs)
    head = f"{len(result.runs)} runs, {excluded or 'none'} of them left out"
    rows = flagged_rows(result)
    return "\n".join(
        [f"{head}{'; flagged:' if rows else ''}", *(f"  {_reason(row)}" for row in rows)]
    )


def _reason(row: FlaggedRow) -> str:
    """Return a reason with its first run at length and the next few by name."""
    named = zip(row.trials[:NAMED], row.runs, strict=False)
    names = [f"trial {trial} ({run.run.label})" for trial, run in named]
    others = f"; also {', '.join(names[1:])}" if len(names) > 1 else ""
    more = f" and {row.count - NAMED} more" if row.count > NAMED else ""
    used = "" if row.excluded else ", used"
    return (
        f"{row.code} ({row.count}{used}): {names[0]}: {row.reasons[0].rstrip('.')}{others}{more}."
    )
