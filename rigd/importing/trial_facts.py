"""Makes trials of what was found in the samples: numbers, times, parameters, steps."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import dropwhile

from rigd.config.problems import suggest
from rigd.importing.map.files import SourceFiles
from rigd.importing.map.map import ImportMap, ParameterMap
from rigd.importing.reading import SourceReader, text_cells
from rigd.importing.tables.csv_table import CsvTable
from rigd.importing.tables.formats import open_table
from rigd.importing.tables.table import SourceTable, find_column, unit_of
from rigd.importing.trials import TrialSpan
from rigd.model.errors import ConfigError, Place
from rigd.model.units import Unit


@dataclass(frozen=True)
class FoundTrial:
    """One trial of an imported recording; ``problem`` is why it is not complete, or ""."""

    number: int
    repeat: int
    start_ns: int
    end_ns: int
    parameters: Mapping[str, float | str]
    units: Mapping[str, str]
    steps: Sequence[tuple[int, str]] = ()
    problem: str = ""


@dataclass(frozen=True)
class _Row:
    """Where the parameters of a trial stand: texts and positions of columns in a row of a table."""

    table: SourceTable
    columns: Mapping[str, int]
    number: int
    texts: Mapping[str, str]

    def place(self, name: str) -> Place:
        """Return the place of a parameter."""
        return self.table.place(self.columns[name], self.number)


def found_trials(
    what: ImportMap, test: SourceFiles, readers: Mapping[str, SourceReader]
) -> list[FoundTrial]:
    """Return the trials of a test whose samples have been read.

    Raises:
        ConfigError: there is none, a parameter is not known, or the time jumps within a trial.
    """
    shown = readers[what.trials.source]
    finder = shown.finder
    spans = [] if finder is None else finder.found()
    if not spans:
        raise ConfigError(
            f"no trial was found in {shown.table.path}",
            place=what.document.key_place(("trials",)),
        )
    if what.trials.is_whole_file:  # it lasts while all sources have samples
        spans[0].first_ns = max(reader.times.first_ns for reader in readers.values())
        spans[0].last_ns = min(reader.times.last_ns for reader in readers.values())
        if spans[0].first_ns > spans[0].last_ns:
            raise ConfigError(
                f"the sources of the test {test.name!r} have no time in common",
                place=what.document.key_place(("sources",)),
                hint="`since:` or `shift:` below `time:` puts the times of one to those of another",
            )
    windows = [(span.first_ns, span.last_ns) for span in spans]
    for reader in readers.values():
        reader.times.check_jumps(windows, what.trials)
    table = _table(what, test)
    decimal = what.trials.table_text.decimal if table else shown.source.text.decimal
    numbers = _numbers(spans)
    repeats: dict[tuple[object, ...], int] = {}
    found = []
    steps = [] if finder is None else finder.steps
    for number, span in zip(numbers, spans, strict=True):
        row = _Row(shown.table, finder.parameters if finder else {}, span.row, span.texts)
        if table:
            key = span.key[0].strip()
            if key not in table:
                raise ConfigError(
                    f"the table of the trials has no row {key!r}",
                    place=shown.table.place(finder.columns[0] if finder else 0, span.row),
                    hint=suggest(key, table),
                )
            row = table[key]
        parameters: dict[str, float | str] = {}
        units: dict[str, str] = {}
        for name, item in what.parameters.items():
            value, unit = _value(what, item, test, row, decimal)
            parameters[name] = value
            if unit is not None and unit.symbol != "1":
                units[name] = unit.symbol
        equal = tuple(parameters.values())
        repeats[equal] = repeats.get(equal, 0) + 1
        found.append(
            FoundTrial(
                number, repeats[equal], span.first_ns, span.last_ns + 1, parameters, units,
                _steps_in(steps, span),
                "the file begins or ends within it" if span.open else "",
            )
        )  # fmt: skip
    return found


def _numbers(spans: Sequence[TrialSpan]) -> list[int]:
    """Return the numbers of the trials: those of their column, if it has numbers, else 1 to n."""
    texts = [span.key[0].strip() for span in spans if len(span.key) == 1]
    if len(texts) == len(spans) and all(text.isdecimal() for text in texts):
        numbers = [int(text) for text in texts]
        if len(set(numbers)) == len(numbers) and max(numbers) < 2**31:
            return numbers
    return list(range(1, len(spans) + 1))


def _table(what: ImportMap, test: SourceFiles) -> dict[str, _Row]:
    """Return the rows of the table of the trials by their key; none without such a table."""
    trials = what.trials
    if trials.table is None:
        return {}
    place = what.document.place(("trials", "table", "file"))
    name = trials.table.filled(test.texts)
    if name is None:
        raise ConfigError(
            f"which file {trials.table.text} means is not known", place=place,
            hint=f"the names of the sources have {', '.join(test.texts) or 'no {name}'}",
        )  # fmt: skip
    path = test.root / name
    if not path.is_file():
        raise ConfigError(f"there is no table of the trials {path}", place=place)
    table = open_table(path, None, trials.table_text)
    key = find_column(table, trials.table_key, what.document.place(("trials", "table", "key")))
    columns = {"": key}
    for item in what.parameters.values():
        if item.column is not None:
            at = what.document.place(("parameters", item.name, "column"))
            columns[item.name] = index = find_column(table, item.column, at)
            if item.unit is not None:
                unit_of(table, index, item.unit, at)
    rows: dict[str, _Row] = {}
    for number, texts in enumerate(text_cells(table, columns)):
        name = texts.pop("").strip()
        first = rows.setdefault(name, _Row(table, columns, number, texts))
        if texts != first.texts:
            raise ConfigError(
                f"the table of the trials has a second row {name!r}, which differs",
                place=table.place(key, number),
                hint=f"the first is {table.place(key, first.number)}; correct its key, or remove "
                "one of the two",
            )
    return rows


def _value(
    what: ImportMap, item: ParameterMap, test: SourceFiles, row: _Row, decimal: str
) -> tuple[float | str, Unit | None]:
    """Return the value of a parameter in SI, or a word, and its unit."""
    if item.value is not None:
        return item.value, item.unit
    text = row.texts[item.name] if item.field is None else test.texts[item.field]
    if item.unit is None:
        return text.strip(), None
    plain, place = text.strip(), item.place
    if item.field is None:
        place = row.place(item.name)
        problem = row.table.wrong_decimal(plain) if isinstance(row.table, CsvTable) else None
        if problem:
            raise ConfigError(
                f"the parameter {item.name}: {problem[0]}", place=place, hint=problem[1]
            )
    if item.field is not None or decimal == ",":
        plain = plain.replace(",", ".")
    try:
        number = float(plain)
        if math.isfinite(number):
            return item.unit.to_si(number), item.unit
        raise ValueError
    except ValueError:
        source = "the files' names" if item.field is not None else f"column {item.column!r}"
        raise ConfigError(
            f"the parameter {item.name}: {text!r} in {source} is no number", place=place,
            hint="without `unit:` it is a word",
        ) from None  # fmt: skip


def _steps_in(steps: Sequence[tuple[int, str]], span: TrialSpan) -> list[tuple[int, str]]:
    """Return the steps in a trial, the first from its start on; "" ends the step before it."""
    before = [name for t_ns, name in steps if t_ns <= span.first_ns]
    found = [(span.first_ns, before[-1])] if before else []
    found += [(t_ns, name) for t_ns, name in steps if span.first_ns < t_ns <= span.last_ns]
    return list(dropwhile(lambda step: not step[1], found))
