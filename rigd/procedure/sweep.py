"""Reads the points of a sweep in the written order, and computes the order in which they play."""

from __future__ import annotations

import math
import random
import re
from collections.abc import Sequence
from itertools import pairwise, product
from typing import Final

from rigd.config.document import KeyPath
from rigd.config.problems import suggest
from rigd.config.source import Source
from rigd.language.number import Number
from rigd.language.tokens import NAME
from rigd.model.errors import ConfigError, Place
from rigd.model.units import dimension_text, parse_unit
from rigd.procedure.expression import Scope, Value
from rigd.procedure.parameters import Parameter, Parameters
from rigd.procedure.reader import Reader
from rigd.procedure.source import MoveSource, ProcedureSource, RangeSource

#: Most trials of a run: a day and a night of trials of 5 s each.
MAX_TRIALS: Final = 20_000
#: Most that is compiled for all trials of a run, as :func:`_trial_size` counts it: twenty for each
#: of the most trials. To compile it takes 8 s of CPU.
MAX_SIZE: Final = 400_000
#: Letters of a text that count as one more value: a condition with its threshold has as many.
_LETTERS: Final = 16
#: Part of a step by which the end of a range may differ: decimal fractions are not exact in binary.
_ROUNDING: Final = 1e-6
#: The two values that YAML makes of ``0,5 A`` in a list.
_WHOLE: Final = re.compile(r"\s*[+-]?\d+\s*")
_DIGITS: Final = re.compile(r"\s*\d+\s*[^\W\d_]")


class TooLong(ConfigError):
    """All trials together have more steps and values, ``size``, than may be compiled."""

    def __init__(self, message: str, size: int, *, place: Place, hint: str) -> None:
        super().__init__(message, place=place, hint=hint)
        self.size = size


def read_points(
    reader: Reader, source: ProcedureSource, parameters: Parameters, most: int = MAX_SIZE
) -> list[dict[str, Value]]:
    """Return the points of the sweep as written; one empty point without a sweep.

    The first parameter of the grid changes slowest, the rows of ``zip`` fastest. An override
    (``--set``) of a parameter of the grid leaves that single value, overrides of all parameters of
    ``zip`` leave that single row. Problems are noted.

    Raises:
        TooLong: all trials together have more than ``most`` steps and values.
    """
    sweep = source.sweep
    grid = {
        name: _axis(reader, ("sweep", "grid", name), name, axis, parameters)
        for name, axis in sweep.grid.items()
    }
    rows = {
        name: _axis(reader, ("sweep", "zip", name), name, axis, parameters)
        for name, axis in sweep.zip.items()
    }
    for name in rows:
        if name in grid:
            reader.note_key(("sweep", "zip", name), f"{name} is also in grid", "remove one")
    given = [name for name in rows if name in parameters.overrides]
    others = [name for name in rows if name not in given]
    if given and others:
        for name in given:
            reader.problems.add(
                None,
                f"--set {name}: the sweep takes {name} row by row from 'zip', with "
                f"{', '.join(others)}",
                f"set {', '.join(others)} too, for a single row, or change the sweep in a copy of "
                "the file",
            )
        return []
    lengths = {name: len(values) for name, values in rows.items()}
    if len(set(lengths.values())) > 1:
        shown = ", ".join(f"{name}: {length}" for name, length in lengths.items())
        reader.note_key(("sweep", "zip"), f"the lists of zip differ in length ({shown})",
                        "give each list one value per row")  # fmt: skip
        return []
    _check_order(reader, source)
    row_count = next(iter(lengths.values()), 1)
    total = math.prod(len(values) for values in grid.values()) * row_count * source.repeats
    if total > MAX_TRIALS:
        reader.note_key(("sweep",), f"{total} trials are more than {MAX_TRIALS}",
                        "split the procedure")  # fmt: skip
        return []
    size = _trial_size(source, reader.swept)
    if total * size > most:
        most = MAX_SIZE if total * size > MAX_SIZE else most
        raise TooLong(
            f"{total} trials of {size} steps and values are {total * size}, more than {most}",
            total * size,
            place=reader.document.key_place(("trial", "steps")),
            hint="split the procedure, or shorten the steps that name a swept parameter",
        )
    zipped = [dict(zip(rows, row, strict=True)) for row in zip(*rows.values(), strict=True)]
    return [
        {**dict(zip(grid, values, strict=True)), **row}
        for values in product(*grid.values())
        for row in (zipped or [{}])
    ]


def play_order(count: int, source: ProcedureSource) -> list[int]:
    """Return the indices of ``count`` trials in the order of play."""
    order = list(range(count))
    if source.sweep.order == "random" and source.sweep.seed is not None:
        random.Random(source.sweep.seed).shuffle(order)
    return order


def _trial_size(source: ProcedureSource, swept: frozenset[str]) -> int:
    """Return how many steps and values are compiled for each trial.

    A step that names no swept parameter is compiled once for all trials, and counts as one.
    """
    size = _values(source.tables) + _values(source.trial.limits)
    for step in (*source.trial.steps, *source.trial.after):
        once = isinstance(step, MoveSource) and swept.isdisjoint(NAME.findall(repr(step)))
        size += 1 + _values(step.when) if once else _values(step)
    return size


