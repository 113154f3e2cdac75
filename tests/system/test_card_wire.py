"""The register card behind a socket: a whole run over it, and a master that is killed."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from support.commands.command import rigd
from support.faults.stalls import witnessed

from rigd.config.loader import load_rig
from rigd.config.rig import RigConfig
from rigd.config.shipped_files import find_file

ONE_SHOT_S = 0.5  #: longer than this machine stalls, short enough to wait for
WAIT_S = 60.0

#: What stands in the shipped file, and what stands here instead.
CHANGES = {
    "rig: card-lugre": "rig: card-wire",
    "cycle: 4 kHz": "cycle: 100 Hz",  # twenty packets to and fro in every cycle
    "interface: lugre": "interface: emulator",
    "resource: stone": "resource: FOLDER/card",
    "time: 240 ms": f"time: {1.2 * ONE_SHOT_S} s",
    "cycle_silence: 250 ms": "cycle_silence: 5 s",
    "\nlinks:": """
simulation:
  model: wire-lugre
  folder: FOLDER
  buses: {}
  card: {one_shot: ONE_SHOT s}
  wheel_servo: null
  longitudinal_belt: null
  lateral_belt: null
  wheel_encoder: null
  carriage: null
  accelerometer: null
  scale: null

links:""",
}

#: A master with nothing but link and devices: arms, drives the wheel, and reports it.
MASTER = """
import sys, time
from rigd.config.loader import load_rig
rig = load_rig(sys.argv[1])
setup = rig.links["card"]
link = setup.link_class(setup.config)
devices = {name: one.driver_class(one.config, link) for name, one in rig.devices.items()}
link.open()
for device in devices.values():
    device.open()
armed = False
while True:
    link.begin(0)
    for device in devices.values():
        device.read(0)
    if not armed:
        for device in devices.values():
            device.arm()
        armed = True
    devices["wheel_servo"].write((1.0,))
    link.end(0)
    if devices["wheel_servo"].ready():
        print("driving", flush=True)
    time.sleep(0.005)
"""


@pytest.fixture
def rig_file(tmp_path: Path) -> Path:
    text = find_file("card-lugre", "configs").read_text()
    for old, new in CHANGES.items():
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    file = tmp_path / "rig.yaml"
    folder = tmp_path / "sim"
    file.write_text(text.replace("FOLDER", str(folder)).replace("ONE_SHOT", str(ONE_SHOT_S)))
    return file


@pytest.fixture
def served(rig_file: Path) -> Iterator[RigConfig]:
    """The rig, while `rigd sim` serves its card."""
    command = [sys.executable, "-m", "rigd", "sim", str(rig_file)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline().startswith("MF624 card at ")
            assert "is served" in process.stdout.readline()
            yield load_rig(rig_file)
        finally:
            process.send_signal(signal.SIGTERM)
            assert process.wait(WAIT_S) == 0


def card(rig: RigConfig) -> dict[str, Any]:
    """Return what an observer sees of the card and its drives."""
    assert rig.simulation is not None
    simulation = rig.simulation.simulation_class(rig.simulation.config)
    return dict(simulation.ask({"do": "state"})["parts"]["card"])


def test_run_completes_over_the_served_card(
    served: RigConfig, rig_file: Path, tmp_path: Path
) -> None:
    ended = rigd("run", "quick", "--rig", rig_file, "--yes", "--json", cwd=tmp_path)
    assert ended.code == 0, ended.err
    assert json.loads(ended.out)["state"] == "complete"
    state = card(served)
    assert not state["enabled"]
    assert (state["da0"], state["lines"] & 0b11111) == (0.0, 0)


UNSEEN = """
procedure: unseen
title: The monitor stands still
doc: The wheel shall carry a current.
trial:
  steps:
    - fault: {part: card, fault: stuck_code, options: {input: 0}}
    - step: push
      set: {wheel_servo.current: 0.4 A}
      for: 20 s
"""


def test_stuck_monitor_ends_run_as_not_following(
    served: RigConfig, rig_file: Path, tmp_path: Path
) -> None:
    (tmp_path / "unseen.yaml").write_text(UNSEEN)
    ended = rigd("run", "unseen.yaml", "--rig", rig_file, "--yes", cwd=tmp_path)
    assert ended.code == 4, ended.err
    assert "wheel_servo_follows: wheel_servo.current" in ended.out + ended.err
    assert not card(served)["enabled"]


def test_killed_master_is_survived_by_one_shot_alone(served: RigConfig, rig_file: Path) -> None:
    command = [sys.executable, "-c", MASTER, str(rig_file)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as master:
        try:
            assert master.stdout is not None
            assert master.stdout.readline() == "driving\n"
            assert card(served)["safe_since_ns"] == 0
        finally:
            killed_ns = time.monotonic_ns()
            os.kill(master.pid, signal.SIGKILL)
    give_up = time.monotonic() + WAIT_S
    with witnessed() as lost_s:
        while (state := card(served))["enabled"]:
            assert time.monotonic() < give_up
            time.sleep(0.01)
        stalled_s = lost_s()
    assert state["da0"] == pytest.approx(5.0, abs=2e-3), "the card itself holds what it was told"
    assert state["wheel_demand"] == 0.0
    assert 0 < (state["safe_since_ns"] - killed_ns) * 1e-9 < ONE_SHOT_S + 1.0 + stalled_s
