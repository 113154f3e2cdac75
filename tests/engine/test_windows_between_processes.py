"""Recording windows with cycle and block device in processes of their own."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from support.engine.grid import Grid, PlantGrid, rig
from support.recordings.blocks import until

from rigd.config.rig import RigConfig
from rigd.engine.cycle.wiring import streams_of
from rigd.engine.play.control import Control
from rigd.engine.process.launch import launch
from rigd.engine.process.process_host import ProcessHost
from rigd.engine.shared import Job, RunFolder
from rigd.model.severity import Severity
from rigd.procedure.program import (
    Capture,
    Comparison,
    Condition,
    CycleProgram,
    Recorded,
    Segment,
)

WINDOWED = {"grid": Recorded(1, frozenset({"drive", "again"})), "cycle": Recorded()}
ROW_NS = 500_000

pytestmark = pytest.mark.usefixtures("own_state")


@contextmanager
def host_of(
    config: RigConfig, record: Mapping[str, Recorded]
) -> Iterator[tuple[ProcessHost, RunFolder]]:
    streams = tuple(streams_of(config))
    folder = RunFolder.take(config.name, command="test")
    job = Job(config.name, folder.path / "x.mcap", streams, time.time_ns())
    folder.prepare(job, {stream.name: 100_000 for stream in streams})
    host = launch(config, folder, job, Control(), record=record, finish=lambda: None)
    try:
        yield host, folder
    finally:
        host.make_safe()
        host.close()
        folder.clear()
        folder.release()


@pytest.mark.parametrize("driver", [Grid, PlantGrid])
def test_exactly_the_rows_of_the_windows_are_recorded(tmp_path: Path, driver: type[Grid]) -> None:
    """The device is 8 ms behind, and between two windows there is less than that."""
    program = CycleProgram(
        (
            Segment("before", duration_s=0.2),
            Segment("drive", duration_s=0.3),
            Segment("gap", duration_s=0.004),
            Segment("again", duration_s=0.006),
            Segment("back", duration_s=0.3),
        )
    )
    with host_of(rig(driver, tmp_path), WINDOWED) as (host, folder):
        assert host.open() == ()
        assert host.settle(20) is None
        assert host.arm() is None
        assert host.play(program).severity is Severity.DONE
        grid = folder.row_rings(folder.job)["grid"]
        events = [item for item in folder.event_ring("cycle").peek() if item.kind == "step"]
        begun = {event.data["name"]: event.t_ns for event in events}
        until(lambda: grid.head > 0 and int(grid.latest(1)["t_ns"][0]) >= begun["back"] - ROW_NS)
        rows = grid.peek()
    # All of the grid, on both sides of what was recorded.
    recorded = rows["number"].astype(np.int64)
    numbers = np.arange(recorded[0] - 1000, recorded[-1] + 1000)
    taken = int(rows["t_ns"][0]) + (numbers - recorded[0]) * ROW_NS
    inside = (taken >= begun["drive"]) & (taken < begun["gap"])
    inside |= (taken >= begun["again"]) & (taken < begun["back"])
    assert recorded.tolist() == numbers[inside].tolist()
    assert rows["t_ns"].tolist() == taken[inside].tolist()


@pytest.mark.parametrize("driver", [Grid, PlantGrid])
def test_without_windows_all_rows_are_recorded(tmp_path: Path, driver: type[Grid]) -> None:
    thinned = {"grid": Recorded(3), "cycle": Recorded()}
    with host_of(rig(driver, tmp_path), thinned) as (host, folder):
        assert host.open() == ()
        assert host.settle(100) is None
        rows = folder.row_rings(folder.job)["grid"].peek()
    assert len(rows) > 10
    assert np.array_equal(rows["number"], 3 * np.arange(len(rows)))


@pytest.mark.parametrize("driver", [Grid, PlantGrid])
def test_capture_has_rows_from_before_its_condition(tmp_path: Path, driver: type[Grid]) -> None:
    when = ((Condition("grid.number", Comparison.ABOVE, 1000.0),),)
    before_ns = 150_000_000
    capture = Capture(when, before_ns * 1e-9, 0.03)
    record = {"grid": Recorded(capture=capture), "cycle": Recorded()}
    with host_of(rig(driver, tmp_path), record) as (host, folder):
        assert host.open() == ()
        events = folder.event_ring("cycle")

        def opened() -> list[int]:
            return [item.t_ns for item in events.peek() if item.kind == "capture"]

        assert host.rest_while(lambda: not opened()) is None
        (opened_ns,) = opened()
        grid = folder.row_rings(folder.job)["grid"]
        assert host.rest_while(
            lambda: grid.head == 0 or int(grid.latest(1)["t_ns"][0]) < opened_ns
        ) is None  # fmt: skip
        rows = grid.peek()
    assert np.array_equal(np.diff(rows["number"]), np.ones(len(rows) - 1))
    assert 0 <= int(rows["t_ns"][0]) - (opened_ns - before_ns) < ROW_NS
