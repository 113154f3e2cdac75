"""Units: what a person writes becomes SI, and kinds are kept apart."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigd.model.units import format_quantity, parse_quantity, parse_unit


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
    st.sampled_from(["A", "mm", "deg", "N m", "1/m", "kHz", "s/m"]),
)
def test_printed_quantity_reads_back_unchanged(value: float, unit: str) -> None:
    shown = format_quantity(value, unit)
    assert parse_quantity(shown).value == pytest.approx(value, rel=1e-5)
