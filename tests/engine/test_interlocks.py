"""Interlocks trip on limits, on NaN and on silence, and clear as in the alarm model."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigd.engine.play.interlocks import InterlockBank, Trip
from rigd.model.limits import Interlock
from rigd.model.severity import Severity

MS = 1_000_000
READINGS = {"a.x": 0, "a.limit": 1}
UNITS = {"a.x": "m", "a.limit": "m"}


def bank(interlock: Interlock) -> InterlockBank:
    return InterlockBank([interlock], READINGS, UNITS, [0, 0])


def feed(
    interlock_bank: InterlockBank, values: list[float], *, limit: float = 0.0, fresh: bool = True
) -> list[list[Trip]]:
    return [
        interlock_bank.check(k * MS, [value, limit], [k * MS if fresh else 0])
        for k, value in enumerate(values)
    ]


def test_interlock_trips_once_naming_value_limit_and_unit() -> None:
    trips = feed(bank(Interlock("far", "a.x", high=1.5)), [1.4, 1.5, 1.6, 1.7])
    assert [len(trip) for trip in trips] == [0, 0, 1, 0]
    assert trips[2][0].reason == "a.x 1.6 m is above its limit 1.5 m"


def test_violation_in_its_delay_has_a_reason() -> None:
    found = bank(Interlock("far", "a.x", high=1.5, delay_s=1.0, action=Severity.STOP))
    assert feed(found, [1.4, 1.6]) == [[], []]
    ((interlock, reason),) = found.violated(Severity.END_TRIAL)
    assert interlock.name == "far"
    assert reason == "a.x 1.6 m is above its limit 1.5 m"


def test_low_limit_and_limit_from_another_channel() -> None:
    found = bank(Interlock("behind", "a.x", low="a.limit"))
    assert feed(found, [0.3], limit=0.2) == [[]]
    (trip,) = feed(found, [0.1], limit=0.2)[0]
    assert trip.reason == "a.x 0.1 m is below its limit 0.2 m"


def test_delay_needs_an_unbroken_violation() -> None:
    delayed = Interlock("far", "a.x", high=1.0, delay_s=0.003)
    assert not any(feed(bank(delayed), [2, 2, 2, 0, 2, 2, 2, 0]))
    assert [len(item) for item in feed(bank(delayed), [2, 2, 2, 2])] == [0, 0, 0, 1]


@pytest.mark.parametrize("limit", [Interlock("i", "a.x", high=1.0, delay_s=10.0)])
def test_nan_trips_at_once_with_any_delay(limit: Interlock) -> None:
    (trip,) = feed(bank(limit), [math.nan])[0]
    assert "not a number" in trip.reason


def test_nan_trips_without_bounds_and_as_bound() -> None:
    assert feed(bank(Interlock("alive", "a.x")), [math.nan])[0]
    assert feed(bank(Interlock("far", "a.x", high="a.limit")), [0.0], limit=math.nan)[0]


def test_stale_data_trips_with_any_value_and_delay() -> None:
    found = bank(Interlock("alive", "a.x", delay_s=10.0, stale_after_s=0.002))
    trips = feed(found, [0.0] * 5, fresh=False)
    assert [len(t) for t in trips] == [0, 0, 0, 1, 0]
    assert "a.x is stale: its last row is 3 ms old, at most 2 ms" in trips[3][0].reason


def test_a_bound_that_is_stale_bounds_nothing() -> None:
    low = Interlock("behind", "a.x", low="b.limit", stale_after_s=0.002)
    found = InterlockBank([low], {"a.x": 0, "b.limit": 1}, UNITS, [0, 1])
    trips = [found.check(k * MS, [1.0, 0.0], [k * MS, 0]) for k in range(5)]
    assert [len(t) for t in trips] == [0, 0, 0, 1, 0]
    assert "a bound of a.x is stale: its last row is 3 ms old" in trips[3][0].reason


def test_clears_only_deadband_inside_and_can_trip_again() -> None:
    found = bank(Interlock("far", "a.x", high=1.0, deadband=0.1))
    trips = feed(found, [1.1, 0.95, 1.1, 0.85, 1.1])
    assert [len(t) for t in trips] == [1, 0, 0, 0, 1]


def test_a_latched_trip_stands_until_acknowledged() -> None:
    found = bank(Interlock("far", "a.x", high=1.0, latch=True))
    assert [len(t) for t in feed(found, [1.1, 0.0, 1.1])] == [1, 0, 0]
    assert [i.name for i in found.active()] == ["far"]
    found.acknowledge("far")
    assert not found.active()
    assert len(feed(found, [1.1])[0]) == 1
    with pytest.raises(KeyError):
        found.acknowledge("no such interlock")


@given(
    value=st.floats(allow_nan=True, allow_infinity=True),
    low=st.one_of(st.none(), st.floats(-5, 0)),
    high=st.one_of(st.none(), st.floats(0, 5)),
)
def test_without_delay_value_outside_trips_exactly(
    value: float, low: float | None, high: float | None
) -> None:
    trips = feed(bank(Interlock("i", "a.x", low=low, high=high)), [value])[0]
    above_low = low is None or value >= low
    below_high = high is None or value <= high
    inside = above_low and below_high and not math.isnan(value)
    assert bool(trips) is not inside


@pytest.mark.parametrize(
    ("high", "values", "fresh", "told"),
    [
        (1.0, [2.0], True, "It moves too far."),
        (1.0, [math.nan], True, ""),
        (1.0, [0.0] * 60, False, ""),
        (None, [math.nan], True, "It moves too far."),  # speaks of nothing but silence
    ],
)
def test_meaning_of_bounds_stands_only_beyond_them(
    high: float | None, values: list[float], fresh: bool, told: str
) -> None:
    found = bank(Interlock("far", "a.x", high=high, message="It moves too far."))
    (trip,) = (trip for trips in feed(found, values, fresh=fresh) for trip in trips)
    assert trip.message == told
