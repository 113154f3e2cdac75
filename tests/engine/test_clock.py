"""The clock of a simulated rig at a pace, on a machine that computes slower than asked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import pytest
from support.engine.bench import PERIOD_NS, Axis, Bench, ListSink, move

from rigd.engine import clock
from rigd.engine.clock import RealClock, WallClock
from rigd.engine.play.control import Control
from rigd.engine.process.in_process import InProcessHost
from rigd.model.limits import Interlock
from rigd.model.severity import Severity
from rigd.procedure.program import Recorded

S = 1_000_000_000
SLEW = 60_000  #: by which every sleep of the wall is late, in ns, as on Linux


@dataclass
class Wall:
    """A wall clock that only moves when somebody sleeps or computes."""

    ns: int = 5 * S

    def monotonic_ns(self) -> int:
        return self.ns

    def time_ns(self) -> int:
        return 1_700_000_000 * S + self.ns

    def sleep(self, seconds: float) -> None:
        self.ns += round(seconds * 1e9) + SLEW


@pytest.fixture
def wall(monkeypatch: pytest.MonkeyPatch) -> Wall:
    wall = Wall()
    monkeypatch.setattr(clock, "time", wall)
    monkeypatch.setattr("rigd.engine.process.in_process.monotonic_ns", wall.monotonic_ns)
    return wall


class Plant(Axis):
    """An axis that takes the wall ``cost_ns`` for each period that it integrates, gaps included."""

    def __init__(self, wall: Wall, cost_ns: int) -> None:
        super().__init__()
        self._wall, self._cost_ns = wall, cost_ns
        self.times_ns: list[int] = []

    def read(self, t_ns: int) -> Sequence[float] | None:
        periods = 1 if not self.times_ns else (t_ns - self.times_ns[-1]) // PERIOD_NS
        self._wall.ns += periods * self._cost_ns
        self.position += (periods - 1) * self.speed * PERIOD_NS * 1e-9
        self.times_ns.append(t_ns)
        return super().read(t_ns)


def paced(plant: Plant, pace: float, told: list[float], bench: Bench) -> InProcessHost:
    cycle = bench.cycle()
    cycle.clock = WallClock(PERIOD_NS, pace, on_slower=told.append)
    record = {stream.name: Recorded() for stream in cycle.rig.streams}
    return InProcessHost(cycle, cycle.clock, virtual=False, sink=bench.sink, record=record)


def bench_of(plant: Plant, high: float) -> Bench:
    far = Interlock("far", "axis.position", high=high, action=Severity.ABORT, message="far")
    return Bench(axis=plant, interlocks=(far,), sink=ListSink(), control=Control())


def test_pace_beyond_machine_slips_and_says_so(wall: Wall) -> None:
    """Each period costs a quarter of the time that it has at pace 1: four times is reached."""
    plant, told = Plant(wall, PERIOD_NS // 4), list[float]()
    bench = bench_of(plant, high=30.5)
    host = paced(plant, 20.0, told, bench)
    began_ns = wall.ns
    assert host.play(move("go", 1.0, 30.0)).severity is Severity.DONE
    steps = {after - before for before, after in pairwise(plant.times_ns)}
    assert steps == {PERIOD_NS}  # no step of the plant is longer than a cycle, none is missed
    assert host.counters.missed == 0
    assert host.trips == []
    assert (wall.ns - began_ns) / S == pytest.approx(30.0 / 4, rel=0.02)
    assert told == [pytest.approx(4.0, rel=0.02)]  # once


def test_signal_acts_in_next_cycle_of_slow_machine(wall: Wall) -> None:
    plant, told = Plant(wall, PERIOD_NS), list[float]()
    bench = bench_of(plant, high=100.0)
    host = paced(plant, 100.0, told, bench)
    asked_ns: list[int] = []

    def person() -> None:
        if plant.position > 1.0 and not asked_ns:
            asked_ns.append(wall.ns)
            bench.control.request(Severity.STOP, "stopped by Ctrl-C")

    host.on_drain = person
    assert host.play(move("go", 1.0, 3600.0)).severity is Severity.STOP
    assert wall.ns - asked_ns[0] < S


def test_operator_is_told_while_slow_plant_computes(wall: Wall) -> None:
    """A second of the wall for each cycle: progress does not wait for a drain of 50 cycles."""
    plant = Plant(wall, S)
    host = paced(plant, 2.0, [], bench_of(plant, high=100.0))
    shown: list[int] = []
    host.on_drain = lambda: shown.append(wall.ns)
    assert host.play(move("go", 1.0, 0.03)).severity is Severity.DONE
    assert len(shown) >= 20


@pytest.mark.parametrize("pace", [0.5, 2.0, 20.0])
def test_pace_is_kept_over_short_stalls(wall: Wall, pace: float) -> None:
    slots = WallClock(PERIOD_NS, pace, on_slower=lambda reached: pytest.fail(f"told {reached}"))
    slots.next_slot()
    began_ns = wall.ns
    for count in range(1, 20_000):
        if count % 2000 == 0:
            wall.ns += clock.CATCH_UP_NS - 1_000_000  # a stall
        assert slots.next_slot() == count
        assert slots.now() >= count * PERIOD_NS
    assert (wall.ns - began_ns) * pace == pytest.approx(20_000 * PERIOD_NS, rel=0.02)


def test_stall_beyond_catch_up_is_not_made_up(wall: Wall) -> None:
    slots = WallClock(PERIOD_NS, 1.5)
    slots.next_slot()
    wall.ns += 60 * S
    assert slots.next_slot() == 1
    slots.next_slot()
    before_ns = wall.ns
    assert slots.next_slot() == 3
    assert wall.ns - before_ns >= PERIOD_NS / 1.5 - 1  # at its pace again, no burst


def test_real_devices_miss_cycles_in_a_stall(wall: Wall) -> None:
    slots = RealClock(PERIOD_NS, wall.time_ns(), wall.monotonic_ns())
    assert slots.next_slot() == 1
    wall.ns += 5 * PERIOD_NS
    assert slots.next_slot() == 6
