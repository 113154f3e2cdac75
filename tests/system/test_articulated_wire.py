"""The articulated robot at the wire: a run, its faults, and the kill of its cycle."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from support.commands.command import Ended, rigd
from support.faults.killing import bound_s, kill_cycle
from support.faults.rigs import ROLLING
from support.wire import ROBOT, WireRig, wire_rig

import rigd as library

#: A quarter of the rate takes half of the CPU time.
QUARTER = {"cycle: 1 kHz": "cycle: 250 Hz"}
DASH = """\
procedure: dash
title: A short straight run
doc: Both motors hold a speed.
trial:
  steps:
    - step: rest
      for: 0.3 s
    - fault: {FAULT}
    - step: drive
      set:
        right_motor.speed: {ramp: {from: 0 rad/s, to: 250 rad/s, over: 0.5 s}}
        left_motor.speed: {ramp: {from: 0 rad/s, to: 250 rad/s, over: 0.5 s}}
      for: 2 s
record: all
"""


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[WireRig]:
    with wire_rig(tmp_path_factory.mktemp("wire"), "wire-robot", QUARTER, ROBOT) as rig:
        yield rig


@pytest.fixture(autouse=True)
def sound(bench: WireRig) -> Iterator[None]:
    yield
    bench.ask(do="clear")
    bench.ask(do="change", quantity="robot", value="start")


def dash(bench: WireRig, folder: Path, fault: str) -> Ended:
    """Run with a fault of a device from the start of the motion on."""
    procedure = folder / "dash.yaml"
    procedure.write_text(DASH.replace("FAULT", fault))
    output = folder / "run.mcap"
    return rigd("run", procedure, "--rig", bench.rig, "--output", output, cwd=folder)


def test_run_with_dropouts_records_the_robot(bench: WireRig, tmp_path: Path) -> None:
    ended = dash(bench, tmp_path, "part: tracker, fault: lost, options: {probability: 0.2}")
    assert ended.code == 0, ended.err + ended.out
    trial = library.open(tmp_path / "run.mcap").trial(1)
    marker, motor = trial["front_marker"], trial["right_motor"]
    assert (marker["status"] & 1).any()  # lost, in the frame before
    # Rows have the pace of the camera, whatever a busy machine does. Arrivals are known to a cycle
    # of 4 ms, and the least delay may be found by and by: that is one step, once.
    frames = marker["frame"] - marker["frame"][0]
    off_ns = marker["t_ns"] - marker["t_ns"][0] - 40e6 * frames
    assert np.ptp(off_ns) < 5e6
    # 0.39836 m/s: the closed form, docs/physics/articulated.md, section 5.
    steady = marker["trial_time"] > 1.3
    gone = np.hypot(*(marker[axis][steady] for axis in "xy"))
    speed = np.polyfit(marker["time"][steady], gone, 1)[0]
    assert abs(speed) == pytest.approx(0.398, rel=0.05)
    held = motor["trial_time"] > 1.3
    assert np.median(motor["speed"][held]) == pytest.approx(250.0, abs=0.5)
    assert np.mean(motor["torque"][held]) == pytest.approx(1.256e-3, abs=3e-4)
    turned = np.polyfit(motor["time"][held], motor["angle"][held], 1)[0]
    assert turned == pytest.approx(250.0, abs=1.0)


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("part: tracker, fault: silent", "The camera has lost the marker of the rear module"),
        ("part: tracker, fault: late, options: {delay_s: 0.8}", "front_marker.frame is stale"),
        ("part: left_motor, fault: silent", "left_motor"),
    ],
)
def test_fault_ends_the_run_named_and_safe(
    bench: WireRig, tmp_path: Path, fault: str, words: str
) -> None:
    ended = dash(bench, tmp_path, fault)
    assert ended.code == 4, ended.err + ended.out
    assert words in " ".join(ended.out.split())
    parts = bench.parts()
    assert all(parts[drive]["safe_since_ns"] for drive in ROLLING.drives)


def test_killed_cycle_leaves_every_drive_safe(bench: WireRig, tmp_path: Path) -> None:
    killed, stalled_s = kill_cycle(bench, tmp_path, ROLLING)
    assert killed.safe_after_s < bound_s(bench, "cycle", signal.SIGKILL, ROLLING) + stalled_s
    assert killed.gaps == 0
    assert killed.ending in ("aborted", "stopped", "faulted")
