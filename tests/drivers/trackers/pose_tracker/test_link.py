"""Rows have the time of their frame, and what cannot be used is counted and named."""

from __future__ import annotations

import json
import re
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from support.faults.stalls import standing_still
from support.instruments.pose_sender import POSE, free_port, line

from rigd.sdk import DeviceError, LinkError
from rigd_drivers.trackers.pose_tracker.driver import BodyConfig, PoseStatus, TrackedBody
from rigd_drivers.trackers.pose_tracker.link import SETTLING_NS, PoseTracker, PoseTrackerConfig

MS = 1_000_000
#: Time of the cycle, and of the camera, at frame 0.
START_NS, CAMERA_S = 1_700_000_000_000_000_000, 50.0
PERIOD_MS = 40
#: CLOCK_MONOTONIC then: cycles have another zero.
BOOTED_NS = 5_000_000_000_000
#: Frames that are over when the first rows come.
SETTLED = 20
#: A crowded machine reads what came within this, in s.
PATIENCE_S = 60.0
#: Another address of this machine.
STRANGER = "127.0.0.2"


class Bench:
    """A link with bodies `cart` and `other` on it, and a tracker whose datagrams the test sends."""

    def __init__(self, **options: Any) -> None:
        self.port = free_port()
        self._sockets = {host: self._sender(host) for host in ("127.0.0.1", STRANGER)}
        config = PoseTrackerConfig.model_validate({"port": self.port} | options)
        self._now_ns = at(1, 10) - START_NS + BOOTED_NS
        self.link = PoseTracker(config, lambda: self._now_ns)
        begin = self.link.begin

        def begun(t_ns: int) -> None:
            self._now_ns = t_ns - START_NS + BOOTED_NS
            begin(t_ns)

        vars(self.link)["begin"] = begun
        self.link.open()
        for frame in (0, 1):
            self.send(self.frame(frame))
        self.cart, self.other = (self._body(name) for name in ("cart", "other"))
        self.link.begin(START_NS)

    @staticmethod
    def _sender(host: str) -> socket.socket:
        own = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        own.bind((host, 0))
        return own

    def _body(self, name: str) -> TrackedBody:
        body = TrackedBody(BodyConfig(body=name), self.link)
        body.open()
        return body

    def frame(self, number: int, **fields: Any) -> bytes:
        whole: dict[str, Any] = {"frame": number, "time": CAMERA_S + number * PERIOD_MS * 1e-3}
        whole["bodies"] = {"cart": POSE, "other": POSE}
        return line(**whole | fields)

    def send(self, data: bytes, host: str = "127.0.0.1") -> None:
        self._sockets[host].sendto(data, ("127.0.0.1", self.port))

    def settle(self) -> None:
        """Let frames come, each 10 ms after its exposure, until rows are given."""
        for number in range(2, SETTLED):
            self.come(number, 10)
        while self.cart.read(at(SETTLED, 0)) is not None:
            self.other.read(at(SETTLED, 0))

    def come(self, number: int, delay_ms: int, **fields: Any) -> None:
        """Let a frame come ``delay_ms`` after its exposure."""
        self.send(self.frame(number, **fields))
        self.link.begin(at(number, delay_ms))

    def close(self) -> None:
        self.cart.close()
        self.other.close()
        self.link.close()
        for own in self._sockets.values():
            own.close()


def at(number: int, delay_ms: int) -> int:
    """Return the time of the cycle so long after the exposure of a frame, in ns."""
    return START_NS + (number * PERIOD_MS + delay_ms) * MS


@contextmanager
def opened(**options: Any) -> Iterator[Bench]:
    bench = Bench(**options)
    try:
        yield bench
    finally:
        bench.close()


@pytest.fixture
def bench() -> Iterator[Bench]:
    with opened() as found:
        found.settle()
        yield found


def test_rows_have_the_pace_of_the_camera(bench: Bench) -> None:
    times = []
    for number, delay_ms in enumerate([10, 11, 35, 12, 300, 14, 10], SETTLED):
        bench.send(bench.frame(number))
        bench.link.begin(at(number, delay_ms))
        row = bench.cart.read(at(number, delay_ms))
        assert row is not None
        assert row.frame == number
        times.append(bench.cart.taken_ns)
    expected = [at(number, 10) for number in range(SETTLED, SETTLED + 7)]
    assert times == pytest.approx(expected, abs=0.1 * MS)  # 0.2 ms per s of drift is allowed for


def test_known_latency_is_subtracted() -> None:
    with opened(latency="10 ms") as bench:
        bench.settle()
        bench.come(SETTLED, 10)
        assert bench.cart.read(at(SETTLED, 10)) is not None
        assert bench.cart.taken_ns == pytest.approx(at(SETTLED, 0), abs=0.1 * MS)


def test_pose_that_comes_late_is_old(bench: Bench) -> None:
    for number in range(SETTLED, SETTLED + 10):  # a second late, for four seconds
        bench.send(bench.frame(number))
        bench.link.begin(at(number, 1010))
        assert bench.cart.read(at(number, 1010)) is not None
        assert bench.cart.taken_ns is not None
        assert at(number, 1010) - bench.cart.taken_ns > 998 * MS


