"""What the sequences hold a driver to: small setpoints, the present row, the digits of a device."""

from __future__ import annotations

import math
import random
import socket
from collections.abc import Callable
from functools import partial

import pytest

from rigd.sdk import Channel, Declaration, Row
from rigd.sdk.check import Observed, Peer
from rigd.sdk.check.caller import RECEIVES, SENDS, hearing
from rigd.sdk.check.fast import lost, small_steps
from rigd.sdk.check.leaks import connections
from rigd.sdk.check.rows import Truth, untrue
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


def test_row_of_the_reading_before_is_old() -> None:
    looks = iter(
        [
            Observed(measured={"status": 1}, sent=1),
            Observed(measured={"status": 0}, sent=2),
            Observed(measured={"status": 0}, sent=2, energised=True),
        ]
    )
    watcher = Watcher(Peer(observed=partial(next, looks)))
    for _ in range(2):
        watcher.look()
    now_s = watcher.seen[-1][0]
    assert [look.sent for look in watcher.since_reading(now_s)] == [2, 2]
    assert watcher.at(now_s - 1e3).sent == 1
    assert watcher.when(lambda look: look.sent == 2) == watcher.seen[1][0]


class KelvinRow(Row):
    temperature: float


THERMOMETER = Declaration(
    channels=(Channel("temperature", "K", "temperature", 200.0, 400.0),), row=KelvinRow
)


def test_offset_is_found_once_resolution_is_known() -> None:
    shown = {"temperature": 293.15}

    def show(values: object) -> None:
        shown["temperature"] = round(dict(values)["temperature"] - 273.15, 2) + 273.15  # type: ignore[call-overload]

    peer = Peer(measure=show, observed=lambda: Observed(measured=dict(shown)))
    truth, rng = Truth(), random.Random(1)
    off = KelvinRow.of(temperature=300.0)
    assert not list(untrue(THERMOMETER, off, [{"temperature": 300.15}], truth.rooms))
    for _ in range(5):
        truth.measure(peer, THERMOMETER, [rng.uniform(250.0, 350.0)])
    (problem,) = untrue(THERMOMETER, off, [{"temperature": 300.15}], truth.rooms)
    assert problem == "temperature is 300 K, and the device measures 300.15"
    assert not list(untrue(THERMOMETER, off, [{"temperature": 300.0}], truth.rooms))


@pytest.mark.parametrize("wrong", [lambda value: 1.01 * value, lambda value: value - 0.15])
def test_same_error_each_time_is_found(wrong: Callable[[float], float]) -> None:
    truth, rng = Truth(), random.Random(1)
    found: list[str] = []
    for _ in range(12):
        value = rng.uniform(250.0, 350.0)
        row = KelvinRow.of(temperature=wrong(value))
        found += truth.problems(THERMOMETER, row, [{"temperature": value}])
    assert "temperature is off by " in found[0]


@pytest.mark.parametrize("step", [0.0, 1e-4, 0.1, 1.0])
def test_resolution_of_a_device_is_no_error(step: float) -> None:
    for seed in range(20):
        truth, rng = Truth(), random.Random(seed)
        for _ in range(40):
            value = rng.uniform(250.0, 350.0)
            shown = step * math.floor(value / step) if step else value
            row = KelvinRow.of(temperature=shown)
            assert not list(truth.problems(THERMOMETER, row, [{"temperature": value}]))


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
