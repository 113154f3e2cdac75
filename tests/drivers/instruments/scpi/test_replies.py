"""Answers as instruments give them: numbers, those that are none, entries of the error queue."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigd_drivers.instruments.scpi.replies import Entry, read_entry, read_number


@pytest.mark.parametrize(
    ("answer", "value"),
    [
        ("+1.00000000E+00", 1.0),  # NR3, Keysight E36100 series, programming guide
        ("23.456", 23.456),
        (" -4 ", -4.0),
        ("- 4.5", -4.5),
        (".5", 0.5),
        ("9.9E37", math.nan),  # infinity, SCPI-1999 volume 1, 7.2.1.4
        ("-9.9E+37", math.nan),
        ("9.91E37", math.nan),  # not a number, 7.2.1.5
        ("NAN", math.nan),
        ("INF", math.nan),
    ],
)
def test_number_is_read(answer: str, value: float) -> None:
    found = read_number(answer)
    assert found is not None
    assert found == value or (math.isnan(found) and math.isnan(value))


@pytest.mark.parametrize("answer", ["", "ERROR", "23,5", "1.0 V", "1 2", "0x10", "1e9999", "--1"])
def test_text_that_is_no_number_gives_none(answer: str) -> None:
    assert read_number(answer) is None


@pytest.mark.parametrize(
    ("answer", "entry"),
    [
        ('+0,"No error"', Entry(0, "No error")),  # SCPI-1999 volume 1, 21.8.1
        ('-113,"Undefined header"', Entry(-113, "Undefined header")),
        ("0", Entry(0)),
        ("0, No Error", Entry(0, "No Error")),
        ('-222,"Data out of range;SOUR:TEMP 900"', Entry(-222, "Data out of range;SOUR:TEMP 900")),
    ],
)
def test_entry_of_queue_is_read(answer: str, entry: Entry) -> None:
    assert read_entry(answer) == entry


@pytest.mark.parametrize("answer", ["", "No error", "23.4", '"No error",0'])
def test_text_that_is_no_entry_gives_none(answer: str) -> None:
    assert read_entry(answer) is None


@given(st.text(max_size=40))
def test_any_text_is_read_or_refused(answer: str) -> None:
    read_number(answer)
    read_entry(answer)