def test_delay_seen_at_opening_holds_in_cycles() -> None:
    with opened() as bench:
        for number in range(2, SETTLED):  # all that a cycle takes is a second late
            bench.come(number, 1010)
        assert bench.cart.read(at(SETTLED, 1010)) is not None
        assert bench.cart.taken_ns is not None
        assert bench.cart.taken_ns <= at(SETTLED, 12)


def test_tracker_begun_anew_before_cycles_has_new_zero() -> None:
    with opened() as bench:
        before = bench.link.good
        bench.send(bench.frame(0, time=6.99))  # 10 ms before it comes
        assert bench.link.listen(lambda: bench.link.good > before, 5.0)
        for number in range(2, SETTLED):
            bench.come(number, 10, time=7.0 + number * PERIOD_MS * 1e-3)
        times = []
        while bench.cart.read(at(SETTLED, 0)) is not None:
            times.append(bench.cart.taken_ns)
        assert times[-1] == pytest.approx(at(SETTLED - 1, 10), abs=0.1 * MS)


def test_nothing_is_believed_before_it_settled() -> None:
    with opened() as bench:
        for number in range(2, SETTLING_NS // MS // PERIOD_MS):
            bench.come(number, 5)
            assert bench.cart.read(at(number, 5)) is None


def test_frame_of_a_stall_is_heard(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    stall, before, looks = standing_still(monkeypatch), bench.link.good, []

    def heard() -> bool:
        looks.append(bench.link.good)
        if len(looks) == 1:  # this computer stands still while nobody looks
            stall()
            bench.send(bench.frame(2))
        return bench.link.good > before

    assert bench.link.listen(heard, 0.1)


def test_all_poses_of_a_stall_are_rows(bench: Bench) -> None:
    for number in range(SETTLED, SETTLED + 8):
        bench.send(bench.frame(number))
    bench.link.begin(at(SETTLED + 8, 0))
    rows = [bench.cart.read(at(SETTLED + 8, cycle)) for cycle in range(9)]
    assert [row and row.frame for row in rows] == [*range(SETTLED, SETTLED + 8), None]
    assert {row.status for row in rows if row is not None} == {0}


def test_bodies_of_a_frame_have_one_time(bench: Bench) -> None:
    bench.come(SETTLED, 12, bodies={"cart": POSE})
    bench.come(SETTLED, 19, bodies={"other": POSE})
    for body in (bench.cart, bench.other):
        assert body.read(at(SETTLED, 19)) is not None
    assert bench.cart.taken_ns == bench.other.taken_ns


def test_frame_without_the_body_gives_no_row(bench: Bench) -> None:
    bench.come(SETTLED, 10, bodies={"cart": None, "other": POSE})
    assert bench.cart.read(at(SETTLED, 10)) is None
    assert bench.other.read(at(SETTLED, 10)) is not None
    bench.come(SETTLED + 3, 10)
    row = bench.cart.read(at(SETTLED + 3, 10))
    assert row is not None
    assert row.status == PoseStatus.LOST | PoseStatus.MISSED


def test_pose_of_low_quality_counts_as_lost(bench: Bench) -> None:
    careful = BodyConfig(body="careful", least_quality=0.5)
    bench.send(bench.frame(SETTLED, bodies={"careful": POSE}))
    body = TrackedBody(careful, bench.link)
    body.open()
    for number, quality in ((SETTLED + 1, 0.4), (SETTLED + 2, 0.6)):
        bench.come(number, 10, bodies={"careful": POSE | {"quality": quality}})
    row = body.read(at(SETTLED + 2, 10))
    assert row is not None
    assert (row.frame, row.status) == (SETTLED + 2, PoseStatus.LOST)


def spoilt(old: bytes, new: bytes) -> Callable[[Bench], bytes]:
    def data(bench: Bench) -> bytes:
        whole = bench.frame(SETTLED)
        assert old in whole
        return whole.replace(old, new)

    return data


def changed(**fields: Any) -> Callable[[Bench], bytes]:
    return lambda bench: bench.frame(SETTLED, **fields)


@pytest.mark.parametrize(
    ("data", "named"),
    [
        (spoilt(b"}}", b"}"), "not JSON"),
        (spoilt(b'"x"', b'\xff"x"'), "not JSON"),
        (lambda bench: b"[" * 5000, "not JSON"),
        (lambda bench: b"[1, 2]", "not an object"),
        (spoilt(b"0.25", b"NaN"), "not a number"),
        (spoilt(b"0.25", b"1e999"), "not a number"),
        (spoilt(b"0.25", b"1" + b"0" * 400), "not a number"),
        (spoilt(b"0.25", b"true"), "not a number"),
        (spoilt(b'"x"', b'"z"'), "a field is missing"),
        (changed(frame=None), "a field is missing"),
        (changed(time=None), "a field is missing"),
        (changed(format="poses-2"), "another format"),
        (changed(units=["mm", "deg"]), "another unit"),
        (changed(bodies={"cart": POSE | {"heading": 86.0}}), "another unit"),
        (changed(bodies={"cart": POSE | {"x": 250.0}}), "beyond reach"),
        (changed(bodies={"cart": POSE | {"quality": 98}}), "no quality"),
        (changed(bodies=[POSE]), "no bodies"),
        (changed(frame=1.5), "no frame number"),
        (changed(time=1e300), "no time"),
        (changed(time=CAMERA_S), "a time that goes back"),
        (lambda bench: bench.frame(SETTLED - 1), "a frame twice"),
        (lambda bench: bench.frame(SETTLED - 2), "frames out of order"),
        (lambda bench: bench.frame(SETTLED) + b" " * 9000, "too long"),
    ],
)
def test_bad_datagram_is_named_and_gives_no_row(
    bench: Bench, data: Callable[[Bench], bytes], named: str
) -> None:
    bench.send(data(bench))
    bench.link.begin(at(SETTLED, 10))
    assert bench.cart.read(at(SETTLED, 10)) is None
    assert re.search(rf"others: [12] {named}", bench.link.account())  # of one body, or of both
    bench.come(SETTLED + 1, 10)
    row = bench.cart.read(at(SETTLED + 1, 10))
    assert row is not None
    assert row.status & PoseStatus.UNREADABLE
    assert row.status >> 16 in (1, 2)


@pytest.mark.parametrize("options", [{}, {"sender": "127.0.0.1"}])
def test_another_host_is_not_heard(options: dict[str, Any]) -> None:
    with opened(**options) as bench:
        bench.settle()
        bench.send(bench.frame(SETTLED), STRANGER)
        bench.link.begin(at(SETTLED, 10))
        assert bench.cart.read(at(SETTLED, 10)) is None
        assert f"1 from another host ({STRANGER})" in bench.link.account()


def test_flood_neither_delays_nor_forges(bench: Bench) -> None:
    for _ in range(40):
        bench.send(b"?" * 64)
    bench.send(bench.frame(SETTLED))
    rows = []
    for cycle in range(4):
        bench.link.begin(at(SETTLED, 10 + cycle))
        rows.append(bench.cart.read(at(SETTLED, 10 + cycle)))
    assert [row is None for row in rows] == [True, True, False, True]
    assert bench.cart.taken_ns == pytest.approx(at(SETTLED, 10), abs=0.1 * MS)
    assert "40 not JSON" in bench.link.account()
    assert "2 times too many in a cycle" in bench.link.account()


def test_idle_link_is_read_and_gives_no_row(bench: Bench) -> None:
    bench.link.idle()
    before, deadline = bench.link.good, time.monotonic() + PATIENCE_S
    for number in range(SETTLED, SETTLED + 10):
        bench.send(bench.frame(number))
        while bench.link.good <= before + number - SETTLED:
            assert time.monotonic() < deadline
    bench.link.begin(at(SETTLED + 10, 0))
    assert bench.cart.read(at(SETTLED + 10, 0)) is None
    assert bench.link.lost == 0


def test_datagrams_lost_unread_are_named(bench: Bench) -> None:
    for number in range(SETTLED, SETTLED + 5000):
        bench.send(bench.frame(number))
    lost = bench.link.lost
    assert lost > 0
    assert f"{lost} lost, since this computer did not take them in" in bench.link.account()


def test_silent_body_is_named_with_what_came(bench: Bench) -> None:
    end = at(SETTLED, 0) + 2_000 * MS
    for number in range(SETTLED, SETTLED + 40):
        bench.come(number, 10, bodies={"cart": None, "other": POSE})
        bench.cart.read(at(number, 10))
    with pytest.raises(DeviceError, match=r"no pose of body 'cart' for 2 s \(in 40 of \d+ frames"):
        bench.cart.read(end)


def test_tracker_that_began_again_is_named(bench: Bench) -> None:
    for number in range(50):
        restarted = line(frame=number, time=number * 0.04, bodies={"cart": POSE})
        bench.send(restarted)
        bench.link.begin(at(SETTLED + number, 10))
        if number < 45:
            assert bench.cart.read(at(SETTLED + number, 10)) is None or number >= SETTLED
    with pytest.raises(DeviceError, match="out of order"):
        bench.cart.read(at(SETTLED + 500, 0))


def test_body_that_is_not_sent_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rigd_drivers.trackers.pose_tracker.driver.OPEN_S", 0.1)
    with opened() as bench:
        body = TrackedBody(BodyConfig(body="rear"), bench.link)
        with pytest.raises(LinkError, match=r"no frames with body 'rear'.*bodies: cart, other"):
            body.open()
        bench.send(json.dumps({"format": "poses-1"}).encode())
        with pytest.raises(LinkError, match="1 a field is missing"):
            body.open()


def test_one_body_is_of_one_device() -> None:
    with opened() as bench, pytest.raises(LinkError, match="another device has body 'cart'"):
        TrackedBody(BodyConfig(body="cart"), bench.link).open()
