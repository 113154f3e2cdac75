"""A block device on the plant: every row is recorded, the newest is seen, all in virtual time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from support.engine.grid import PERIOD_NS, ClockPlant, Grid, PlantGrid, rig

from rigd.config.rig import RigConfig
from rigd.engine.clock import VirtualClock
from rigd.engine.cycle.plant_blocks import PlantBlocks
from rigd.engine.cycle.wiring import streams_of, wire
from rigd.engine.play.control import Control
from rigd.engine.process.in_process import InProcessHost
from rigd.engine.sink import Rows
from rigd.model.errors import Blocked
from rigd.model.limits import Interlock
from rigd.model.severity import Severity
from rigd.procedure.program import (
    Comparison,
    Condition,
    CycleProgram,
    Recorded,
    Segment,
)
from rigd.sdk import PlantConfig

START_NS = 1_000_000_000_000_000_000
ROW_NS, LATENCY_NS = 500_000, 3_000_000
ALL = {"grid": Recorded(), "cycle": Recorded()}


@dataclass
class Kept:
    """Keeps rows and events."""

    rows: dict[str, list[Rows]] = field(default_factory=dict)
    events: list[tuple[int, str, Mapping[str, object]]] = field(default_factory=list)

    def write(self, stream: str, rows: Rows) -> None:
        self.rows.setdefault(stream, []).append(rows)

    def event(self, t_ns: int, kind: str, trial: int, data: Mapping[str, object]) -> None:
        self.events.append((t_ns, kind, data))

    def flush(self, *, complete: bool = False) -> None:
        pass

    def close(self) -> None:
        pass

    def all(self, stream: str) -> Rows:
        return np.concatenate(self.rows[stream])

    def entered(self) -> dict[object, int]:
        """When each step began."""
        return {data["name"]: t_ns for t_ns, kind, data in self.events if kind == "step"}


def host_of(
    config: RigConfig, record: Mapping[str, Recorded] = ALL, start_ns: int = START_NS
) -> tuple[InProcessHost, Kept, Control]:
    control, kept = Control(), Kept()
    clock = VirtualClock(config.period_ns, start_ns)
    cycle = wire(config, clock, control, 1).cycle
    host = InProcessHost(cycle, clock, virtual=True, sink=kept, record=record)
    assert host.open() == []
    assert host.settle(1) is None
    return host, kept, control


def waits(*names: str, seconds: float = 0.1) -> CycleProgram:
    return CycleProgram(tuple(Segment(name, duration_s=seconds) for name in names))


def end(host: InProcessHost) -> None:
    host.make_safe()
    host.close()


def test_every_row_is_recorded_once_with_own_time(tmp_path: Path) -> None:
    host, kept, _ = host_of(rig(PlantGrid, tmp_path))
    assert host.play(waits("go", seconds=2.5)).severity is Severity.DONE
    end(host)
    rows = kept.all("grid")
    assert np.array_equal(rows["number"], np.arange(len(rows)))
    assert np.array_equal(rows["negative"], -rows["number"])
    assert np.array_equal(rows["status"], rows["number"] % 7)
    assert np.array_equal(rows["t_ns"], START_NS + np.arange(len(rows)) * ROW_NS)
    last_ns = kept.all("cycle")["t_ns"][-1]
    assert last_ns - LATENCY_NS - 10 * ROW_NS < rows["t_ns"][-1] <= last_ns - LATENCY_NS


def test_time_may_begin_at_zero(tmp_path: Path) -> None:
    """As it does in a dry run."""
    host, kept, _ = host_of(rig(PlantGrid, tmp_path), start_ns=0)
    assert host.play(waits("go")).severity is Severity.DONE
    end(host)
    rows = kept.all("grid")
    assert np.array_equal(rows["t_ns"], np.arange(len(rows)) * ROW_NS)


def test_blocks_shorter_than_cycle_do_not_pile_up(tmp_path: Path) -> None:
    host, kept, _ = host_of(rig(PlantGrid, tmp_path, rows=1, row_ns=100_000, latency_ns=0))
    assert host.play(waits("go")).severity is Severity.DONE
    end(host)
    rows, cycles = kept.all("grid"), kept.all("cycle")
    assert np.array_equal(rows["number"], np.arange(len(rows)))
    assert rows["t_ns"][-1] == cycles["t_ns"][-1]


def test_rows_are_thinned_as_asked(tmp_path: Path) -> None:
    host, kept, _ = host_of(rig(PlantGrid, tmp_path), {"grid": Recorded(7), "cycle": Recorded()})
    assert host.play(waits("go")).severity is Severity.DONE
    end(host)
    rows = kept.all("grid")
    assert np.array_equal(rows["number"], 7 * np.arange(len(rows)))


def test_unrecorded_rows_are_still_seen(tmp_path: Path) -> None:
    host, kept, _ = host_of(rig(PlantGrid, tmp_path), {"cycle": Recorded()})
    reached = Condition("grid.number", Comparison.ABOVE, 100.0)
    program = CycleProgram((Segment("go", until=((reached,),), timeout_s=10.0),))
    assert host.play(program).severity is Severity.DONE
    end(host)
    assert list(kept.rows) == ["cycle"]


@pytest.mark.parametrize("seen", [-1, 0])
def test_cycle_sees_shown_row_once_block_is_there(tmp_path: Path, seen: int) -> None:
    host, kept, _ = host_of(rig(PlantGrid, tmp_path, seen=seen))
    reached = Condition("grid.number", Comparison.ABOVE, 94.0)
    program = CycleProgram(
        (Segment("go", until=((reached,),), timeout_s=10.0), Segment("stop", duration_s=0.01))
    )
    assert host.play(program).severity is Severity.DONE
    end(host)
    last_of_block = 99 if seen == -1 else 109  # the first block whose row seen is above 94
    there_ns = START_NS + last_of_block * ROW_NS + LATENCY_NS
    assert kept.entered()["stop"] == START_NS + -(-(there_ns - START_NS) // PERIOD_NS) * PERIOD_NS


def test_value_in_cycle_is_as_old_as_sample(tmp_path: Path) -> None:
    """The newest row is at least 3 ms old when it comes, and up to 7.5 ms before the next does."""
    for stale_s, ending in ((0.0076, Severity.DONE), (0.006, Severity.END_TRIAL)):
        fresh = Interlock(
            "fresh", "grid.number", action=Severity.END_TRIAL, stale_after_s=stale_s, latch=False
        )
        host, _, _ = host_of(rig(PlantGrid, tmp_path, interlocks=(fresh,)))
        outcome = host.play(waits("go", seconds=0.2))
        assert outcome.severity is ending, outcome
        end(host)


def test_blocks_that_stop_coming_trip_what_watches_them(tmp_path: Path) -> None:
    fresh = Interlock("fresh", "grid.number", action=Severity.ABORT, stale_after_s=0.05)
    host, kept, _ = host_of(rig(PlantGrid, tmp_path, interlocks=(fresh,), blocks=20))
    outcome = host.play(waits("go", seconds=1.0))
    assert outcome.severity is Severity.ABORT
    assert "grid.number is stale: its last row is 50 ms old" in outcome.reason
    end(host)
    assert kept.all("grid")["number"][-1] == 199
    last_row_ns = START_NS + 199 * ROW_NS
    tripped = [t_ns for t_ns, kind, _ in kept.events if kind == "interlock"]
    assert last_row_ns + 50_000_000 < tripped[0] <= last_row_ns + 50_000_000 + PERIOD_NS


def test_blocks_that_stop_coming_are_fault_in_end(tmp_path: Path) -> None:
    host, _, _ = host_of(rig(PlantGrid, tmp_path, blocks=20))
    outcome = host.play(waits("go", seconds=5.0))
    assert outcome.severity is Severity.FAULT
    assert "grid gave no row for 1000 ms" in outcome.reason
    end(host)


@pytest.mark.parametrize(("latency_ns", "fresh"), [(900_000_000, True), (1_100_000_000, False)])
def test_row_after_silence_of_its_device_is_ignored(
    tmp_path: Path, latency_ns: int, fresh: bool
) -> None:
    late = rig(PlantGrid, tmp_path, rows=1, row_ns=PERIOD_NS, latency_ns=latency_ns)
    blocks = PlantBlocks(
        late.devices["grid"], ClockPlant(PlantConfig(), period_ns=PERIOD_NS, seed=1)
    )
    blocks.open()
    assert blocks.read(START_NS) is None
    row = blocks.read(START_NS + 2_000_000_000)
    assert (row is not None) is fresh
    blocks.close()


def test_a_row_ahead_of_the_plant_is_refused(tmp_path: Path) -> None:
    host, _, _ = host_of(rig(PlantGrid, tmp_path))
    end(host)
    clock = VirtualClock(PERIOD_NS, START_NS)
    wrong = rig(PlantGrid, tmp_path, ahead_ns=100_000_000)
    cycle = wire(wrong, clock, Control(), 1).cycle
    host = InProcessHost(cycle, clock, virtual=True, sink=Kept(), record=ALL)
    assert host.open() == []
    outcome = host.settle(10)
    assert outcome is not None
    assert outcome.severity is Severity.FAULT
    assert "the driver returned a row that is 0.09" in outcome.reason


def test_only_rows_taken_during_steps_are_recorded(tmp_path: Path) -> None:
    """Rows come up to 8 ms after they were taken, and steps change within a block."""
    record = {"grid": Recorded(1, frozenset({"ready", "drive", "again"})), "cycle": Recorded()}
    host, kept, _ = host_of(rig(PlantGrid, tmp_path), record)
    first = CycleProgram(
        (
            Segment("before", duration_s=0.05),
            Segment("ready", duration_s=0.03),
            Segment("drive", duration_s=0.1),
            Segment("gap", duration_s=0.002),
            Segment("again", duration_s=0.004),
            Segment("back", duration_s=0.1),
        )
    )
    assert host.play(first).severity is Severity.DONE
    end(host)
    begun = kept.entered()
    taken = START_NS + ROW_NS * np.arange(2000)
    inside = (taken >= begun["ready"]) & (taken < begun["gap"])
    inside |= (taken >= begun["again"]) & (taken < begun["back"])
    assert kept.all("grid")["t_ns"].tolist() == taken[inside].tolist()
    assert inside.sum() == 260 + 8


def test_program_that_follows_at_once_leaves_no_gap(tmp_path: Path) -> None:
    record = {"grid": Recorded(1, frozenset({"drive", "stopped"})), "cycle": Recorded()}
    host, kept, _ = host_of(rig(PlantGrid, tmp_path), record)
    assert host.play(waits("before", "drive", seconds=0.02)).severity is Severity.DONE
    assert host.play(waits("stopped", "after", seconds=0.02)).severity is Severity.DONE
    end(host)
    numbers = kept.all("grid")["number"]
    assert np.array_equal(np.diff(numbers), np.ones(len(numbers) - 1))
    begun = kept.entered()
    assert kept.all("grid")["t_ns"][0] == begun["drive"]
    assert kept.all("grid")["t_ns"][-1] == begun["after"] - ROW_NS


def test_last_rows_are_recorded_as_run_ends(tmp_path: Path) -> None:
    """The last cycle has seen rows that no cycle after it decides about; then all is closed."""
    during = Recorded(1, frozenset({"go"}))
    quick = rig(PlantGrid, tmp_path, rows=1, latency_ns=0)
    host, kept, _ = host_of(quick, {"grid": during, "cycle": during})
    assert host.play(waits("go")).severity is Severity.DONE
    end(host)
    rows = kept.all("grid")
    assert rows["t_ns"][0] == kept.entered()["go"]
    assert rows["t_ns"][-1] == kept.all("cycle")["t_ns"][-1] - ROW_NS


def test_early_end_of_program_closes_window(tmp_path: Path) -> None:
    far = Interlock("far", "grid.number", high=300.0, action=Severity.END_TRIAL, stale_after_s=1.0)
    record = {"grid": Recorded(1, frozenset({"drive"})), "cycle": Recorded(1, frozenset({"drive"}))}
    host, kept, _ = host_of(rig(PlantGrid, tmp_path, interlocks=(far,)), record)
    assert host.play(waits("drive", seconds=5.0)).severity is Severity.END_TRIAL
    assert host.settle(50) is None
    end(host)
    (tripped,) = [t_ns for t_ns, kind, _ in kept.events if kind == "interlock"]
    assert kept.all("grid")["t_ns"][-1] == tripped - ROW_NS
    # What the cycle reports of itself is recorded by the same rule.
    assert kept.all("cycle")["t_ns"][[0, -1]].tolist() == [
        kept.entered()["drive"], tripped - PERIOD_NS,
    ]  # fmt: skip


def test_a_repeated_run_gives_the_same_rows(tmp_path: Path) -> None:
    found = []
    for _ in range(2):
        host, kept, _ = host_of(rig(PlantGrid, tmp_path))
        host.play(waits("go", seconds=0.3))
        end(host)
        found.append((kept.all("grid").tobytes(), kept.all("cycle").tobytes()))
    assert found[0] == found[1]


def test_real_time_device_is_blocked_in_virtual_time(tmp_path: Path) -> None:
    real = rig(Grid, tmp_path)
    with pytest.raises(Blocked, match=r"grid .*real time"):
        wire(real, VirtualClock(PERIOD_NS, START_NS), Control(), 1)


def test_plant_block_stream_equals_wired_stream(tmp_path: Path) -> None:
    found = rig(PlantGrid, tmp_path)
    wired = wire(found, VirtualClock(PERIOD_NS, START_NS), Control(), 1).cycle.rig.streams
    assert tuple(streams_of(found)) == wired
