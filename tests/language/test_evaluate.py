"""Expressions drawn at random agree with Python's arithmetic and a table of powers."""

from __future__ import annotations

from random import Random

import pytest
from support.expression_draws import NAMES, UNITS, Drawn, Refused, draw, value_of

from rigd.computed.derived.formula import read_formula
from rigd.computed.derived.graph import Builder
from rigd.language.number import ExpressionError, Number
from rigd.language.syntax import MAX_LENGTH
from rigd.model.units import BASES, parse_unit
from rigd.procedure.expression import parse_expression

SCOPE = {name: Number(value, parse_unit(unit).dimension) for name, (value, unit) in NAMES.items()}
VALUES = {name: value for name, (value, _) in NAMES.items()}


def fixed(name: str, offset: int) -> Number:
    return SCOPE[name.removeprefix("a.")]


def channel(name: str, offset: int) -> Number:
    dimension = SCOPE[name.removeprefix("a.")].dimension
    return Number(float("nan"), dimension, row=0, uses=frozenset({name}))


def test_cases_cover_what_is_drawn() -> None:
    drawn = [draw(Random(seed), bare=True) for seed in range(500)]
    assert sum(item.powers is None for item in drawn) > 50
    assert {unit for unit in UNITS if any(unit in item.text for item in drawn)} == set(UNITS)


@pytest.mark.parametrize("bare", [False, True], ids=["procedure", "formula"])
def test_value_and_dimension_are_those_of_python(bare: bool) -> None:
    compared = 0
    for seed in range(2000):
        drawn = draw(Random(seed), bare=bare)
        if len(drawn.text) > MAX_LENGTH:
            continue
        found = number_of(drawn, bare)
        try:
            value = value_of(drawn, VALUES)
        except Refused:
            assert found is None, drawn.text
            continue
        assert found is not None, drawn.text
        assert found.value == pytest.approx(value, rel=1e-12, abs=1e-300), drawn.text
        assert drawn.powers is not None
        powers = tuple(drawn.powers.get(base, 0) for base in BASES)
        assert found.dimension == powers, drawn.text
        compared += 1
    assert compared > 500


def test_dimension_of_channels_is_that_of_fixed_values() -> None:
    for seed in range(2000):
        drawn = draw(Random(seed), bare=True)
        if drawn.powers is None or len(drawn.text) > MAX_LENGTH:
            continue
        try:
            found = read_formula(drawn.text, Builder(1e-3), channel)
        except ExpressionError as error:
            assert str(error) in ("division by zero", "the result is no number"), drawn.text
            continue
        powers = tuple(drawn.powers.get(base, 0) for base in BASES)
        assert found.dimension == powers, drawn.text


def number_of(drawn: Drawn, bare: bool) -> Number | None:
    """Return what rigd reads; None: it is refused."""
    try:
        if bare:
            return read_formula(drawn.text, Builder(1e-3), fixed)
        value = parse_expression(drawn.text).value(SCOPE)
    except ExpressionError as error:
        assert 0 <= error.offset <= len(drawn.text)
        return None
    assert isinstance(value, Number)
    return value
