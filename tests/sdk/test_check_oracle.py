"""What the sequences hold a driver to: small setpoints, the present row, the digits of a device."""

from __future__ import annotations

import math
import socket
import time
from collections.abc import Callable
from functools import partial

import numpy as np
import pytest

from rigd.sdk import Channel, Declaration, Row
from rigd.sdk.check import Observed, Peer, SentReading
from rigd.sdk.check.caller import RECEIVES, SENDS, hearing
from rigd.sdk.check.fast import lost, small_steps
from rigd.sdk.check.leaks import connections
from rigd.sdk.check.rows import Matching
from rigd.sdk.check.watching import Watcher

STEP = 0.004


def driven_by(device: Callable[[float], float], low: float, seed: int) -> list[tuple[float, float]]:
    declared = Declaration(setpoints=(Channel("speed", "m/s", "speed", low, 1.0),))
    return [(value, device(value)) for (value,) in small_steps(declared, seed)]


@pytest.mark.parametrize("low", [-1.0, 0.0])
def test_device_with_steps_is_no_fault(low: float) -> None:
    for seed in range(300):
        assert not list(lost(driven_by(lambda value: STEP * round(value / STEP), low, seed)))
        assert not list(lost(driven_by(lambda value: STEP * math.trunc(value / STEP), low, seed)))
        assert not list(lost(driven_by(lambda value: value * (1 + 1e-3), low, seed)))


@pytest.mark.parametrize("low", [-1.0, 0.0])
def test_small_setpoints_that_are_dropped_are_found(low: float) -> None:
    found = [
        any(lost(driven_by(lambda value: value if abs(value) > 0.005 else 0.0, low, seed)))
        for seed in range(100)
    ]
    assert sum(found) > 90


def test_time_since_when_something_holds_is_known() -> None:
    looks = iter([Observed(trips=1), Observed(trips=2), Observed(trips=2, energised=True)])
    watcher = Watcher(Peer(observed=partial(next, looks)))
    for _ in range(2):
        watcher.look()
    assert watcher.when(lambda look: look.trips == 2) == watcher.seen[1][0]


class KelvinRow(Row):
    temperature: float


THERMOMETER = Declaration(
    channels=(Channel("temperature", "K", "temperature", 200.0, 400.0),), row=KelvinRow
)


def kelvin(value: float) -> Row:
    return KelvinRow.of(temperature=value)


def matching(*values: float, ago_s: float = 0.0) -> Matching:
    readings: list[SentReading] = []
    known = Matching(Peer(readings=readings), THERMOMETER)
    readings += [SentReading(time.monotonic() - ago_s, {"temperature": value}) for value in values]
    return known


def test_row_in_single_precision_is_its_reading() -> None:
    shown = float(np.float32(300.15))
    assert not list(matching(300.15).newest_first(kelvin(shown), 1.0))


@pytest.mark.parametrize(
    ("row", "words"),
    [(300.0, "temperature is 300, and the device has sent 300.15"),
     (299.0, "temperature is 299, and the device has sent 300.15")],
)  # fmt: skip
def test_row_that_was_not_sent_is_named(row: float, words: str) -> None:
    known = matching(299.0, 300.15)
    assert not list(known.newest_first(kelvin(300.15), 1.0))
    known = matching(300.15)
    assert list(known.newest_first(kelvin(row), 1.0)) == [words]


def test_reading_gives_one_row_only() -> None:
    known = matching(299.0, 300.0)
    assert not list(known.newest_first(kelvin(300.0), 1.0))
    (problem,) = known.newest_first(kelvin(300.0), 1.0)
    assert problem == "a row comes, and the device has sent no reading since the 2 before"


def test_reading_of_long_ago_is_old() -> None:
    (problem,) = matching(300.0, ago_s=5.0).newest_first(kelvin(300.0), 1.0)
    assert problem == "a row shows what the device measured 5 s before"


def test_time_of_row_is_that_of_its_reading() -> None:
    stamp_s = time.monotonic() - 0.2
    (problem,) = matching(300.0).newest_first(kelvin(300.0), 1.0, stamp_s)
    assert problem == "the time of a row is 0.2 s from that of its reading"


def test_rows_in_turn_leave_no_reading_out() -> None:
    known = matching(299.0, 300.0, 301.0)
    problems = [problem for _, problem in known.in_turn([kelvin(299.0), kelvin(301.0)])]
    assert problems == ["", "temperature is 301, and the device has sent 300"]
    assert known.waiting == 1


def test_status_bit_is_compared_by_name() -> None:
    declared = Declaration(
        channels=THERMOMETER.channels,
        plain_rows=True,
        has_status=True,
        status_bits={"hot": 1, "open": 2},
    )
    for word, problems in ((2, []), (1, ["hot is 1, and the device has sent 0"])):
        readings: list[SentReading] = []
        known = Matching(Peer(readings=readings), declared)
        readings.append(SentReading(time.monotonic(), {"hot": 0, "open": 1}))
        assert list(known.newest_first((300.0, word), 1.0)) == problems


def test_what_is_sent_and_received_is_heard() -> None:
    one_end, other = socket.socketpair()
    heard: list[str] = []
    with one_end, other:
        with hearing(SENDS, partial(heard.append, "sent")):
            one_end.send(b"x")
            with hearing(RECEIVES, partial(heard.append, "received")):
                other.recv(1)
        one_end.send(b"y")
    assert heard == ["sent", "received"]


def test_connection_left_open_is_known_by_its_socket() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server, connections() as connected:
        for keeps in (True, False):
            connection = socket.create_connection(server.getsockname())
            if not keeps:
                connection.close()
    assert [each.fileno() >= 0 for each in connected] == [True, False]
    connected[0].close()