def _values(item: object) -> int:
    """Return how many names and values ``item`` has; a long text counts as several."""
    if isinstance(item, str):
        return 1 + len(item) // _LETTERS
    if isinstance(item, Source):
        return sum(_values(getattr(item, key)) for key in item.model_fields_set)
    if isinstance(item, dict):
        return len(item) + sum(map(_values, item.values()))
    return sum(map(_values, item)) if isinstance(item, list) else 0


def _check_order(reader: Reader, source: ProcedureSource) -> None:
    sweep = source.sweep
    if sweep.order == "random" and sweep.seed is None:
        reader.note(("sweep", "order"), "a random order needs a seed",
                    "add 'seed: 1', so that the order is repeatable")  # fmt: skip
    if sweep.order == "given" and sweep.seed is not None:
        reader.note_key(("sweep", "seed"), "the seed has no effect in the order given",
                        "add 'order: random', or remove it")  # fmt: skip


def _axis(
    reader: Reader,
    path: KeyPath,
    name: str,
    axis: Sequence[str] | RangeSource,
    parameters: Parameters,
) -> list[Value]:
    parameter = parameters.known.get(name)
    if parameter is None:
        reader.note_key(path, f"the procedure has no parameter {name!r}",
                        suggest(name, parameters.known))  # fmt: skip
        return []
    if name in parameters.overrides:
        return [parameters.overrides[name]]
    if isinstance(axis, RangeSource):
        values = _range(reader, path, axis, parameter, parameters.scope)
    else:
        commas = _decimal_commas(axis, parameter)
        for index in commas:
            whole, rest = axis[index].strip(), axis[index + 1].strip()
            reader.note((*path, index), f"{whole},{rest} are two values here",
                        f"use a decimal point: {whole}.{rest}")  # fmt: skip
        split = {*commas, *(index + 1 for index in commas)}
        values = [
            value
            for index, text in enumerate(axis)
            if index not in split
            and (value := _read_value(reader, (*path, index), text, parameter, parameters.scope))
            is not None
        ]
    return values


def _decimal_commas(axis: Sequence[str], parameter: Parameter) -> list[int]:
    """Return where a whole number without its unit stands before digits with one: 0,5 A."""
    if parameter.choices or parameter.unit == "1":
        return []
    return [
        index
        for index, (whole, rest) in enumerate(pairwise(axis))
        if _WHOLE.fullmatch(whole) and _DIGITS.match(rest)
    ]


def _read_value(
    reader: Reader, path: KeyPath, text: str, parameter: Parameter, scope: Scope
) -> Value | None:
    read = reader.word if parameter.choices else reader.value
    value = read(path, text, scope)
    if value is None:
        return None
    refusal = parameter.refuse(value)
    if refusal is not None:
        reader.note(path, *refusal)
        return None
    return parameter.taken(value)


def _range(
    reader: Reader, path: KeyPath, axis: RangeSource, parameter: Parameter, scope: Scope
) -> list[Value]:
    start = _read_value(reader, (*path, "from"), axis.start, parameter, scope)
    end = _read_value(reader, (*path, "to"), axis.to, parameter, scope)
    step = reader.value((*path, "step"), axis.step, scope)
    if not (isinstance(start, Number) and isinstance(end, Number) and isinstance(step, Number)):
        if parameter.choices:
            reader.note(path, f"{parameter.name} is a word: it cannot have a range", "give a list")
        elif isinstance(step, str):
            reader.note((*path, "step"), f"{step!r} is a word, expected a quantity")
        return []
    if step.dimension != start.dimension:
        reader.note((*path, "step"), f"the step is in {dimension_text(step.dimension)}, "
                    f"expected {parameter.unit}",
                    f"such as '0.1 {parse_unit(parameter.unit).difference()}'")  # fmt: skip
        return []
    if step.unit:
        message = f"a step of {axis.step} is no difference: {step.unit} has a zero of its own"
        reader.note((*path, "step"), message, f"such as '1 {parse_unit(step.unit).difference()}'")
        return []
    span = end.value - start.value
    if step.value == 0 or span / step.value < 0:
        reader.note((*path, "step"), f"a step of {axis.step} never leads from {axis.start} "
                    f"to {axis.to}", "check its sign")  # fmt: skip
        return []
    count = span / step.value
    if math.isnan(count):  # the problem of this value is noted already
        return []
    if count > MAX_TRIALS:
        reader.note((*path, "step"), f"{count:.3g} values are more than {MAX_TRIALS}",
                    "use a larger step")  # fmt: skip
        return []
    steps = round(count)
    if abs(count - steps) > _ROUNDING:
        reader.note((*path, "to"), f"{axis.to} is {count:.6g} steps from {axis.start}",
                    "end on a whole number of steps")  # fmt: skip
        return []
    # Twelve digits: 0.15 A + 2 x 0.15 A is 0.45 A, not 0.44999999999999996 A.
    values: list[Value] = [
        Number(float(f"{start.value + index * step.value:.12g}"), start.dimension, start.unit)
        for index in range(steps)
    ]
    return [*values, end]  # as written: rounded it may be beyond a limit
