"""Events are numbered, and the newest are kept."""

from __future__ import annotations

import math

import pytest

from rigd.daemon.live.eventlog import ANSWER_BYTES, KEPT, MAX_DATA_BYTES, EventLog
from rigd.record.events.event import Event
from rigd.remote.protocol import encode


def test_events_are_numbered_and_found_again() -> None:
    log = EventLog()
    assert log.since(0) == []
    for number in range(5):
        told = log.add(Event(number, "step", 2, {"x": math.inf, "list": (1, None)}))
        assert (told.seq, told.t_ns, told.kind, told.trial) == (number, number, "step", 2)
        assert told.data == {"x": "inf", "list": [1, None]}
    assert [item.seq for item in log.since(3)] == [3, 4]
    assert log.since(5) == log.since(99) == []


def test_the_oldest_are_forgotten() -> None:
    log = EventLog()
    for number in range(KEPT + 10):
        log.add(Event(number, "step"))
    assert [item.seq for item in log.since(0)] == list(range(10, KEPT + 10))
    assert [item.seq for item in log.since(KEPT + 8)] == [KEPT + 8, KEPT + 9]


def test_an_answer_stays_within_a_message() -> None:
    log = EventLog()
    for number in range(100):
        log.add(Event(number, "long", data={"text": "x" * (MAX_DATA_BYTES - 20)}))
    first = log.since(0)
    assert 0 < len(first) <= ANSWER_BYTES // (MAX_DATA_BYTES - 100)
    assert log.since(first[-1].seq + 1)[0].seq == len(first)
    told = log.add(Event(0, "longer", data={"text": "µ" * MAX_DATA_BYTES}))
    assert "left_out" in told.data
    assert len(encode(told)) < 1000


def test_data_without_a_form_in_json_is_refused() -> None:
    log = EventLog()
    with pytest.raises(TypeError):
        log.add(Event(0, "odd", data={"what": object()}))
    assert log.next == 0
