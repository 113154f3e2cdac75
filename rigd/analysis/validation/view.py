"""Builds the content of a validation report: verdicts, tables of errors, figures.

Importing this module imports matplotlib.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from rigd.analysis.report.svg import Drawing, draw
from rigd.analysis.terminal import TerminalTable
from rigd.analysis.validation import plots
from rigd.analysis.validation.result import (
    GroupValidation,
    ModelOutcome,
    ValidatedTrial,
    Validation,
)
from rigd.analysis.validation.tables import (
    PooledRow,
    differing,
    error,
    overview,
    pooled_columns,
    pooled_rows,
    published_table,
    unit_of_errors,
)

#: The class of the badge of an outcome, of those that the style sheet has.
BADGES: Final = {
    ModelOutcome.CONFIRMED: "identifiable",
    ModelOutcome.CORRECTED: "weak",
    ModelOutcome.UNTESTED: "weak",
    ModelOutcome.REJECTED: "unidentifiable",
}


@dataclass(frozen=True)
class TrialDrawing:
    """One trial at length: a line if it is closed on the page, a drawing if it is open."""

    label: str
    quality: str
    drawing: Drawing


@dataclass(frozen=True)
class GroupView:
    """One model on one recording."""

    anchor: str
    badge: str
    group: GroupValidation
    multiples: tuple[Drawing, ...]
    trials: tuple[TrialDrawing, ...]


@dataclass(frozen=True)
class ValidationView:
    """The whole report."""

    result: Validation
    columns: tuple[str, ...]
    rows: tuple[PooledRow, ...]
    tables: tuple[TerminalTable, ...]
    errors: Drawing | None
    groups: tuple[GroupView, ...]


def build_view(result: Validation) -> ValidationView:
    """Return the view of ``result``, for :func:`rigd.analysis.report.page.render`."""
    tables = (overview(result), published_table(result))
    return ValidationView(
        result,
        pooled_columns(result),
        pooled_rows(result),
        tuple(table for table in tables if table is not None),
        _errors(result),
        tuple(_group(f"g{k}", group, result) for k, group in enumerate(result.groups, start=1)),
    )


def _errors(result: Validation) -> Drawing | None:
    if sum(len(group.trials) for group in result.groups) < 2:
        return None
    alt = f"Error of {' and '.join(result.judged)} in each trial, with the most that is explained."
    caption = "Dashes: the most that noise, the model's uncertainty and the constants explain."
    if result.published:
        caption += f" Open circles: {result.published}."
    figure = plots.errors(result.groups, result.judged, result.published)
    return draw(figure, "errors", alt, caption)


def _group(anchor: str, group: GroupValidation, result: Validation) -> GroupView:
    multiples = []
    for output in result.judged if len(group.trials) > 1 else ():
        alt = f"Measured and modelled {output} over time in each of {len(group.trials)} trials."
        figure = plots.all_trials(group.trials, output)
        multiples.append(draw(figure, f"{anchor}-{output}", alt, alt))
    trials = [
        _trial(f"{anchor}-t{k}", trial, result)
        for k, trial in enumerate(_shown(group, result.judged[0]), start=1)
    ]
    return GroupView(anchor, BADGES[group.outcome], group, tuple(multiples), tuple(trials))


def _shown(group: GroupValidation, output: str) -> Sequence[ValidatedTrial]:
    """Return the trials to draw at length, those with the largest error over its limit.

    One for each value of the condition with the fewest values; if only one condition differs, one.
    """

    def excess(trial: ValidatedTrial) -> float:
        item = trial.deviation(output)
        return item.rms / item.limit if item.limit else item.rms

    splits = differing(group.trials)
    parts: dict[str, list[ValidatedTrial]] = {}
    for trial in group.trials:
        parts.setdefault(trial.conditions[splits[0]] if splits[1:] else "", []).append(trial)
    return sorted((max(part, key=excess) for part in parts.values()), key=excess, reverse=True)


def _trial(name: str, trial: ValidatedTrial, result: Validation) -> TrialDrawing:
    errors = ", ".join(
        f"{item.output} {error(item, item.rms)} {unit_of_errors(item)}" for item in trial.deviations
    )
    alt = (
        f"{trial.described()}: measured and modelled "
        f"{', '.join(trace.output for trace in trial.traces)} over time, and their differences; "
        f"RMS {errors}."
    )
    drawing = draw(plots.one_trial(trial), name, alt, "Dashed: the most that is explained.")
    return TrialDrawing(trial.described(), f"RMS {errors}", drawing)
