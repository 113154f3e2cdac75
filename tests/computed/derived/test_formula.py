"""Formulas as written: their units, and what is wrong with them at which character."""

from __future__ import annotations

import math

import pytest

from rigd.computed.derived.formula import read_formula
from rigd.computed.derived.graph import Builder
from rigd.language.dimensions import plain
from rigd.language.number import ExpressionError, Number
from rigd.model.units import dimension_text, parse_unit

UNITS = {
    "load.force": "N", "pull.force": "N", "wheel.angle": "rad", "wheel.speed": "rad/s",
    "cart.speed": "m/s", "cart.position": "m", "card.input": "V", "drive.torque": "N m",
    "s.m": "m", "oven.t": "K", "room.t": "K",
}  # fmt: skip


def read(text: str) -> Number:
    builder = Builder(1e-3)

    def find(name: str, offset: int) -> Number:
        if name not in UNITS:
            raise ExpressionError(f"unknown channel {name!r}", offset)
        return builder.input(name, parse_unit(UNITS[name]).dimension, frozenset({name}))

    return read_formula(text, builder, find)


@pytest.mark.parametrize(
    ("text", "unit"),
    [
        ("pull.force / load.force", "1"),
        ("wheel.speed * 0.03 m - cart.speed", "m/s"),
        ("derivative(wheel.angle)", "rad/s"),
        ("derivative(wheel.angle) * 30 mm > cart.speed", "1"),
        ("integral(pull.force * cart.speed)", "N m"),
        ("drive.torque * wheel.speed", "N m/s"),
        ("sqrt(cart.speed ** 2 + (2 m/s) ** 2)", "m/s"),
        ("sin(wheel.angle) + cos(2 rad) + tan(30 deg)", "1"),
        ("atan2(pull.force, load.force)", "rad"),
        ("lookup(card.input, [0 V, 5 V], [0 N, 100 N])", "N"),
        ("max(abs(load.force), 1 mN)", "N"),
        ("where(load.force > 5 N and not cart.speed > 1 m/s, pull.force, 0 N)", "N"),
        ("2 m / s.m", "1"),
        ("3 m/s * 2 s - cart.position", "m"),
        ("5 1/s + 3 Hz", "1/s"),
        ("ratelimit(load.force, 5 N/s)", "N"),
        ("mean(hold(pull.force, load.force > 1 N), 0.5 s)", "N"),
        ("edges(load.force > 5 N if_ )".replace(" if_ ", ""), "1"),
        ("1 N < load.force < 3 N or 50 % > 1", "1"),
        ("- 3 kg m/s^2 + +load.force", "N"),
    ],
)
def test_formula_has_unit(text: str, unit: str) -> None:
    assert dimension_text(plain(read(text).dimension)) == dimension_text(
        plain(parse_unit(unit).dimension)
    )


@pytest.mark.parametrize(
    ("text", "value"),
    [("2 * 3 mm", 6e-3), ("30 deg - 0.1 rad", math.pi / 6 - 0.1), ("-(4 m / 2 s) * 3", -6.0)],
)
def test_fixed_part_is_computed_once(text: str, value: float) -> None:
    assert read(text).value == pytest.approx(value)


@pytest.mark.parametrize(
    "text",
    [
        "oven.t - 20 degC > 2 K", "oven.t - 5 K > 20 degC", "oven.t - (oven.t - room.t) < 20 degC",
        "deadband(oven.t - 20 degC, 2 K)", "oven.t + 5 K > 20 degC",
        "oven.t - room.t + 20 degC > 5 degC", "20 degC + (oven.t - room.t) > 5 degC",
        "(card.input - 1 V) * (oven.t / 1 V) > 20 degC",
        "lookup(oven.t - room.t, [0 K, 9 K], [20 degC, 30 degC]) > 25 degC",
        "where(card.input - 1 V > 2 V, oven.t, 20 degC) > 5 degC",
    ],
)  # fmt: skip
def test_differences_and_values_of_temperature_are_told_apart(text: str) -> None:
    assert read(text).uses >= {"oven.t"}


