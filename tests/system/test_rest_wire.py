"""After a stop a rig of CAN, Modbus and serial devices is recorded until it has come to rest."""

from __future__ import annotations

import signal
import time
from pathlib import Path

import numpy as np
from support.commands.command import start
from support.wire import wire_rig

from rigd.record import Recording

DRIVE = """\
procedure: drive
title: Drives the wheel
doc: For the test.
trial:
  steps:
    - step: drive
      set: {wheel_servo.current: 0.3 A, longitudinal_belt.engaged: 0}
      for: 60 s
"""
DRIVES = ("wheel_servo", "longitudinal_belt", "lateral_belt")
#: The shipped watchdog suffers no stall of a crowded machine.
PATIENT = {"watchdog: 100 ms": "watchdog: 1 s"}


def test_rows_show_the_rig_come_to_rest(tmp_path: Path) -> None:
    (tmp_path / "drive.yaml").write_text(DRIVE)
    path = tmp_path / "stopped.mcap"
    with wire_rig(tmp_path, "wire-rest", PATIENT) as wire:
        run = start(["run", "drive.yaml", "--rig", wire.rig, "--output", path], tmp_path)
        run.wait_for("trial 1/1")
        run.signal(signal.SIGINT)
        ended = run.end()
        drives = {name: wire.parts()[name] for name in DRIVES}
    assert ended.code == 5, ended.err
    assert "coming to rest" in ended.err
    recording = Recording.open(path)
    (end_ns,) = (event.t_ns for event in recording.events() if event.kind == "run_end")
    for name in (*DRIVES, "carriage", "traction", "scale"):
        times = recording.read(name)["t_ns"]
        assert times[-1] - end_ns > 1.6e9, name
    rows = recording.read("wheel_servo")
    assert not np.any(rows["current_setpoint"][rows["t_ns"] > end_ns])
    for name, drive in drives.items():  # what asks a drive for its rows keeps it safe
        safe_ns = drive["safe_since_ns"] + time.time_ns() - time.monotonic_ns()
        assert safe_ns < end_ns + 0.5e9, name
