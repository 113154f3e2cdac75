"""Measures of several campaigns: which trials are of one condition, and which measures are one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rigd.analysis.api import ResultOrigin
from rigd.analysis.compare.campaign import MEASURES, Campaign, campaign_of_measures
from rigd.analysis.compare.comparison import compare
from rigd.analysis.measures.result import MeasureResult, Summary, TrialReading, summary_of
from rigd.model.errors import DataError
from rigd.procedure.program import Comparison, Condition, Measure, Window

GAP = Measure("gap", "mean", "axis.gap", Window(), "mm")
OPEN = ((Condition("axis.gap", Comparison.ABOVE, 5e-3, unit="mm"),),)


def summary(
    name: str,
    condition: Mapping[str, str],
    measure: Measure = GAP,
    point: Mapping[str, str] | None = None,
) -> Summary:
    """Return the summary of four runs of one trial under this condition, ``point`` in SI."""
    random = np.random.default_rng(len(name))
    readings = [
        TrialReading(Path(f"{name}-{run}.mcap"), 1, float(value))
        for run, value in enumerate(1e-3 + 1e-5 * random.standard_normal(4))
    ]
    return summary_of(measure, {}, readings, condition, point or condition)


def campaign(name: str, *summaries: Summary) -> Campaign:
    origin = ResultOrigin(f"{name}.mcap", "bench", "wear", MEASURES, "", {}, {})
    return campaign_of_measures(name, (origin,), MeasureResult(summaries))


def of_floors(name: str, *floors: str) -> Campaign:
    """Return the campaign of trials on ``floors``, with one force in all of them."""
    return campaign(name, *(summary(name, {"force": "1 N", "floor": item}) for item in floors))


def test_groups_without_common_condition_are_refused() -> None:
    with pytest.raises(DataError) as refused:
        compare([of_floors("before", "pvc"), of_floors("after", "stone")])
    assert refused.value.message == (
        "the groups have no condition in common: floor is pvc in before, stone in after"
    )


def test_parameter_that_one_group_lacks_is_named() -> None:
    older = campaign("older", summary("older", {"force": "1 N"}))
    with pytest.raises(DataError, match="floor is not stated in older, pvc in newer"):
        compare([older, of_floors("newer", "pvc")])


def test_groups_without_common_measure_are_named() -> None:
    other = campaign("b", summary("b", {}, Measure("mu", "mean", "axis.mu", Window(), "1")))
    with pytest.raises(DataError, match=r"in common \(a: gap; b: mu\)"):
        compare([campaign("a", summary("a", {})), other])


def test_condition_of_both_groups_is_compared() -> None:
    found = compare([of_floors("before", "pvc", "stone"), of_floors("after", "pvc")]).compared
    assert {row.group: set(row.differences) for row in found} == {
        "floor pvc": {"after"}, "floor stone": set(),
    }  # fmt: skip
    assert found[1].why == "after: no such trials, or they were refused"


@pytest.mark.parametrize(
    ("other", "told"),
    [
        (
            replace(GAP, kind="duration", channel="", when=OPEN, unit="s"),
            "time from the beginning to axis.gap > 5 mm, during the steps, in s",
        ),
        (replace(GAP, window=Window("pull")), "mean of axis.gap, during step 'pull', in m"),
        (replace(GAP, channel="axis.width"), "mean of axis.width, during the steps, in m"),
        (replace(GAP, unit="V"), "mean of axis.gap, during the steps, in V"),
    ],
)
def test_measure_of_another_definition_is_refused(other: Measure, told: str) -> None:
    with pytest.raises(DataError) as refused:
        compare([campaign("a", summary("a", {})), campaign("b", summary("b", {}, other))])
    assert refused.value.message == (
        "the groups measure gap in different ways (a: mean of axis.gap, during the steps, in m; "
        f"b: {told})"
    )


def test_other_words_and_display_units_are_compared() -> None:
    other = replace(GAP, unit="um", doc="The gap")
    found = compare([campaign("a", summary("a", {})), campaign("b", summary("b", {}, other))])
    assert found.compared[0].differences


def test_order_of_parameters_makes_no_condition() -> None:
    turned = campaign("b", summary("b", {"floor": "pvc", "force": "1 N"}))
    (row,) = compare([of_floors("a", "pvc"), turned]).compared
    assert row.group == "" and set(row.differences) == {"b"}


def of_formula(name: str, formula: str) -> Campaign:
    return replace(campaign(name, summary(name, {})), formulas={"gap": {"axis.gap": formula}})


def test_measure_of_another_formula_is_refused() -> None:
    with pytest.raises(DataError) as refused:
        compare([of_formula("a", "axis.top / 2"), of_formula("b", "axis.top / 3")])
    assert refused.value.message == (
        "the groups measure gap in different ways (a: axis.gap = axis.top / 2; "
        "b: axis.gap = axis.top / 3)"
    )


def test_formula_of_one_group_alone_is_compared() -> None:
    old = campaign("a", summary("a", {}))  # its rig file is of another version of rigd
    (row,) = compare([old, of_formula("b", "axis.top / 3")]).compared
    assert row.differences


def test_condition_in_other_unit_is_the_same() -> None:
    names = {"a": ("1 N", "2 N"), "b": ("1000 mN", "3000 mN")}
    first, second = (
        campaign(
            name,
            *(
                summary(name, {"force": text}, point={"force": newtons})
                for text, newtons in zip(texts, values, strict=True)
            ),
        )
        for (name, texts), values in zip(names.items(), (("1", "2"), ("1", "3")), strict=True)
    )
    found = compare([first, second]).compared
    assert {row.group: set(row.differences) for row in found} == {
        "force 1 N": {"b"}, "force 2 N": set(), "force 3000 mN": set(),
    }  # fmt: skip
