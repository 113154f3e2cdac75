"""The tables of a cycle, and their copy for compiled functions."""

from __future__ import annotations

import math

import numpy as np

from rigd.model.tables import NOWHERE, Tables


def _tables() -> Tables:
    """Return tables of two devices (three values) and a computed row of two, with its time."""
    return Tables(
        values=[1.5, 2.5, 3.5, math.nan, math.nan], stamps=[10, 20, 0], applied=[0.25, 0.5],
        wanted=[7.0, 8.0], readings={"a.x": 0, "a.y": 1, "b.x": 2, "c.x": 3},
        stamp_of=[0, 0, 1, 2, 2], late_ns=[5, 6, 7], setpoints={"a.goal": 0, "b.goal": 1},
        rows={"c": (3, 2)}, read=(3, 2),
    )  # fmt: skip


def test_sources_give_values_times_and_ages() -> None:
    tables = _tables()
    tables.take(30)
    floats = tables.words.view(np.float64)
    expected = {
        "a.y": (2.5, 10, 5), "b.x": (3.5, 20, 6), "a.goal_setpoint": (0.25, 30, 0),
        "b.goal_setpoint": (0.5, 30, 0),
    }  # fmt: skip
    for name, (value, stamp, late_ns) in expected.items():
        source = tables.source(name)
        found = (floats[source.value], tables.words[source.stamp], source.late_ns)
        assert found == (value, stamp, late_ns)


def test_unknown_source_is_nan_without_time() -> None:
    tables = _tables()
    source = tables.source("d.x")
    assert math.isnan(tables.words.view(np.float64)[source.value])
    assert (tables.words[source.stamp], tables.row("d")) == (0, (NOWHERE, NOWHERE))


def test_computed_row_is_shown_and_stays() -> None:
    tables = _tables()
    show = tables.shows(slice(3, 5), slice(2, 3))
    value, stamp = tables.row("c")
    tables.words.view(np.float64)[value : value + 2] = 4.5, 5.5
    tables.words[stamp] = 30
    tables.take(40)  # copies devices alone
    show()
    assert tables.values == [1.5, 2.5, 3.5, 4.5, 5.5]
    assert tables.stamps == [10, 20, 30]


def test_setpoints_go_to_memory_and_back() -> None:
    tables = _tables()
    tables.take(30)
    tables.take_wanted()
    wanted, applied = tables.asked("b.goal")
    floats = tables.words.view(np.float64)
    assert (floats[wanted], floats[applied]) == (8.0, 0.5)
    floats[wanted], floats[applied] = 9.0, 0.75
    tables.show_setpoints()
    assert (tables.wanted, tables.applied) == ([7.0, 9.0], [0.25, 0.75])


def test_time_is_set_in_list_and_memory() -> None:
    tables = _tables()
    tables.stamp(2, 55)
    assert (tables.stamps[2], tables.words[tables.stamp_at(2)]) == (55, 55)


def test_memory_alone_has_newest_times_of_derived() -> None:
    tables = Tables([1.0, 2.0], [10, 20, 30], [], [], {}, [0, 2], [0] * 3, {}, rows_end=2)
    assert tables.newest_at(1) == tables.stamp_at(1)
    assert tables.newest_at(2) not in {tables.stamp_at(place) for place in range(3)}
