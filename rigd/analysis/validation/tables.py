"""Makes the tables of a validation as data, for a terminal and for the report page.

Small errors, such as those of speeds, have a thousandth of the unit: mm/s instead of m/s.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from rigd.analysis.report.rounding import FINER, number, places_for
from rigd.analysis.terminal import Column, TableRow, TerminalTable
from rigd.analysis.validation.result import (
    Deviation,
    GroupValidation,
    ValidatedTrial,
    Validation,
    pooled,
)

NONE: Final = "–"


@dataclass(frozen=True)
class PooledRow:
    """The errors of some trials together, as text; ``passes`` is true if all of them pass."""

    label: str
    condition: str
    trials: str
    cells: tuple[str, ...]
    passes: bool


def unit_of_errors(item: Deviation) -> str:
    """Return the unit that errors of this output are shown in."""
    return FINER.get(item.unit, item.unit)


def error(item: Deviation, value: float) -> str:
    """Return ``value``, an error in the unit of ``item``, to two digits."""
    shown = 1e3 * value if item.unit in FINER else value
    return number(shown, places_for(shown))


def published_error(item: Deviation) -> str:
    """Return the published value as it was printed; a dash if there is none."""
    if item.published is None:
        return NONE
    return number(1e3 * item.published if item.unit in FINER else item.published, digits=3)


def outputs(result: Validation) -> list[Deviation]:
    """Return one deviation of each output, for names and units."""
    first = next((trial for group in result.groups for trial in group.trials), None)
    return [] if first is None else list(first.deviations)


def pooled_rows(result: Validation) -> tuple[PooledRow, ...]:
    """Return the errors over each group, and over its trials by each condition they share.

    Cells: for each output its error; for a judged one also its limit and, if a constant was found
    to be otherwise, the error with all constants as stated.
    """
    rows = []
    for group in result.groups:
        rows.append(_pooled_row(group.label, "all", group.trials))
        for name in differing(group.trials)[:-1]:
            for value in dict.fromkeys(trial.conditions[name] for trial in group.trials):
                own = [trial for trial in group.trials if trial.conditions[name] == value]
                rows.append(_pooled_row("", own[0].described([name]), own))
    return tuple(rows)


def pooled_columns(result: Validation) -> tuple[str, ...]:
    """Return the titles of the cells of :func:`pooled_rows`."""
    titles: list[str] = []
    for item in outputs(result):
        unit = unit_of_errors(item)
        titles.append(f"{item.output} [{unit}]")
        if item.limit is not None:
            titles += ["as stated", "limit"]
    return tuple(titles)


def summary(result: Validation) -> TerminalTable:
    """Return the table of :func:`pooled_rows`."""
    columns = (
        Column(""), Column("trials"), Column("", right=True),
        *(Column(title, right=True) for title in pooled_columns(result)), Column(""),
    )  # fmt: skip
    rows = tuple(
        TableRow((row.label, row.condition, row.trials, *row.cells, "" if row.passes else "beyond"))
        for row in pooled_rows(result)
    )
    return TerminalTable(columns, rows, "measured less modelled, root mean square")


def overview(result: Validation) -> TerminalTable | None:
    """Return the errors of the most conclusive output of each trial, a column for each group.

    None without several trials in a group.
    """
    return _by_cell(result, result.judged[0], published=False)


def published_table(result: Validation) -> TerminalTable | None:
    """Return errors beside those of another author, None if no trial has any."""
    for item in outputs(result):
        if any(trial.deviation(item.output).published is not None for trial in _trials(result)):
            return _by_cell(result, item.output, published=True)
    return None


def _by_cell(result: Validation, output: str, *, published: bool) -> TerminalTable | None:
    groups = [group for group in result.groups if group.trials]
    if not any(len(group.trials) > 1 for group in groups):
        return None
    unit = unit_of_errors(groups[0].trials[0].deviation(output))
    columns = [Column("trial")]
    for group in groups:
        columns.append(Column(group.label, right=True))
        columns += [Column("published", right=True)] if published else []
    cells: dict[str, dict[int, list[Deviation]]] = {}
    for index, group in enumerate(groups):
        for trial in group.trials:
            own = cells.setdefault(_cell(group, trial), {}).setdefault(index, [])
            own.append(trial.deviation(output))
    rows = []
    for name, by_group in cells.items():
        texts = [name]
        for index in range(len(groups)):
            item = pooled(by_group[index]) if index in by_group else None
            texts.append(NONE if item is None else _marked(item))
            if published:
                texts.append(NONE if item is None else published_error(item))
        rows.append(TableRow(tuple(texts)))
    beside = f" and {result.published}" if published else ""
    title = f"{output} [{unit}]{beside}"
    return TerminalTable(tuple(columns), tuple(rows), title)


def _marked(item: Deviation) -> str:
    return error(item, item.rms) + ("" if item.passes else " *")


def _cell(group: GroupValidation, trial: ValidatedTrial) -> str:
    """Return what distinguishes ``trial`` in its group."""
    return trial.described(differing(group.trials))


def differing(trials: Sequence[ValidatedTrial]) -> list[str]:
    """Return the conditions in which ``trials`` differ, the one with the most values last."""
    values = {name: {trial.conditions[name] for trial in trials} for name in trials[0].conditions}
    return sorted((name for name in values if len(values[name]) > 1), key=lambda n: len(values[n]))


def _pooled_row(label: str, condition: str, trials: Sequence[ValidatedTrial]) -> PooledRow:
    cells: list[str] = []
    for own in trials[0].deviations:
        item = pooled([trial.deviation(own.output) for trial in trials])
        cells.append(error(item, item.rms))
        if own.limit is not None:
            limit = NONE if item.limit is None else error(item, item.limit)
            cells += [error(item, item.stated), limit]
    passes = all(trial.passes for trial in trials)
    return PooledRow(label, condition, str(len(trials)), tuple(cells), passes)


def _trials(result: Validation) -> Iterator[ValidatedTrial]:
    return (trial for group in result.groups for trial in group.trials)
