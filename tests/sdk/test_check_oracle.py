"""What the sequences hold a driver to: small setpoints, the present row, the digits of a device."""

from __future__ import annotations

import random
import shutil
import socket
import time
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np
import pytest

from rigd.sdk import Channel, Declaration, Row
from rigd.sdk.check import Observed, Peer, SentReading
from rigd.sdk.check.caller import RECEIVES, SENDS, hearing
from rigd.sdk.check.cyclic.sequences import near
from rigd.sdk.check.leaks import opens
from rigd.sdk.check.rows import Matching, drawn_values
from rigd.sdk.check.watching import HeldTime, Watcher

SPEED = Channel("speed", "m/s", "speed", -1.0, 1.0)


@pytest.mark.parametrize(
    ("step", "value", "wanted"),
    [(None, 0.503, 0.5), (0.01, 0.50, 0.509), (0.01, 0.51, 0.5011), (0.0, 0.1 + 1e-9, 0.1)],
)
def test_what_a_device_rounds_is_near(step: float | None, value: float, wanted: float) -> None:
    assert near(SPEED, value, wanted, step)


@pytest.mark.parametrize(
    ("step", "value", "wanted"), [(None, 0.51, 0.5), (0.001, 0.5, 0.502), (0.0, 0.0, 1e-4)]
)
def test_setpoint_finer_than_its_steps_is_demanded(
    step: float | None, value: float, wanted: float
) -> None:
    assert not near(SPEED, value, wanted, step)


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


#: Its threads never wait for a processor.
FREE: Final = Path("no-threads")


def matching(
    *values: float, ago_s: float = 0.0, held: HeldTime | None = None, taken_s: float | None = None
) -> Matching:
    """Return one whose clock stands ``ago_s`` after the readings: no stall changes a number."""
    now_s = [time.monotonic() if taken_s is None else taken_s]
    readings: list[SentReading] = []
    peer = Peer(readings=readings)
    known = Matching(peer, THERMOMETER, held or HeldTime(FREE), lambda: now_s[0])
    readings += [SentReading(now_s[0], {"temperature": value}) for value in values]
    now_s[0] += ago_s
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


def queue(folder: Path, **waited_s: float) -> None:
    """Have threads, by their numbers, have waited for a processor for so long."""
    for thread, each_s in waited_s.items():
        (folder / thread).mkdir(exist_ok=True)
        (folder / thread / "schedstat").write_text(f"7 {each_s * 1e9:.0f} 3\n")


def test_row_may_be_old_as_threads_waited(tmp_path: Path) -> None:
    queue(tmp_path, t1=3.0, t2=0.0)
    held = HeldTime(tmp_path)
    known = matching(300.0, ago_s=5.0, held=held)
    queue(tmp_path, t1=3.0, t2=9.0)
    assert not list(known.newest_first(kelvin(300.0), 0.0))


def test_what_threads_waited_before_excuses_no_row(tmp_path: Path) -> None:
    queue(tmp_path, t1=0.0)
    held = HeldTime(tmp_path)
    queue(tmp_path, t1=9.0)
    held.look()
    (problem,) = matching(300.0, ago_s=5.0, held=held).newest_first(kelvin(300.0), 0.0)
    assert problem == "a row shows what the device measured 5 s before"


def test_row_that_was_old_before_run_stays_so(tmp_path: Path) -> None:
    queue(tmp_path, t1=0.0)
    known = matching(300.0, ago_s=5.0, held=HeldTime(tmp_path))
    queue(tmp_path, t1=9.0)
    known.begin_run()
    (problem,) = known.newest_first(kelvin(300.0), 1.0)
    assert problem == "a row shows what the device measured 5 s before"


def test_held_time_keeps_that_of_ended_threads(tmp_path: Path) -> None:
    began_s = time.monotonic()
    queue(tmp_path, t1=5.0, t2=1.0)
    held = HeldTime(tmp_path)
    queue(tmp_path, t1=6.0, t2=3.0, t3=0.5)
    held.look()
    shutil.rmtree(tmp_path / "t2")
    queue(tmp_path, t1=7.0)
    assert held.since(began_s) == pytest.approx(4.5)


def test_machine_that_holds_back_stalls_sequence(tmp_path: Path) -> None:
    watcher = Watcher(Peer())
    watcher.held = HeldTime(tmp_path)
    assert not watcher.stalls(60.0)
    queue(tmp_path, t1=3600.0)
    assert watcher.stalls(60.0)


def test_time_of_row_is_that_of_its_reading() -> None:
    known = matching(300.0, taken_s=100.0)
    (problem,) = known.newest_first(kelvin(300.0), 1.0, 99.8)
    assert problem == "the time of a row is 0.2 s from that of its reading"


def test_rows_in_turn_leave_no_reading_out() -> None:
    known = matching(299.0, 300.0, 301.0)
    problems = [problem for _, problem in known.compare_next([kelvin(299.0), kelvin(301.0)])]
    assert problems == ["", "temperature is 301, and the device has sent 300"]
    assert known.waiting == 1


def test_drawn_temperatures_lie_about_the_ice_point() -> None:
    rng = random.Random(1)
    degrees = [drawn_values(THERMOMETER, rng)["temperature"] - 273.15 for _ in range(200)]
    assert min(degrees) < -50.0
    assert max(degrees) > 50.0
    close = [value for value in degrees if abs(value) < 1.0]
    assert len([value for value in close if value < -0.01]) > 5
    assert len([value for value in close if value > 0.01]) > 5


def test_status_bit_is_compared_by_name() -> None:
    declared = Declaration(
        channels=THERMOMETER.channels,
        plain_rows=True,
        has_status=True,
        status_bits={"hot": 1, "open": 2},
    )
    for word, problems in ((2, []), (1, ["hot is 1, and the device has sent 0"])):
        readings: list[SentReading] = []
        known = Matching(Peer(readings=readings), declared, HeldTime())
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
    with socket.create_server(("127.0.0.1", 0)) as server, opens() as opened:
        for keeps in (True, False):
            connection = socket.create_connection(server.getsockname())
            if not keeps:
                connection.close()
    connected = [each.connected for each in opened if each.connected is not None]
    assert [each.fileno() >= 0 for each in connected] == [True, False]
    connected[0].close()
