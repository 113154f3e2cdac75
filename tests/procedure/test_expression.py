"""Expressions: arithmetic with units, and errors at the right character."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigd.config.document import parse_document
from rigd.config.problems import Problems
from rigd.language.number import ExpressionError, Number
from rigd.model import parse_unit
from rigd.procedure.expression import Value, parse_expression
from rigd.procedure.reader import Reader

SCOPE: dict[str, Value] = {
    "current": Number(2.0, parse_unit("A").dimension),
    "rig.radius": Number(0.05, parse_unit("m").dimension),
    "floor": "stone",
}


@pytest.mark.parametrize(
    ("text", "value", "unit"),
    [
        ("0.15 A", 0.15, "A"),
        ("15 deg", math.pi / 12, "rad"),
        ("0.5 * ${current} + 0.1 A", 1.1, "A"),
        ("-${current}", -2.0, "A"),
        ("--1 A", 1.0, "A"),
        ("-(1 A - ${current}) * 2", 2.0, "A"),
        ("2 m / ${rig.radius}", 40.0, "1"),
        ("2 m/s * 3 s", 6.0, "m"),
        ("600 mm - 4 cm", 0.56, "m"),
        ("1e3 1/m", 1000.0, "1/m"),
        ("3 N m/A", 3.0, "N m/A"),
        ("9.81 m/s²", 9.81, "m/s^2"),
        ("1 / 4", 0.25, "1"),
        ("10 - 4 - 3", 3.0, "1"),
        ("12 / 4 / 3", 1.0, "1"),
        ("1 + 2 * 3", 7.0, "1"),
        ("-2 ** 2", -4.0, "1"),
        ("sqrt(${current} ** 2 + (1.5 A) ** 2)", 2.5, "A"),
        ("max(${current}, 300 mA)", 2.0, "A"),
        ("where(${current} > 1 A and not 1 m > 2 m, 3 m, 4 m)", 3.0, "m"),
        ("lookup(${current}, [0 A, 4 A], [0 N, 10 N])", 5.0, "N"),
        ("|-3 N|", 3.0, "N"),
    ],
)
def test_expression_gives_value_and_dimension(text: str, value: float, unit: str) -> None:
    result = parse_expression(text).value(SCOPE)
    assert isinstance(result, Number)
    assert result.value == pytest.approx(value, rel=1e-12)
    assert result.dimension == parse_unit(unit).dimension


@pytest.mark.parametrize(
    ("text", "unit", "is_fit"),
    [
        ("${speed} / ${rig.radius}", "rad/s", True),
        ("2 * -${speed} / ${rig.radius}", "rpm", True),
        ("0.1 m / ${rig.radius}", "rad", True),
        ("${speed} / ${rig.radius}", "Hz", True),
        ("3 1/s", "rad/s", False),
        ("2 N / 1 N", "rad", False),
        ("3 rad/s * ${rig.radius}", "m/s", True),
        ("3 rad/s * ${rig.radius} + 1 m/s", "m/s", True),
        ("3 rad/s", "1/s", False),
    ],
)
def test_radian_beside_length_counts_as_one(text: str, unit: str, is_fit: bool) -> None:
    scope = {**SCOPE, "speed": Number(0.3, parse_unit("m/s").dimension)}
    problems = Problems()
    reader = Reader(parse_document("a: x\n", Path("p.yaml")), problems)
    value = reader.number(("a",), text, unit, scope)
    assert (problems.found == []) == is_fit
    assert math.isnan(value) != is_fit


@pytest.mark.parametrize(
    ("text", "is_difference"),
    [
        ("300 K - 20 degC", True),
        ("20 degC - 10 degC", True),
        ("0.5 * (20 degC - 10 degC)", True),
        ("-(20 degC - 10 degC) + 1 K", True),
        ("20 degC + 0.5 * (20 degC - 10 degC)", False),
        ("20 degC - 5 K", False),
        ("300 K + 5 K", False),
    ],
)
def test_difference_of_values_stays_a_difference(text: str, is_difference: bool) -> None:
    result = parse_expression(text).value(SCOPE)
    assert isinstance(result, Number)
    assert result.is_difference == is_difference


def test_reference_to_word_parameter_gives_word() -> None:
    assert parse_expression(" ${floor} ").value(SCOPE) == "stone"


def test_names_are_known_before_evaluation() -> None:
    assert parse_expression("${a} * (2 + ${rig.b})").names == {"a", "rig.b"}


@pytest.mark.parametrize(
    ("text", "offset", "part"),
    [
        ("", 0, "missing"),
        ("1 A +", 5, "missing"),
        ("current", 0, "found 'current'"),
        ("1 A + 1 m", 6, "cannot add m and A"),
        ("1 A - 2", 6, "cannot subtract a plain number and A"),
        ("2 * ${nothing}", 4, "unknown name '${nothing}'"),
        ("2 * ${floor}", 4, "is the word 'stone'"),
        ("1 / 0", 4, "division by zero"),
        ("1 / (1 A - 1 A)", 4, "division by zero"),
        ("(1 A", 4, "')' is missing"),
        ("1 A)", 3, "cannot read ')'"),
        ("1 Q", 2, "unknown unit 'Q'"),
        ("1e999 A", 0, "too large"),
        ("1e300 * 1e300", 0, "too large"),
        ("(" * 50, 31, "deeper than 30"),
        ("1" * 400, 0, "at most 300"),
        ("derivative(${current})", 11, "needs values over time"),
        ("mean(${current}, 1 s)", 5, "needs values over time"),
        ("sqrt(-1 m^2)", 5, "no number"),
        ("1 A > 0 A", 0, "found a condition"),
        ("2 * a.b", 4, "found 'a.b'"),
        ("${Current}", 0, "unknown name '${Current}'"),
    ],
)
def test_error_at_its_character(text: str, offset: int, part: str) -> None:
    with pytest.raises(ExpressionError) as caught:
        parse_expression(text).value(SCOPE)
    assert caught.value.offset == offset
    assert part in str(caught.value)


NUMBERS = st.floats(0.001, 1000).map(lambda x: float(f"{x:.4g}"))


@settings(derandomize=True, deadline=None)
@given(NUMBERS, NUMBERS, NUMBERS, st.sampled_from("+-*/"), st.sampled_from("+-*/"))
def test_precedence_is_that_of_python(a: float, b: float, c: float, op1: str, op2: str) -> None:
    text = f"{a!r} {op1} {b!r} {op2} {c!r}"
    result = parse_expression(text).value({})
    assert isinstance(result, Number)
    assert result.value == pytest.approx(eval(text), rel=1e-12)


@settings(derandomize=True, deadline=None)
@given(st.text("0123456789.eE+-*/() ${}abmAs^°µ", max_size=40))
def test_any_text_is_value_or_expression_error(text: str) -> None:
    try:
        parse_expression(text).value(SCOPE)
    except ExpressionError as error:
        assert 0 <= error.offset <= len(text)
