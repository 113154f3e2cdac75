"""The budget of a section: which source makes how much of each uncertainty."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from rigd.analysis.report import ReportSection
from rigd.analysis.report.tables.uncertainty_budget import OTHERS, budget_table

BUDGET = {
    "sigma_0": {"noise": 3e-3, "gravity": 4e-3, "slope of the floor": 1e-5},
    "sigma_2": {"noise": 2e-2, "wheel radius": 1e-4},
}


def test_sources_are_rows_and_known_parameters_columns(
    make_section: Callable[..., ReportSection],
) -> None:
    result = replace(make_section().result, budget=BUDGET)
    known = [item for item in result.parameters if item.name in BUDGET and item.quoted is not None]
    table = budget_table(result)
    assert table is not None
    assert table.symbols == tuple(item.symbol for item in known) and len(known) == 2
    assert table.rows == (
        ("noise", ("0.3", "2")),
        ("gravity", ("0.4", "–")),
        (OTHERS, ("0.001", "0.01")),
    )
    assert table.combined == ("0.5", "2")


def test_parameter_without_number_has_no_column(
    make_section: Callable[..., ReportSection],
) -> None:
    result = make_section().result
    unknown = next(item.name for item in result.parameters if item.quoted is None)
    assert budget_table(replace(result, budget={unknown: {"noise": 0.1}})) is None
    assert budget_table(result) is None
