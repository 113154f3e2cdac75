"""The approach-angle rig at the wire, in three processes: it stops, and it stays stopped.

A small sample of what ``benchmarks/automatic_stop.py`` does 200 times. This machine is shared and
stalls: bounds of time are loose here, figures stand there.
"""

from __future__ import annotations

import json
import os
import random
import re
import shutil
import signal
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.commands.command import rigd
from support.faults.killing import DRIVING, Killed, Victim, bound_s, own_state
from support.faults.stalls import witnessed
from support.faults.stopping import STOP_M, Drive, angle_rig, drive_to_stops, write_procedure
from support.wire import WireRig

from rigd.record import Recording

#: What this machine may be away for, in s.
STALLED_S = 0.15
BLOCK_S = 0.01


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[WireRig]:
    folder, slower = tmp_path_factory.mktemp("wire"), {"cycle: 1 kHz": "cycle: 250 Hz"}
    with angle_rig(folder, replaced=slower) as rig:
        yield rig


@pytest.fixture(autouse=True)
def as_delivered(bench: WireRig) -> Iterator[None]:
    """Every test begins with a sound rig at its start."""
    yield
    bench.ask(do="clear")
    bench.ask(do="change", quantity="fault", value="none")
    at_rest(bench)
    bench.ask(do="change", quantity="platform", value="start")


def at_rest(bench: WireRig) -> Mapping[str, Any]:
    """The state of the rig once nothing moves and the relay is open."""
    deadline = time.monotonic() + 60.0
    while True:
        state = bench.ask(do="state")
        if state["plant"]["resting"] and not state["parts"]["relay"]["coil"]:
            return state
        assert time.monotonic() < deadline, state
        time.sleep(0.05)


def test_every_run_stops_at_threshold_without_later_motion(bench: WireRig, tmp_path: Path) -> None:
    draw = random.Random(20)
    drives = [
        Drive(name, draw.choice((4.0, 5.0, 6.0, 8.0)), draw.choice((5.5, 7.0, 8.5, 10.0)))
        for name in ("clean_0", "clean_45", "coated_0")
    ]
    procedure = write_procedure(tmp_path / "stops.yaml", drives)
    recording = tmp_path / "run.mcap"
    stops, told = drive_to_stops(bench, procedure, recording, os.environ)
    assert "3 of 3 trials" in told, told
    assert len(stops) == 3
    for stop in stops:
        # Noise of the median of five samples and a block's age do not stop it much too early.
        assert stop.overshoot_m > -3e-3, stop
        assert stop.overshoot_s < 2 * BLOCK_S + STALLED_S, stop
        assert STOP_M < stop.furthest_m < 0.6, stop  # the relay alone stops nothing
    state = at_rest(bench)
    position = state["plant"]["platform_position"]
    time.sleep(0.3)
    later = bench.ask(do="state")
    assert later["plant"]["platform_position"] == position
    assert later["parts"]["relay"]["closings"] == state["parts"]["relay"]["closings"]
    assert not later["parts"]["relay"]["contact"]

    found = Recording.open(recording)
    daq, relay = found.read("daq"), found.read("relay")
    commands = np.flatnonzero(np.diff(relay["closed_setpoint"]))
    assert len(commands) == 6
    # NaN until the first command is confirmed.
    assert np.isfinite(relay["latency"]).mean() > 0.9
    assert np.nanmax(relay["latency"]) < 0.5
    # The samples of 50 ms before each command and of 60 ms after each stop are there.
    times, changes = daq["t_ns"], relay["t_ns"][commands + 1]
    begun, ended = changes[0::2], changes[1::2]
    for first, last in zip(begun, ended, strict=True):
        near = times[(times > first - 45_000_000) & (times < last + 55_000_000)]
        gaps = np.diff(near) * 1e-9
        assert near[0] - first < -40_000_000
        assert near[-1] - last > 50_000_000
        assert gaps.mean() == pytest.approx(1 / 9600, rel=0.01)


