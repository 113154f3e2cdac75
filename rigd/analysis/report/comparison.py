"""Builds the first page of a report, which compares all groups of trials, such as floors.

The page has one table with the parameters of all groups, and common figures.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rigd.analysis.report.layout import Panel, featured, panels
from rigd.analysis.report.plots.axes import words
from rigd.analysis.report.plots.curve import curves
from rigd.analysis.report.plots.trial import DASHES, fits_side_by_side, signal_overlay
from rigd.analysis.report.section import ReportSection
from rigd.analysis.report.svg import Drawing, draw
from rigd.analysis.report.tables.summary import KNOWN_FIRST, SummaryRow, summary_rows
from rigd.analysis.result import TrialFit

Chosen = list[tuple[int, ReportSection, TrialFit]]


@dataclass(frozen=True)
class ComparisonLine:
    """One parameter over all sections; None if a section does not have it."""

    symbol: str
    name: str
    unit: str
    meaning: str
    cells: tuple[SummaryRow | None, ...]


@dataclass(frozen=True)
class GroupComparison:
    """The table of all parameters, and the figures that overlay all groups."""

    labels: tuple[str, ...]
    references: tuple[str, ...]
    lines: tuple[ComparisonLine, ...]
    curves: tuple[Drawing, ...]
    signals: tuple[Drawing, ...]
    fits: tuple[Drawing, ...]


def comparison(sections: Sequence[ReportSection]) -> GroupComparison:
    """Return what all ``sections`` have in common.

    Signals and fits of a single group stand in its own chapter only.
    """
    chosen = [(i, s, featured(s.result.trials)) for i, s in enumerate(sections) if s.result.trials]
    return GroupComparison(
        labels=tuple(section.label for section in sections),
        references=tuple(
            dict.fromkeys(section.reference_label for section in sections if section.reference)
        ),
        lines=_lines(sections),
        curves=_curves(sections),
        signals=_signals(chosen) if len(chosen) > 1 else (),
        fits=_fits(chosen) if len(chosen) > 1 else (),
    )


def _lines(sections: Sequence[ReportSection]) -> tuple[ComparisonLine, ...]:
    tables = [{row.name: row for row in summary_rows([section])} for section in sections]
    names = dict.fromkeys(name for table in tables for name in table)
    lines = []
    for name in names:
        cells = tuple(table.get(name) for table in tables)
        first = next(cell for cell in cells if cell is not None)
        lines.append(ComparisonLine(first.symbol, name, first.unit, first.meaning, cells))
    return tuple(sorted(lines, key=_unknown))


def _unknown(line: ComparisonLine) -> int:
    """Return how little is known of a parameter over all groups: what is known leads the table."""
    last = len(KNOWN_FIRST)
    return sum(last if cell is None else KNOWN_FIRST.index(cell.verdict) for cell in line.cells)


def _curves(sections: Sequence[ReportSection]) -> tuple[Drawing, ...]:
    """Overlay the curves that share their axes; one figure for each kind."""
    kinds: dict[tuple[str, ...], list[int]] = {}
    for index, section in enumerate(sections):
        curve = section.result.curve
        if curve.x.size:
            kind = (curve.name, curve.x_name, curve.x_unit, curve.y_name, curve.y_unit)
            kinds.setdefault(kind, []).append(index)
    drawings = []
    for number, indices in enumerate(kinds.values(), start=1):
        members = [sections[i] for i in indices]
        curve = members[0].result.curve
        alt = (
            f"{words(curve.y_name)} over {words(curve.x_name)} with its band for "
            f"{', '.join(member.label for member in members)}."
        )
        caption = (
            "Drawn over the range that the data visited; beyond it the model extrapolates. "
            "A band that leaves the axis is wider than drawn."
        )
        if any(member.result.curve.seen for member in members):
            caption += (
                " Points: what was measured, less the other terms of the fit; the median of each "
                "range, with a bar over the middle half of its samples."
            )
        drawings.append(draw(curves(members, indices), f"curve-{number}", alt, caption))
    return tuple(drawings)


def _signals(chosen: Chosen) -> tuple[Drawing, ...]:
    """Overlay the signals of one trial of each group, an axis for each set they all have."""
    drawings = []
    trials = [(section, trial) for _, section, trial in chosen]
    colours = [index for index, _, _ in chosen]
    for index, panel in enumerate(_common_panels(chosen)):
        names = ", ".join(words(name) for name in panel.names)
        alt = f"At the highest setting of each group, over time: {names}."
        figure = signal_overlay(trials, colours, panel)
        drawings.append(draw(figure, f"overlay-{index}", alt, alt))
    return tuple(drawings)


def _fits(chosen: Chosen) -> tuple[Drawing, ...]:
    """Draw the fits of one trial of each group side by side, if they show the same output."""
    outputs = {(trial.output, trial.unit) for _, _, trial in chosen}
    if len(outputs) != 1:
        return ()
    alt = (
        f"Measured and fitted {words(chosen[0][2].output)} over time at the highest setting of "
        "each group; shaded samples did not enter the fit."
    )
    return (draw(fits_side_by_side([(s, t) for _, s, t in chosen]), "fits", alt, alt),)


def _common_panels(chosen: Chosen) -> list[Panel]:
    """Return the panels that every group has, each with the same signals, a dash for each."""
    all_panels = [panels(section.result.trials) for _, section, _ in chosen]
    return [
        panel
        for panel in all_panels[0]
        if len(panel.names) <= len(DASHES)
        and all(panel in others for others in all_panels)
        and all(name in trial.signals for name in panel.names for _, _, trial in chosen)
    ]
