"""Units: what a person writes becomes SI, and kinds are kept apart."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from typing import Any

import pint
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigd.model.units import (
    ATMOSPHERE_PA,
    BASES,
    OFFSETS,
    PREFIXES,
    format_difference,
    format_quantity,
    parse_quantity,
    parse_unit,
    symbols,
)

REFEREE: pint.UnitRegistry[float] = pint.UnitRegistry()
#: rigd's symbols that the referee spells otherwise, or takes for something else.
SPELT = {
    "1": "dimensionless", "%": "percent", "rev": "turn", "strain": "dimensionless", "l": "liter",
    "L": "liter", "°": "degree", "Ω": "ohm", "counts": "count", "sec": "second",
    "psi": "lbf/inch**2", "h": "hour", "kgf": "kilogram_force", "gf": "gram_force", "U": "turn",
}  # fmt: skip
#: The dimensions of the referee; ``rad``, ``count``, ``bit`` and ``strain`` are none there.
EXPONENTS = {"[mass]": "kg", "[length]": "m", "[time]": "s", "[current]": "A", "[temperature]": "K"}


def every_symbol() -> Iterator[str]:
    prefixed, bare = symbols()
    yield from (word for word in bare if word not in OFFSETS and not word.startswith("°F"))
    for word in prefixed:
        yield word
        yield from (f"{prefix}{word}" for prefix in PREFIXES)


def refereed(symbol: str) -> Any:
    """Return 1 in the unit as the referee has it, in its SI base units."""
    if symbol in SPELT:
        return REFEREE.Quantity(1.0, SPELT[symbol]).to_base_units()
    prefix = next((item for item in PREFIXES if symbol == f"{item}{symbol[len(item):]}"
                   and symbol[len(item):] in symbols()[0]), "")  # fmt: skip
    stem = symbol.removeprefix(prefix) if symbol not in symbols()[0] + symbols()[1] else symbol
    if stem != symbol:
        scale = REFEREE.Quantity(1.0, f"{prefix.replace('μ', 'µ')}meter").to("meter").magnitude
        return scale * refereed(stem)
    return REFEREE.Quantity(1.0, symbol).to_base_units()


@pytest.mark.parametrize("symbol", sorted(set(every_symbol()) - {"°C"}))
def test_every_unit_is_as_its_referee_has_it(symbol: str) -> None:
    unit, expected = parse_unit(symbol), refereed(symbol)
    # The referee counts bits, revolutions per minute and degrees as rigd does, but has no dimension
    # for angles and counts.
    found = {base: power for base, power in zip(BASES, unit.dimension, strict=True)
             if power and base not in ("rad", "count")}  # fmt: skip
    referee = {EXPONENTS[kind]: power for kind, power in expected.dimensionality.items()}
    assert found == referee
    assert unit.factor == pytest.approx(expected.magnitude, rel=1e-12)


@pytest.mark.parametrize("number", [-40.0, -1.5, 0.0, 21.7, 100.0, 1200.0])
@pytest.mark.parametrize(("symbol", "referee"), [("degC", "degC"), ("°C", "degC"),
                                                 ("degF", "degF"), ("°F", "degF")])  # fmt: skip
def test_temperature_is_as_its_referee_has_it(number: float, symbol: str, referee: str) -> None:
    expected = REFEREE.Quantity(number, referee).to("kelvin").magnitude
    read = parse_quantity(f"{number} {symbol}")
    assert read.value == pytest.approx(expected, rel=1e-14)
    assert parse_quantity(str(read)).value == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize(
    ("symbol", "referee"),
    [("barg", "bar"), ("mbarg", "mbar"), ("kPag", "kPa"), ("psig", "lbf/inch**2")],
)
def test_gauge_pressure_is_above_standard_atmosphere(symbol: str, referee: str) -> None:
    above = REFEREE.Quantity(2.5, referee).to("pascal").magnitude
    atmosphere = REFEREE.Quantity(1.0, "atm").to("pascal").magnitude
    assert pytest.approx(atmosphere, rel=1e-14) == ATMOSPHERE_PA
    assert parse_quantity(f"2.5 {symbol}").value == pytest.approx(above + atmosphere, rel=1e-12)


@pytest.mark.parametrize(
    "text", ["degC/s", "1/degC", "degC^2", "W/°C", "barg m^2", "psig/s", "K/degF"]
)
def test_unit_with_own_zero_stands_alone(text: str) -> None:
    with pytest.raises(ValueError, match=r"has a zero of its own .* write (K|bar|psi)"):
        parse_unit(text)


@pytest.mark.parametrize(
    ("given", "instead"),
    [("2 degC", "2 K"), ("-3 °C", "-3 K"), ("9 degF", "5 K"), ("0.5 barg", "0.5 bar"),
     ("3 psig", "3 psi"), ("20 mbarg", "20 mbar")],
)  # fmt: skip
def test_value_on_scale_is_no_difference(given: str, instead: str) -> None:
    with pytest.raises(ValueError, match=f"write '{instead}'"):
        parse_quantity(given).as_difference()


def test_difference_is_never_offset() -> None:
    assert format_difference(2.0, "degC") == "2 K"
    assert format_difference(2e5, "barg") == "2 bar"
    assert format_difference(2e-3, "mm") == "2 mm"


@pytest.mark.parametrize(
    ("text", "meant"),
    [("25 C", "degC"), ("25 deg C", "degC"), ("70 F", "degF"), ("25 degc", "degC"),
     ("3 lpm", "L/min"), ("2 bara", "bar")],
)  # fmt: skip
def test_nearly_right_unit_names_the_right_one(text: str, meant: str) -> None:
    with pytest.raises(ValueError, match=f"did you mean '{meant}'"):
        parse_quantity(text)


@pytest.mark.parametrize("text", ["0 degC", "32 degF", "0 barg", "-273.15 degC"])
def test_round_value_on_scale_is_printed_round(text: str) -> None:
    assert str(parse_quantity(text)) == text


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("0.15 A", 0.15),
        ("150 mA", 0.15),
        ("15 deg", math.pi / 12),
        ("1 rev", 2 * math.pi),
        ("60 rpm", 2 * math.pi),
        ("49.933 1/m", 49.933),
        ("2.4 s/m", 2.4),
        ("9.81 m/s^2", 9.81),
        ("9.81 m/s²", 9.81),
        ("4.5 g m^2", 4.5e-3),
        ("30 N·m", 30.0),
        ("0.0295 N m/A", 0.0295),
        ("3 kg m / s^2", 3.0),
        ("1e3 Hz", 1000.0),
        ("5 %", 0.05),
        ("-2.5e-1 mm", -2.5e-4),
        ("12 µm", 12e-6),
        ("7", 7.0),
        ("2 min", 120.0),
        ("6 L/min", 1e-4),
        ("1500 mL", 1.5e-3),
        ("6 bar", 6e5),
        ("1024 count/rev", 1024 / (2 * math.pi)),
    ],
)
def test_text_becomes_si(text: str, value: float) -> None:
    assert parse_quantity(text).value == pytest.approx(value, rel=1e-14)


@pytest.mark.parametrize(
    "text", ["", "A", "1.5 furlong", "1 m/", "nan m", "inf A", "1,5 A", "0x10 A", "1 m^", "5 k"]
)
def test_text_without_valid_quantity_is_refused(text: str) -> None:
    with pytest.raises(ValueError):
        parse_quantity(text)


@pytest.mark.parametrize(
    ("first", "second", "same"),
    [
        ("N m", "J", True),
        ("V", "W/A", True),
        ("A", "V", False),
        ("rad", "1", False),  # unlike in SI: an angle without a unit is a mistake here
        ("m/count", "m", False),
        ("Hz", "1/s", True),
        ("rad/s", "Hz", False),
    ],
)
def test_units_have_same_kind_if_convertible(first: str, second: str, same: bool) -> None:
    assert parse_unit(first).same_kind(parse_unit(second)) is same


@given(
    st.floats(-1e6, 1e6).filter(lambda x: x == 0 or abs(x) > 1e-6),
    st.sampled_from(["A", "mm", "deg", "N m", "1/m", "kHz", "s/m", "degC", "degF", "psig"]),
)
def test_printed_quantity_reads_back_unchanged(value: float, unit: str) -> None:
    shown = format_quantity(value, unit)
    rounding = 1e-5 * parse_unit(unit).offset or 1e-12
    assert parse_quantity(shown).value == pytest.approx(value, rel=1e-5, abs=rounding)


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("\u22120.3 A", "U+2212 MINUS SIGN"),
        ("\ufeff0.3 A", "U+FEFF ZERO WIDTH NO-BREAK SPACE"),
        ("0.3 A\u200b", "U+200B ZERO WIDTH SPACE"),
        ("0.3\u00a0m\u2013s", "U+2013 EN DASH"),
    ],
)
def test_character_that_looks_alike_is_named(text: str, name: str) -> None:
    with pytest.raises(ValueError, match=re.escape(name)):
        parse_quantity(text)