def test_dead_potentiometer_is_stopped_by_drive_time_limit(bench: WireRig, tmp_path: Path) -> None:
    # Slowly: the wheel alone would reach its own end of travel.
    procedure = write_procedure(tmp_path / "stops.yaml", [Drive("clean_45", 8.0, 4.0)])
    bench.ask(do="change", quantity="fault", value="platform_pot_dead")
    recording = tmp_path / "run.mcap"
    before = bench.parts()["relay"]["closings"]
    drive_to_stops(bench, procedure, recording, os.environ)
    state = at_rest(bench)
    assert state["parts"]["relay"]["closings"] == before + 1
    assert state["plant"]["platform_position"] == pytest.approx(0.45, abs=0.01)
    found = Recording.open(recording)
    relay = found.read("relay")
    closed = relay["t_ns"][relay["closed_setpoint"] > 0.5]
    assert (closed[-1] - closed[0]) * 1e-9 == pytest.approx(1.5, abs=STALLED_S)
    (ended,) = [event for event in found.events() if event.kind == "trial_end"]
    assert ended.data["complete"] is False
    assert "'drive' did not end within 1.5 s" in str(ended.data["reason"])


@pytest.mark.parametrize(
    ("victim", "number"),
    [
        ("cycle", signal.SIGKILL),
        ("all", signal.SIGKILL),
        ("cycle", signal.SIGSTOP),
        ("daemon", signal.SIGKILL),
    ],
    ids=lambda item: getattr(item, "name", item),
)
def test_killed_with_the_relay_closed_it_opens(
    bench: WireRig, tmp_path: Path, victim: str, number: signal.Signals
) -> None:
    bench.ask(do="change", quantity="voltage", value=4.0)
    state = own_state(tmp_path)
    run = Victim(bench, tmp_path, state, DRIVING)
    try:
        with witnessed() as lost_s:
            time.sleep(random.Random(f"{victim}{number}").uniform(0.0, 0.3))
            killed: Killed = run.hit(victim, number)
            stalled_s = lost_s()
    finally:
        run.end()
    assert killed.safe_after_s < bound_s(bench, victim, number, DRIVING) + stalled_s
    assert killed.gaps == 0
    shutil.rmtree(state)


def test_watchdog_that_stays_up_prevents_arming(bench: WireRig, tmp_path: Path) -> None:
    bench.ask(do="fault", part="relay", fault="one_shot_dead")
    procedure = write_procedure(tmp_path / "stops.yaml", [Drive("clean_0", 4.0, 10.0)])
    done = rigd("run", procedure, "--rig", bench.rig, "--yes", cwd=tmp_path)
    assert done.code == 3, done.err
    # After a killed run the server keeps its tasks: then a live one might feed the one-shot.
    assert re.search("not proven: the one-shot was still up|one-shot .* stays up: ", done.err)
    assert bench.parts()["relay"]["closings"] == 0 or not bench.parts()["relay"]["coil"]


def test_the_shipped_campaign_at_the_wire(bench: WireRig, tmp_path: Path) -> None:
    """Two runs of procedures/approach_angles.yaml, with its prompts, its scale and its files."""
    recording = tmp_path / "run.mcap"
    done = rigd(
        *("run", "approach_angles", "--rig", bench.rig, "--yes", "--output", recording),
        *("--set", "set=clean_30", "--set", "load=6 kg", "--set", "voltage=8.5 V"),
        cwd=tmp_path,
    )
    assert done.code == 0, done.err
    plant = at_rest(bench)["plant"]
    assert plant["angle"] == pytest.approx(np.radians(30))
    assert (plant["load"], plant["voltage"], plant["wheel"]) == (6.0, 8.5, "clean")
    found = rigd("identify", recording, "--json", cwd=tmp_path)
    assert found.code == 0, found.err
    assert "clean_30" in json.dumps(found.json)
