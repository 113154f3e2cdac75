"""Which recordings a condition finds, and what a wrong condition is told."""

from __future__ import annotations

from pathlib import Path

import pytest

from rigd.catalogue import equal, parse_where, search
from rigd.model.errors import ConfigError


def found(folder: Path, where: str) -> str:
    """Return the letters of the recordings that are found."""
    lines = search(folder, parse_where(where)).lines
    return "".join(Path(line.file).stem for line in lines)


@pytest.mark.parametrize(
    ("where", "letters"),
    [
        ('specimen.coating == "PTFE"', "ab"),
        ('specimen.coating == "PTFE" and started > 2026-08-31', "b"),
        ("specimen == W7 or specimen == 'W9'", "ac"),
        ("specimen in (W7, W9)", "ac"),
        ("procedure == wear and state == complete or specimen == W9", "abc"),
        ("procedure == wear and (state == complete or specimen == W9)", "ab"),
        # Who states nothing is neither equal nor unequal.
        ("specimen.coating != PTFE", "c"),
        ("not specimen.coating == PTFE", "cd"),
        ("specimen is missing", "d"),
        ("specimen is not missing", "abc"),
        ("operator is known", "b"),
        # Quantities are compared in SI.
        ("specimen.hardness >= 5000 MPa", "ac"),
        ("hardness > 5 GPa", "c"),
        ('parameter.current == "150 mA"', "b"),
        ("current < 0.12 A", "a"),
        ("current > 100 mA and trials == 1", "b"),
        ("meta.batch in (13, 14)", "ab"),
        ('meta.batch == "13"', "a"),
        ("duration == 5 s", "abc"),
        ("duration < 0.1 min", "abcd"),
        # A date is the whole period that is written.
        ("started == 2026-09-01", "b"),
        ("started > 2026-09-01", "cd"),
        ("started >= 2026-09-01", "bcd"),
        ("started <= 2026-09-01", "ab"),
        ("started < 2026-09", "a"),
        ("started == 2026-09", "b"),
        ("started == 2026-09-01 23:59", "b"),
        ("started == 2026-11-01 00:00", "d"),
        ("started == '2026-11-01T02:00+02:00'", "d"),
        ('started > "2026-10-02T00:00:00Z"', "d"),
        ('note contains "CLEANED"', "a"),
        ("note contains 'öL'", "c"),
        ('note contains "%\'; DROP TABLE facts --"', ""),
        ("verdict == accepted", ""),
        ("file contains deep", "d"),
        ("run.operator == 'A. Miller'", "b"),
    ],
)
def test_a_condition_finds_its_runs(folder: Path, where: str, letters: str) -> None:
    assert found(folder, where) == letters


@pytest.mark.parametrize(
    ("where", "column", "message"),
    [
        ("specimen.coatng == PTFE", 1, "did you mean 'specimen.coating'?"),
        ("state == complete and hardnes > 1 GPa", 23, "did you mean 'specimen.hardness'?"),
        ("duration > 60", 12, "write 60 s"),
        ("hardness > 5 N", 12, "hardness is in Pa, and 5 N is not\n  give it in Pa"),
        ("started > 5 s", 11, "write a date such as 2026-09-01"),
        ("started > 2026-13-01", 11, "there is no date 2026-13-01"),
        ("state < complete", 9, "a word is neither less nor more"),
        ("specimen == 8", 13, 'write it in quotes: specimen == "8"'),
        ("lot == 7", 1, "'lot' can be parameter.lot or meta.lot"),
        ("duration > 5 parsec", 14, "unknown unit 'parsec'"),
        ("state = complete", 7, "write '=='"),
        ("state == complete && rig == bench", 19, "write 'and'"),
        ("state == 'complete", 10, "a quotation mark is not closed"),
        ("state == complete rig == bench", 19, "join conditions with 'and' or 'or'"),
        ("(state == complete", 19, "a ')' is missing"),
        ("state", 6, "expected a comparison after 'state'"),
        ("state is gone", 10, "expected 'missing' or 'known', not 'gone'"),
        ("state ==", 9, "a value is missing"),
        ("", 1, "a value is missing"),
        ("5 == state", 1, "expected the name of a field"),
        ("1 s < duration", 1, "expected the name of a field"),
        ("duration < 5 s + 1 s", 12, "expected a value"),
        ("duration > 1 s < 5 s", 18, "join them with 'and'"),
        ("(" * 40 + "state == complete", 32, "nests deeper than 30"),
        ("state == " + "x" * 1000, 1, "at most 1000"),
        ("state == com\x00plete", 13, "cannot read"),
    ],
)
def test_a_wrong_condition_is_shown_where(
    folder: Path, where: str, column: int, message: str
) -> None:
    with pytest.raises(ConfigError) as raised:
        found(folder, where)
    assert str(raised.value).startswith(f"--where:1:{column}: ")
    assert message in str(raised.value)


def test_no_match_shows_what_there_is(folder: Path) -> None:
    result = search(folder, parse_where("specimen.coating == TPFE and rig == bench"))
    assert result.stated == {"specimen.coating": ["PTFE (2)", "DLC (1)"], "rig": ["bench (4)"]}


@pytest.mark.parametrize(
    ("wanted", "letters"),
    [("0.15 A", "b"), ("150 mA", "b"), ("0.15 V", ""), ("0.150001 A", ""), ("left", "")],
)
def test_parameters_are_equal_as_text_or_quantity(folder: Path, wanted: str, letters: str) -> None:
    lines = search(folder, equal("parameter.current", wanted)).lines
    assert "".join(Path(line.file).stem for line in lines) == letters
