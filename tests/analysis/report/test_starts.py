from collections.abc import Callable
from dataclasses import replace

from rigd.analysis.report import ReportSection
from rigd.analysis.report.tables.starts import start_table

Maker = Callable[..., ReportSection]


def test_lowest_cost_comes_first_and_is_counted(make_section: Maker) -> None:
    table = start_table(make_section(trials=1, samples=200).result)
    assert table is not None
    assert table.sentence == (
        "6 of 12 starts reached the lowest cost to within 0.1 %; "
        "2 stopped before they had converged."
    )
    assert [line.best for line in table.lines] == [True] * 6 + [False] * 6
    assert table.lines[0].rise == "lowest"
    assert table.lines[-1].rise == "+7.4 %"


def test_columns_that_data_do_not_determine_are_marked(make_section: Maker) -> None:
    table = start_table(make_section(trials=1, samples=200).result)
    assert table is not None
    assert dict(zip((name for name, _ in table.names), table.loose, strict=True)) == {
        "V_s": True, "mu_c": False, "mu_s": False,
        "sigma_0": False, "sigma_1": False, "sigma_2": False,
    }  # fmt: skip


def test_minimum_reached_by_one_start_is_reported(make_section: Maker) -> None:
    result = make_section(trials=1, samples=200).result
    lonely = replace(result, starts=(result.starts[0], result.starts[6]))
    table = start_table(lonely)
    assert table is not None
    assert "may not be the global one" in table.sentence


def test_no_starts_no_table(bare_section: ReportSection) -> None:
    assert start_table(bare_section.result) is None
