"""An FMU between channels of the rig at the wire, in real time, and what kills lead to."""

from __future__ import annotations

import os
import shutil
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from support.faults.killing import END_S, QUARTER, Victim, own_state
from support.fmu import build
from support.recordings.blocks import alive
from support.wire import WireRig, wire_rig

from rigd.record import Recording

DEVICE = """\
  vehicle:
    driver: fmu-in-loop
    options:
      file: FILE
      late: 250 # cycles: a crowded machine stalls
      inputs: {free: {channel: wheel_servo.current, unit: A}}
      outputs: {speed: omega, steps: steps}

interlocks:
"""


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[WireRig]:
    folder = tmp_path_factory.mktemp("bench")
    device = DEVICE.replace("FILE", str(build(folder)))
    with wire_rig(folder, f"wire-loop-{os.getpid()}", QUARTER | {"interlocks:\n": device}) as rig:
        yield rig


@pytest.fixture
def run(bench: WireRig, tmp_path: Path) -> Iterator[Victim]:
    state = own_state(tmp_path)
    victim = Victim(bench.without("accelerometer"), tmp_path, state)
    try:
        yield victim
    finally:
        victim.end()
        shutil.rmtree(state)


def model_of(run: Victim) -> int:
    """The process of the FMU: a child of the cycle."""
    cycle = run.pids()["cycle"]
    (found,) = Path(f"/proc/{cycle}/task/{cycle}/children").read_text().split()
    return int(found)


def test_killed_model_takes_rig_to_rest(run: Victim) -> None:
    os.kill(model_of(run), signal.SIGKILL)
    run.wait_until_safe()
    run.process.wait(END_S)
    recording = Recording.open(run.recording)
    (fault,) = [event.data["reason"] for event in recording.events() if event.kind == "fault"]
    assert str(fault).startswith("vehicle: Flywheel.fmu: the step at "), fault
    assert str(fault).endswith("crashed: its process was ended by SIGKILL"), fault
    rows, period_ns = recording.read("vehicle"), 4_000_000
    rows = rows[rows["steps"] >= 1]  # it begins when the servo has shown its current
    times = rows["t_ns"].astype(np.int64)
    assert len(rows) > 5
    began_ns = times[0] - period_ns * int(rows["steps"][0])
    np.testing.assert_array_equal(rows["steps"], (times - began_ns) // period_ns)
    assert np.all(rows["spent"] > 0)


def test_model_ends_with_killed_cycle(run: Victim) -> None:
    model = model_of(run)
    run.hit("cycle", signal.SIGKILL)
    deadline = time.monotonic() + END_S
    while alive(model):
        assert time.monotonic() < deadline
        time.sleep(0.01)
