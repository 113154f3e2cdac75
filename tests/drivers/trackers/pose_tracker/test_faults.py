"""What the driver makes of each fault that the simulated tracker can show."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import pytest
from support.instruments.pose_sender import free_port

from rigd.sdk.check import background_loop
from rigd_drivers.trackers.pose_tracker.driver import BodyConfig, BodyRow, PoseStatus, TrackedBody
from rigd_drivers.trackers.pose_tracker.link import PoseTracker, PoseTrackerConfig
from rigd_sim.wire.tracker import SimTracker

CART, OTHER = (0.25, -0.5, 1.5), (-0.25, 0.5, -1.5)
RATE_HZ = 100.0
LATENCY_S = 0.02


#: No test waits longer for rows, in s.
PATIENCE_S = 30.0
Rows = list[tuple[BodyRow, float]]
Until = Callable[[Rows], bool]


class Bench:
    """A simulated tracker on a loop of its own, and the driver before it."""

    def __init__(self, inject: Callable[..., None], body: TrackedBody, link: PoseTracker) -> None:
        self.inject = inject
        self.link = link
        self._body = body

    def rows(self, for_s: float, *, until: Until = lambda _: True) -> Rows:
        """Go through cycles of 2 ms; return the rows, each with its age in s.

        They end after ``for_s``, or later: as soon as the rows so far are as ``until`` asks.
        """
        found: Rows = []
        end_ns = time.monotonic_ns() + round(for_s * 1e9)
        last_ns = end_ns + round(PATIENCE_S * 1e9)
        while (t_ns := time.monotonic_ns()) < end_ns or not (until(found) or t_ns > last_ns):
            self.link.begin(t_ns)
            row = self._body.read(t_ns)
            if row is not None:
                assert self._body.taken_ns is not None
                found.append((row, (t_ns - self._body.taken_ns) * 1e-9))
            time.sleep(0.002)
        return found


@pytest.fixture
def bench() -> Iterator[Bench]:
    port = free_port()
    tracker = SimTracker(
        "tracker", "127.0.0.1", port, lambda frame, ago_s: {"cart": CART, "other": OTHER},
        rate_hz=RATE_HZ, latency_s=LATENCY_S,
    )  # fmt: skip
    link = PoseTracker(PoseTrackerConfig(port=port))
    body = TrackedBody(BodyConfig(body="cart"), link)

    with background_loop() as run:
        run(tracker.start())

        def inject(fault: str, **options: float) -> None:
            async def on_loop() -> None:
                tracker.inject(fault, **options)

            run(on_loop())

        try:
            link.open()
            body.open()
            found = Bench(inject, body, link)
            assert found.rows(0.4, until=bool)
            yield found
        finally:
            body.close()
            link.close()
            run(tracker.stop())


#: Fault -> whether rows go on, and what the account of the link names.
EXPECTED = {
    "silent": (False, ""),
    "lost": (False, ""),
    "exchanged": (True, ""),
    "dropped": (False, ""),
    "late": (False, ""),  # for the second that it takes by default
    "frozen": (False, "a frame twice"),
    "restarted": (False, "frames out of order"),
    "scale": (True, ""),
    "duplicate": (True, "a frame twice"),
    "reordered": (True, "frames out of order"),
    "garbage": (False, "not JSON"),
    "nan": (False, "not a number"),
    "field": (False, "a field is missing"),
    "unit": (False, "another unit"),
    "degrees": (False, "another unit"),
    "long": (False, "too long"),
    "stranger": (True, "from another host (127.0.0.2)"),
    "flood": (True, "not JSON"),
}


def test_every_fault_has_its_expectation() -> None:
    assert EXPECTED.keys() == SimTracker.faults.keys()


@pytest.mark.parametrize("fault", EXPECTED)
def test_fault_is_named_and_no_pose_made_up(bench: Bench, fault: str) -> None:
    goes_on, named = EXPECTED[fault]
    bench.inject(fault)
    for _ in range(20):  # what was under way
        if not bench.rows(0.05) or goes_on:
            break

    def is_seen(rows: Rows) -> bool:
        if named not in bench.link.account():
            return False
        if not goes_on:
            return True
        return any(not named or row.status & PoseStatus.UNREADABLE for row, _ in rows)

    rows = [row for row, _ in bench.rows(0.2, until=is_seen)]
    assert bool(rows) == goes_on
    assert named in bench.link.account()
    expected = {"exchanged": OTHER, "scale": (0.2625, -0.525, 1.5)}.get(fault, CART)
    assert {row[:3] for row in rows} <= {expected}
    if named and goes_on:
        assert any(row.status & PoseStatus.UNREADABLE for row in rows)


def test_late_poses_are_as_old_as_they_are(bench: Bench) -> None:
    bench.inject("late", delay_s=0.15)
    bench.rows(0.1)
    ages = [age for _, age in bench.rows(0.3, until=lambda rows: len(rows) > 5)]
    assert len(ages) > 5
    assert min(ages) > 0.145
