import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigd.analysis.report.rounding import (
    count,
    interval,
    number,
    percent,
    places_for,
    probability,
    spread,
)


@pytest.mark.parametrize(
    ("uncertainty", "places"), [(0.023, 3), (0.23, 2), (1.0, 1), (130.0, -1), (0.0, None)]
)
def test_two_digits_of_uncertainty(uncertainty: float, places: int | None) -> None:
    assert places_for(uncertainty) == places


@pytest.mark.parametrize("nothing", [math.nan, math.inf, -1.0])
def test_unusable_uncertainty_gives_no_places(nothing: float) -> None:
    assert places_for(nothing) is None


@pytest.mark.parametrize(
    ("value", "places", "text"),
    [
        (1234.5, -1, "1230"),
        (0.12, None, "0.12"),
        (0.12, 4, "0.1200"),
        (-3.0, 1, "−3.0"),
        (3.1e-6, None, "3.1×10⁻⁶"),
        (3.14159e-6, 7, "3.1×10⁻⁶"),
        (2.5e9, None, "2.5×10⁹"),
        (9.99996e-5, None, "0.0001"),
        (999996.0, None, "1×10⁶"),
        (-9.99996e-8, None, "−1×10⁻⁷"),
        (5e-324, None, "4.941×10⁻³²⁴"),
        (1.7976931348623157e308, None, "1.798×10³⁰⁸"),
        (0.0, 2, "0.00"),
        (0.0, None, "0"),
        (math.nan, None, "undefined"),
    ],
)
def test_number_has_requested_decimal_places(value: float, places: int | None, text: str) -> None:
    assert number(value, places) == text


@given(st.floats(1e-12, 1e12))
def test_number_without_places_is_right_to_four_digits(value: float) -> None:
    text = number(value).translate(str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹−", "-0123456789-"))
    read = float(text.replace("×10", "e"))
    assert read == pytest.approx(value, rel=6e-4)


@pytest.mark.parametrize(
    ("low", "high", "text"),
    [
        (1.0, 1.2, "1.00 … 1.20"),
        (None, 1.23, "≤ 1.2"),
        (0.016, None, "≥ 0.016"),
        (None, None, "open on both sides"),
    ],
)
def test_interval_text_shows_both_ends_or_none(
    low: float | None, high: float | None, text: str
) -> None:
    assert interval(low, high) == text


@pytest.mark.parametrize(
    ("low", "high", "text"),
    [
        (0.9, 1.1, "± 0.10"),
        (0.95, 1.3, "+0.30 −0.05"),
        (1.01, 1.1, ""),
        (None, 1.1, ""),
    ],
)
def test_spread_text_shows_symmetric_or_both_sides(
    low: float | None, high: float | None, text: str
) -> None:
    assert spread(1.0, low, high) == text


def test_tiny_p_value_is_only_bounded() -> None:
    assert probability(0.0) == "p < 1×10⁻⁶"
    assert probability(0.0312) == "p = 0.031"


def test_percent_and_count_are_rounded_for_readers() -> None:
    assert percent(0.0412) == "+4.1 %"
    assert percent(-0.3) == "−30 %"
    assert percent(-0.00017) == "−0.02 %"
    assert count(17312) == "17\N{NARROW NO-BREAK SPACE}312"
