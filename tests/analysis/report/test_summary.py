from collections.abc import Callable
from dataclasses import replace

import pytest

from rigd.analysis.report import ReportSection, SummaryRow, summary_rows
from rigd.analysis.result import Verdict

Maker = Callable[..., ReportSection]


def rows(section: ReportSection) -> dict[str, SummaryRow]:
    return {row.name: row for row in summary_rows([section])}


@pytest.fixture(scope="module")
def table(make_section: Maker) -> dict[str, SummaryRow]:
    return rows(make_section("Natural stone", trials=1, samples=200))


def test_rows_come_section_by_section_known_ones_first(make_section: Maker) -> None:
    stone = make_section("Natural stone", trials=1, samples=200)
    paper = make_section("Paperboard", trials=1, samples=200)
    found = summary_rows([stone, paper])
    assert [row.section for row in found] == ["Natural stone"] * 7 + ["Paperboard"] * 7
    assert [row.name for row in found[:7]] == [
        "sigma_0", "sigma_2", "sigma_sum", "mu_c", "mu_s", "sigma_1", "V_s",
    ]  # fmt: skip
    assert [row.name for row in found[:7] if row.derived] == ["sigma_sum"]


def test_estimate_has_the_digits_of_its_interval(table: dict[str, SummaryRow]) -> None:
    row = table["sigma_0"]
    assert (row.estimate_text, row.spread_text) == ("11.51", "± 0.23")
    assert row.interval_text == "11.28 … 11.74"
    assert row.verdict is Verdict.IDENTIFIABLE


def test_unidentifiable_parameter_shows_no_number_of_its_result(
    make_section: Maker,
) -> None:
    section = make_section(trials=1, samples=200)
    lost = replace(section.result.parameter("V_s"), low=1.0, high=2.0)
    section = replace(section, result=replace(section.result, parameters=(lost,)))
    row = rows(section)["V_s"]
    assert (row.estimate, row.low, row.high) == (None, None, None)
    assert not row.known
    shown = (row.estimate_text, row.spread_text, row.interval_text, row.comparison)
    assert not any(character.isdigit() for text in shown for character in text)


def test_open_end_is_marked_and_the_estimate_rough(table: dict[str, SummaryRow]) -> None:
    row = table["mu_c"]
    assert row.interval_text == "≤ 0.17"
    assert row.estimate_text == "≈ 0.13"
    assert row.spread_text == ""


def test_biased_is_not_compared_by_its_interval(table: dict[str, SummaryRow]) -> None:
    assert table["sigma_1"].comparison == "interval not comparable, estimate +30 %"


@pytest.mark.parametrize(
    ("reference", "expected"),
    [
        (11.5, "inside the interval, estimate +0.1 %"),
        (12.5, "outside the interval, estimate −7.9 %"),
        (0.0, "outside the interval"),
    ],
)
def test_reference_is_placed_against_the_interval(
    make_section: Maker, reference: float, expected: str
) -> None:
    section = replace(make_section(trials=1, samples=200), reference={"sigma_0": reference})
    assert rows(section)["sigma_0"].comparison == expected


def test_no_reference_no_comparison(table: dict[str, SummaryRow]) -> None:
    assert table["sigma_sum"].reference is None
    assert table["sigma_sum"].comparison == ""


def test_flag_that_repeats_the_verdict_is_dropped(make_section: Maker) -> None:
    section = make_section(trials=1, samples=200)
    flagged = replace(section.result.parameter("sigma_1"), flags=(Verdict.BIASED.value, "at bound"))
    section = replace(section, result=replace(section.result, parameters=(flagged,)))
    assert rows(section)["sigma_1"].flags == ("at bound",)
