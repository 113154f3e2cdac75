"""Reads the parameters of a procedure: default values, ``--set`` options and the sweep."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

from rigd.config.document import KeyPath
from rigd.config.problems import suggest
from rigd.language.dimensions import fits
from rigd.language.number import ExpressionError, Number, number_in
from rigd.model.limits import rounded_to
from rigd.model.units import dimension_text, format_quantity, meant_unit, parse_unit
from rigd.procedure.expression import Scope, Value, parse_expression
from rigd.procedure.reader import Reader
from rigd.procedure.source import ParameterSource, ProcedureSource


def choices_of(source: ProcedureSource) -> dict[str, tuple[str, ...]]:
    """Return the words that each parameter of ``source`` may take; none for a quantity."""
    return {name: tuple(item.choices or ()) for name, item in source.parameters.items()}


@dataclass(frozen=True)
class Parameter:
    """A parameter with its range; ``choices`` is empty for a quantity. Bounds are in SI."""

    name: str
    unit: str
    choices: tuple[str, ...]
    low: float
    high: float

    def taken(self, value: Value) -> Value:
        """Return ``value``, which is not refused; an arc over its radius as the angle it is.

        What rounding has brought beyond a bound is that bound.
        """
        if isinstance(value, str):
            return value
        if value.of_arc:
            value = number_in(value.value, parse_unit(self.unit))
        return replace(value, value=rounded_to(self.low, value.value, self.high))

    def refuse(self, value: Value) -> tuple[str, str] | None:
        """Return the reason why ``value`` is not allowed and the remedy, or None."""
        if isinstance(value, str):
            if not self.choices:
                return f"{value!r} is a word, expected a quantity in {self.unit}", "give a number"
            if value not in self.choices:
                return f"{value!r} is not a choice of {self.name}", suggest(value, self.choices)
            return None
        if self.choices:
            return f"{self.name} is a word", "one of " + ", ".join(self.choices)
        if not fits(value.dimension, parse_unit(self.unit).dimension, of_arc=value.of_arc):
            kind = dimension_text(value.dimension)
            given = f"{value.value:.6g} {kind}"
            if not any(value.dimension):
                given = f"{value.value:.6g}, {kind}"
            return f"{self.name} is given as {given}, expected {self.unit}", (
                f"such as '1 {self.unit}'" if self.unit != "1" else "give a plain number"
            )
        if value.is_difference and parse_unit(self.unit).offset:
            return (
                f"{self.name} is given as the difference of two values on a scale with a zero of "
                "its own",
                f"subtract a difference, such as '1 {parse_unit(self.unit).difference()}'",
            )
        exact = rounded_to(self.low, value.value, self.high)
        if exact < self.low or exact > self.high:
            side, bound = (
                ("below its min", self.low) if exact < self.low else ("above its max", self.high)
            )
            shown = format_quantity(value.value, self.unit)
            return (
                f"{self.name} {shown} is {side} {format_quantity(bound, self.unit)}",
                "change the value, or the range in 'parameters'",
            )
        return None


@dataclass(frozen=True)
class Parameters:
    """The parameters of a procedure, and their values for the whole run."""

    known: Mapping[str, Parameter]
    scope: Mapping[str, Value]
    units: Mapping[str, str]
    overrides: Mapping[str, Value]


def read_parameters(
    reader: Reader,
    source: ProcedureSource,
    swept: frozenset[str],
    overrides: Mapping[str, str],
    constants: Mapping[str, Value],
) -> Parameters:
    """Return the parameters of ``source``; problems are noted in ``reader``.

    ``constants`` are the rig's, with the names ``rig.NAME``.
    """
    known: dict[str, Parameter] = {}
    scope: dict[str, Value] = dict(constants)
    given: dict[str, Value] = {}
    for name in overrides:
        if name not in source.parameters:
            reader.problems.add(
                None, f"--set {name}: the procedure has no parameter {name!r}",
                suggest(name, source.parameters),
            )  # fmt: skip
    for name, item in source.parameters.items():
        parameter = _declare(reader, name, item, scope)
        known[name] = parameter
        if name in overrides:
            value = _override(reader, parameter, overrides[name], scope)
            given[name] = scope[name] = value
        elif item.default is not None:
            value = _default(reader, parameter, item.default, scope)
            if name not in swept:  # a default that the sweep replaces gives nothing its value
                scope[name] = value
        elif name not in swept:
            reader.note_key(
                ("parameters", name), f"{name} has no value",
                f"give it a default, sweep it, or run with --set {name}=...",
            )  # fmt: skip
            scope[name] = _unknown(parameter)
    units = {name: item.unit for name, item in known.items() if not item.choices}
    return Parameters(known, scope, units, given)


def read_tables(reader: Reader, source: ProcedureSource, scope: Scope) -> dict[str, Value]:
    """Return the value of each table under ``scope``; tables with a swept parameter are left out.

    Problems are noted in ``reader``.
    """
    values: dict[str, Value] = {}
    for name, table in source.tables.items():
        path: KeyPath = ("tables", name)
        parameter = source.parameters.get(table.by)
        if parameter is None or parameter.choices is None:
            with_choices = [key for key, item in source.parameters.items() if item.choices]
            reader.note((*path, "by"), f"{table.by!r} is not a parameter with choices",
                        suggest(table.by, with_choices))  # fmt: skip
            continue
        if name in source.parameters:
            reader.note_key(path, f"{name!r} is also a parameter", "rename one of the two")
        for choice in parameter.choices:
            if choice not in table.values:
                reader.note_key((*path, "values"), f"{choice!r} of {table.by} has no value",
                                f"add '{choice}: ...'")  # fmt: skip
        for choice in table.values:
            if choice not in parameter.choices:
                message = f"{choice!r} is not a choice of {table.by}"
                hint = suggest(choice, parameter.choices)
                reader.note_key((*path, "values", choice), message, hint)
        unit = None if table.unit is None else read_unit(reader, (*path, "unit"), table.unit)
        choice_now = scope.get(table.by)
        if isinstance(choice_now, str) and choice_now in table.values:
            where = (*path, "values", choice_now)
            value = _table_value(reader, where, table.values[choice_now], unit, scope)
            values[name] = Number(math.nan) if value is None else value
    return values


def _table_value(
    reader: Reader, path: KeyPath, text: str, unit: str | None, scope: Scope
) -> Value | None:
    if unit is not None:
        return number_in(reader.number(path, text, unit, scope), parse_unit(unit))
    if text[:1].isalpha():
        return text
    return reader.value(path, text, scope)


def read_unit(reader: Reader, path: KeyPath, text: str) -> str:
    """Return the unit ``text``, or with the problem noted the one that is meant, or 1."""
    try:
        parse_unit(text)
    except ValueError as error:
        reader.note(path, str(error), "such as A, m/s, N m")
        return meant_unit(text) or "1"
    return text


def _declare(reader: Reader, name: str, source: ParameterSource, scope: Scope) -> Parameter:
    path: KeyPath = ("parameters", name)
    unit = read_unit(reader, (*path, "unit"), source.unit or "1")
    low, high = -math.inf, math.inf
    for key in ("unit", "min", "max"):
        if source.choices is not None and getattr(source, key) is not None:
            reader.note_key(
                (*path, key), f"a word cannot have a {key}", "remove it, or the choices"
            )
    if source.choices is None and source.min is not None:
        low = reader.number((*path, "min"), source.min, unit, scope)
    if source.choices is None and source.max is not None:
        high = reader.number((*path, "max"), source.max, unit, scope)
    if low > high:
        reader.note((*path, "min"), f"min {source.min} is above max {source.max}", "swap the two")
    return Parameter(name, unit, tuple(source.choices or ()), low, high)


def _default(reader: Reader, parameter: Parameter, text: str, scope: Scope) -> Value:
    path = ("parameters", parameter.name, "default")
    if parameter.choices:
        value: Value | None = reader.word(path, text, scope)
    else:
        value = reader.value(path, text, scope)
    if value is None:
        return _unknown(parameter)
    refusal = parameter.refuse(value)
    if refusal is not None:
        reader.note(path, *refusal)
        return _unknown(parameter)
    return parameter.taken(value)


def _override(reader: Reader, parameter: Parameter, text: str, scope: Scope) -> Value:
    try:
        value: Value = text.strip() if parameter.choices else parse_expression(text).value(scope)
    except ExpressionError as error:
        reader.problems.add(None, f"--set {parameter.name}={text}: {error}", error.hint)
        return _unknown(parameter)
    refusal = parameter.refuse(value)
    if refusal is not None:
        reader.problems.add(None, f"--set {parameter.name}={text}: {refusal[0]}", refusal[1])
        return _unknown(parameter)
    return parameter.taken(value)


def _unknown(parameter: Parameter) -> Value:
    """Return a placeholder for a value whose problem is noted: it causes no other problem."""
    if parameter.choices:
        return parameter.choices[0]
    return Number(math.nan, parse_unit(parameter.unit).dimension)
