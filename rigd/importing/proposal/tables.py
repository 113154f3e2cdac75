"""Finds the tables of a file, each with its clock and its channels, as sources of a map."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

import numpy as np

from rigd.importing.proposal.columns import SAMPLE_ROWS, SeenColumn, name_of, of_table, of_text
from rigd.importing.proposal.dialect import sniff
from rigd.importing.proposal.lines import MapLine, comment, quoted
from rigd.importing.proposal.times import ProposedTimes, find_clock, is_time
from rigd.importing.source import TextTableSource
from rigd.importing.tables.formats import format_of, groups_in, open_table
from rigd.importing.tables.table import SourceTable
from rigd.model.errors import ConfigError, Place

#: Channels of a source; a map with more than some 5,000 is too long to be read.
MOST_CHANNELS: Final = 500
_TRIAL: Final = re.compile(
    r"(trial|test|run|repeat|repetition|cycle|stroke|experiment|versuch)(_?(no|nr|number|id))?"
)
_STEP: Final = re.compile(r"(step|phase|state|segment)(_?name)?")
#: A column that changes in more of the rows shows no trials.
_MOST_CHANGES: Final = 0.2
_NAMED: Final = 8
_TIME: Final = "(time)"


@dataclass
class ProposedSource:
    """A table that becomes a source: the lines of its blocks, and what is left out.

    ``trials`` are the columns that show them, ``steps`` the one with the names of steps.
    """

    path: Path
    group: str | None
    names: tuple[str, ...]
    clock: ProposedTimes
    text: list[MapLine] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    channels: dict[str, str] = field(default_factory=dict)  #: name to the rest of its line
    asked: dict[str, str] = field(default_factory=dict)  #: the same with what is to be filled in
    trials: list[str] = field(default_factory=list)
    steps: str | None = None
    missing: list[str] = field(default_factory=list)


def tables_in(path: Path) -> list[ProposedSource]:
    """Return the tables of a file that can be sources.

    Raises:
        ConfigError: the file cannot be read, is of an unknown format, or has no samples.
    """
    if not path.is_file():
        raise ConfigError(f"there is no file {path}")
    if path.stat().st_size == 0:
        raise ConfigError("the file is empty", place=Place(str(path), 1, 1))
    found: list[ProposedSource] = []
    if format_of(path) == "csv":
        dialect = sniff(path)
        table = open_table(path, None, TextTableSource.model_validate(dialect.options))
        columns = of_text(table, dialect)
        only = _source(path, None, table, columns)
        asked, why = dialect.asked
        only.text = [
            MapLine(key, quoted(str(value)), why if key == asked else "", asks=key == asked)
            for key, value in dialect.options.items()
        ]
        only.notes = [*dialect.notes, *only.notes]
        found = [only]
    else:
        for group in groups_in(path):
            table = open_table(path, None, TextTableSource(), group)
            columns = list(of_table(table))
            parts = [_source(path, group, table, part) for part in _clusters(table, columns)]
            found += parts
    found = [item for item in found if item.channels]
    timed = [item for item in found if item.clock.column is not None]
    if not found:
        raise ConfigError(f"{path} has no columns of numbers")
    left = [item for item in found if timed and item.clock.column is None]
    kept = timed or found[:1]
    for item in left:
        where = f" of {item.group}" if item.group else ""
        kept[0].notes.append(f"left out{where}, for want of times: {_listed(list(item.channels))}")
    return kept


def _clusters(table: SourceTable, columns: Sequence[SeenColumn]) -> Iterator[list[SeenColumn]]:
    """Yield the columns that have the same times: those of the same group, or length, or clock."""
    time = next((item for item in columns if item.name == _TIME), None)
    parts: dict[object, list[SeenColumn]] = {}
    for column in columns:
        if column is time:
            continue
        parent = column.name.rpartition("/")[0] if column.rows else ""
        key: object = (parent, column.rows)
        if time is not None:
            batch = next(table.batches({column.index: "text", time.index: "number"}))
            times = batch.numbers[time.index][:SAMPLE_ROWS]
            key = (column.rows, *times[:2].tolist())
            parts.setdefault(key, [replace(time, values=np.array(times))])
        parts.setdefault(key, []).append(column)
    if time is None:
        _lend_times(parts)
    yield from parts.values()


def _lend_times(parts: dict[object, list[SeenColumn]]) -> None:
    """Join groups without times with one around them, of the same length, which has some."""
    for key, own in list(parts.items()):
        if any(is_time(item) for item in own):
            continue
        for other in list(parts.values()):
            if other is not own and other[0].rows == own[0].rows and any(map(is_time, other)):
                other += own
                del parts[key]
                break


def _source(
    path: Path, group: str | None, table: SourceTable, columns: Sequence[SeenColumn]
) -> ProposedSource:
    names = list(table.names)
    clock = find_clock(columns, names)
    clock.dated = clock.dated or table.start_ns is not None
    found = ProposedSource(path, group, tuple(names), clock)
    words, others = [], 0
    rest = [item for item in columns if item is not clock.column]
    for column in rest:
        plain = column.bare.lower().replace(" ", "_")
        if _TRIAL.fullmatch(plain) and _is_in_runs(column):
            found.trials.append(column.written(names))
        elif _STEP.fullmatch(plain) and column.values is None and column.texts:
            found.steps = column.written(names)
        elif column.values is None or column.moment:
            such = f", such as {column.texts[0]}" if column.texts else ""
            words.append(f"{column.name}{such}")
        elif len(found.channels) >= MOST_CHANNELS:
            others += 1
        elif not np.all(np.isnan(np.asarray(column.values, np.float64))):
            _add_channel(found, column, names)
    used = [item for item in columns if item.values is not None]
    found.missing = sorted({text for item in used for text in item.missing})
    if words:
        found.notes.append(
            f"left out, no numbers: {_listed(words)}; one that is the same in all rows of a trial "
            "may be a parameter"
        )
    if others:
        found.notes.append(f"left out: {others} more columns, of {len(rest)}")
    if found.trials and _begins_again(clock, [c for c in rest if c.written(names) in found.trials]):
        clock.lines.append(MapLine("restarts", "true", "the times begin again with each trial"))
    return found


def _add_channel(found: ProposedSource, column: SeenColumn, names: list[str]) -> None:
    name = name_of(column.bare, found.channels)
    key = f"column: {quoted(column.written(names))}"
    values = np.asarray(column.values, np.float64)
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    span = f"{low:.4g} in all rows seen" if low == high else f"from {low:.4g} to {high:.4g}"
    if column.unit is not None:
        note = f"{span} {column.stated}"
        found.channels[name] = found.asked[name] = f"{{{key}}}{comment(note)}"
        return
    why = "the file states no unit, write 1 for none"
    if column.stated:
        why = f"the file states the unit {column.stated!r}, which rigd does not know"
    found.channels[name] = f'{{{key}, unit: "1"}}'
    found.asked[name] = f'{{{key}, unit: "?"}}{comment(f"to fill in: {why}; {span}")}'


def _is_in_runs(column: SeenColumn) -> bool:
    """Return whether a column changes seldom, as a number of the trial does."""
    values = np.asarray(column.values if column.values is not None else column.texts)
    if values.dtype.kind == "f" and np.any(values != np.rint(values)):
        return False
    changes = np.count_nonzero(values[1:] != values[:-1])
    return bool(changes <= _MOST_CHANGES * len(values))


def _begins_again(clock: ProposedTimes, trials: Sequence[SeenColumn]) -> bool:
    if clock.column is None or clock.column.values is None:
        return False
    back = np.flatnonzero(np.diff(clock.column.values) < 0)
    changes = np.zeros(len(clock.column.values) - 1, np.bool_)
    for column in trials:
        values = np.asarray(column.values if column.values is not None else column.texts)
        changes |= values[1:] != values[:-1]
    return bool(len(back)) and bool(np.all(changes[back]))


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return ", ".join(names[:_NAMED]) + more