@pytest.mark.parametrize(
    ("text", "token", "part"),
    [
        ("load.force + cart.speed", "cart", "cannot add m/s and N"),
        ("load.force - 5", "5", "give the number its unit, such as 'N'"),
        ("load.force > 3 m", "3", "cannot compare N with m"),
        ("wheel.angle + 0.3", "0.3", "cannot add a plain number and rad"),
        ("load.force + 3 furlong", "furlong", "unknown unit 'furlong'"),
        ("load.force * 0,5 N", ",5", "decimal point"),
        ("load.forse * 2", "load", "unknown channel 'load.forse'"),
        ("load * 2", "load", "unknown name 'load'"),
        ("deriv(load.force)", "deriv", "did you mean 'derivative'?"),
        ("derivative(load.force, 5 Hz)", "derivative", "takes 1 values, found 2"),
        ("lowpass(load.force, load.force)", "load.force)", "expected a fixed quantity"),
        ("lowpass(load.force, 5 s)", "5 s", "expected 1/s, found s"),
        ("lowpass(load.force, 400 Hz)", "400", "too fast for a cycle of 1000 Hz"),
        ("mean(load.force, 1 h)", "1 h", "too long"),
        ("sin(load.force)", "load", "expected an angle in rad"),
        ("sqrt(load.force)", "load", "no root with a unit"),
        ("where(load.force, 1, 2)", "load", "expected a condition"),
        ("abs(load.force > 1 N)", "load", "found a condition"),
        ("load.force == 5 N", "5", "compare with '<' or '>'"),
        ("load.force if cart.speed > 1 m/s else 0 N", "if", "where("),
        ("load.force ^ 2", "^", "write '**'"),
        ("load.force ** 0.5", "0.5", "whole number from 2 to 4"),
        ("[x: load.force]", ":", "cannot read"),
        ("[load.force]", "[", "cannot contain"),
        ("load.force in (1 N, 2 N)", "1", "compare with '<'"),
        ("load is stable", "load", "cannot contain"),
        ("load.force > 1 N for 2 s", "load", "cannot contain"),
        ("load.force > '5 N'", "'", "cannot contain"),
        ("load.force.real", "load", "unknown channel"),
        ("__import__('os').system('ls')", ".system", "cannot read"),
        ("lambda: 1", ":", "cannot read"),
        ("(load.force", "", "a ')' is missing"),
        ("load.force +", "", "a value is missing here"),
        ("${current} * 2", "$", "channels are written bare"),
        ("lookup(card.input, [0 V, 0 V], [1 N, 2 N])", "[0 V", "do not increase"),
        ("lookup(card.input, [0 V], [1 N])", "[0 V", "2 to 200"),
        ("load.force / 0", "0", "division by zero"),
        ("_q0 * 2", "_q0", "unknown name"),
        ("1_000 * load.force", "1_000", "write 1000"),
        ("2 * load.force - 1.5_0e3 N", "1.5_0", "write 1.50"),
        ("deadband(oven.t, 2 degC)", "2 degC", "write it in K"),
        ("oven.t + 5 degC", "5 degC", "cannot add a value in degC"),
        ("5 degC + oven.t", "5 degC", "cannot add a value in degC"),
        ("1e1_0 * load.force", "1e1_0", "write 1e10"),
        ("oven.t - 20 degC < 2 degC", "2 degC", "write 2 K if the difference is meant, 275.15 K"),
        ("2 degC > abs(mean(oven.t - room.t, 1 s))", "2 degC", "write 2 K"),
        ("where(load.force > 1 N, oven.t - room.t, 5 degC)", "5 degC", "write 5 K"),
        ("lookup(oven.t - room.t, [0 K, 10 degC], [0 N, 1 N])", "10 degC", "write 10 K"),
        ("2 * (oven.t - room.t) > 3 degC", "3 degC", "write 3 K"),
        ("(" * 30 + "load.force" + ")" * 30 + " * é", "é", "unknown name 'é'"),
        ("-" * 200 + "load.force", "", "nests deeper than 30"),
        ("load.force * " * 40 + "2", "", "an expression has at most 300"),
    ],
)
def test_wrong_formula_names_cause_and_place(text: str, token: str, part: str) -> None:
    with pytest.raises(ExpressionError) as caught:
        read(text)
    assert part in f"{caught.value} {caught.value.hint}"
    if token:
        assert caught.value.offset == text.index(token)
