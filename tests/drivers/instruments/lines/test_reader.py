"""Numbers in lines: what is read, and what must not become a number."""

from __future__ import annotations

import math
from typing import Any

import pytest

from rigd_drivers.instruments.lines.config import LinesConfig
from rigd_drivers.instruments.lines.reader import LineReader, Reading, Unreadable
from rigd_drivers.instruments.lines.text import encoded


def reader(**options: Any) -> LineReader:
    return LineReader(LinesConfig.model_validate({"port": "/dev/null", **options}))


GAUGE = reader(pattern=r"(?P<force>.*) N", channels={"force": "N"})
TABLE = reader(
    separator=";",
    columns=["temperature", "-", "force"],
    channels={"force": {"unit": "kN", "low": "-1 kN", "high": "2 kN"}, "temperature": "degC"},
    beyond=["OL", "-----"],
)


@pytest.mark.parametrize(
    ("written", "expected"),
    [
        ("4.285", 4.285), ("+4.285", 4.285), ("-4.285", -4.285), ("+   4.285", 4.285),
        (".5", 0.5), ("5.", 5.0), ("1.5e-3", 1.5e-3), ("+1.5E+02", 150.0), ("007", 7.0),
    ],
)  # fmt: skip
def test_number_of_every_style_is_read(written: str, expected: float) -> None:
    assert GAUGE.read(f"  {written} N ".encode()) == Reading((expected,), False)


@pytest.mark.parametrize(
    "written",
    ["", "x", "1.2.3", "1 2", "--1", "+-1", "1e", "nan", "inf", "0x1F", "1,5", "1_000", "\u0663",
     "1\x005", "1.5 N 2.5", "1e9999", "12\xb75"],
)  # fmt: skip
def test_what_is_no_number_is_refused(written: str) -> None:
    found = GAUGE.read(f"{written} N".encode())
    assert isinstance(found, Unreadable)
    assert "group 'force'" in found.reason or "match" in found.reason


def test_decimal_comma_is_read_if_given() -> None:
    comma = reader(pattern="(?P<force>.*) N", channels={"force": "N"}, decimal="comma")
    assert comma.read(b"-1,25 N") == Reading((-1.25,), False)
    assert isinstance(comma.read(b"1.000,25 N"), Unreadable)
    assert isinstance(comma.read(b"1.25 N"), Unreadable)
    assert "decimal: comma" in str(GAUGE.read(b"1,25 N"))


def test_columns_become_channels_in_si() -> None:
    found = TABLE.read(b"20.0; x ;1.5")
    assert isinstance(found, Reading)
    assert found.values == pytest.approx((1500.0, 293.15))


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        (b"20.0;0", "it has 2 columns, expected 3"),
        (b"20.0;0;1.5;1.5", "it has 4 columns, expected 3"),
        (b"20.0;0;", r"column 3 ('force') is ''"),
        (b"2O.0;0;1.5", r"column 1 ('temperature') is '2O.0', which is no number"),
        (b"20.0;0;2.5", r"column 3 ('force') is '2.5', beyond -1000 to 2000 N"),
        (b"20.0;0;1.5" * 2, "columns"),
    ],
)
def test_reason_names_the_column(line: bytes, reason: str) -> None:
    found = TABLE.read(line)
    assert isinstance(found, Unreadable)
    assert reason in found.reason
    assert found.line == line


def test_value_beyond_range_is_nan() -> None:
    found = TABLE.read(b"20.0;0;ol")
    assert isinstance(found, Reading)
    assert found.beyond
    assert math.isnan(found.values[0])
    assert not math.isnan(found.values[1])


def test_blanks_separate_columns_by_default() -> None:
    plain = reader(columns=["a", "b"], channels={"a": "1", "b": "0.01 N"})
    found = plain.read(b"  1.5\t\t  -20 ")
    assert isinstance(found, Reading)
    assert found.values == pytest.approx((1.5, -0.2))


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        (b"F=1.5 N", "group 'force' does not match the pattern, at 'F=1.5 N'"),
        (b"f=1.5 N t=x", "group 't' does not match the pattern, at ' N t=x'"),
        (b"f=1.5 N t=2 K", "does not match the rest ' K' behind group 't'"),
    ],
)
def test_mismatch_names_the_group(line: bytes, reason: str) -> None:
    both = reader(
        pattern=r"f=(?P<force>[-+.\d]+) N t=(?P<t>[\d.]+)", channels={"force": "N", "t": "K"}
    )
    assert reason in str(both.read(line))


@pytest.mark.parametrize("line", ["21.5 °C".encode(), "21.5 °C".encode("latin-1")])
def test_line_of_either_encoding_is_read(line: bytes) -> None:
    found = reader(pattern="(?P<t>.*) °C", channels={"t": "°C"}).read(line)
    assert isinstance(found, Reading)
    assert found.values == pytest.approx((294.65,))


def test_long_line_is_shown_in_part() -> None:
    shown = str(GAUGE.read(b"9" * 200))
    assert "..." in shown
    assert len(shown) < 200


def test_escapes_become_bytes() -> None:
    assert encoded(r"?\r\n") == b"?\r\n"
    assert encoded(r"\x02A\\\t\e\0") == b"\x02A\\\t\x1b\0"
    for wrong in (r"\q", "a\\", r"\xG1", "µ"):
        with pytest.raises(ValueError, match=r"escape|ASCII"):
            encoded(wrong)
