"""A supply by a class of PyMeasure in a run: set within its rate, safe on every way out."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from support.commands.command import rigd, start
from support.instruments.supply_2260b import Supply2260B
from support.wire import is_free

from rigd.engine.shared import RunFolder, Word
from rigd.record import Recording

RIG = """\
rig: pymeasure-test
title: A supply by PyMeasure
cycle: 100 Hz
supervision: {cycle_silence: 250 ms, daemon_silence: 1 s}
interlocks: []
devices:
  supply:
    driver: pymeasure
    options:
      instrument: pymeasure.instruments.keithley.Keithley2260B
      address: ADDRESS
      visa_library: '@py'
      period: 100 ms
      channels:
        voltage: {read: voltage, unit: V}
        current: {read: current, unit: A}
      setpoints:
        voltage: {write: voltage_setpoint, read: voltage_setpoint, unit: V, low: 0 V, high: 30 V}
      arm: {output_enabled: true}
      safe: [shutdown, {voltage_setpoint: 0}]
      state: {read: output_enabled, safe: false, ready: true}
      identify: id
    limits:
      voltage: {low: 0 V, high: 20 V, rate: 10 V/s, rest: 0 V}
    waiver: {by: A. Person, reason: The supply has a fuse}
"""
PROCEDURE = """\
procedure: drive
title: Drive
doc: For tests.
trial:
  steps:
    - step: drive
      set: {supply.voltage: 5 V}
      until: supply.voltage > LEVEL
      timeout: 30 s
"""


@pytest.fixture(scope="module")
def supply(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Supply2260B, Path]]:
    device, folder = Supply2260B(), tmp_path_factory.mktemp("supply")
    (folder / "rig.yaml").write_text(RIG.replace("ADDRESS", device.address))
    (folder / "drive.yaml").write_text(PROCEDURE.replace("LEVEL", "4.9 V"))
    (folder / "endless.yaml").write_text(PROCEDURE.replace("LEVEL", "6 V"))
    yield device, folder
    device.stop()


def wait_for(condition: Callable[[], bool], within_s: float = 30.0) -> None:
    deadline = time.monotonic() + within_s
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def test_supply_is_driven_recorded_and_ends_safe(supply: tuple[Supply2260B, Path]) -> None:
    device, folder = supply
    done = rigd("run", "drive.yaml", "--rig", "rig.yaml", "--output", "drive.mcap", cwd=folder)
    assert done.code == 0, done.out + done.err
    assert not device.output
    recording = Recording.open(folder / "drive.mcap")
    rows = recording.read("supply")
    assert rows["voltage"].max() > 4.9
    assert rows["current"].max() == pytest.approx(rows["voltage"].max() / 10, abs=1e-4)


@pytest.mark.parametrize("victim", ["daemon", "cycle"])
def test_killed_process_leaves_supply_safe(supply: tuple[Supply2260B, Path], victim: str) -> None:
    device, folder = supply
    run = start(["run", "endless.yaml", "--rig", "rig.yaml"], cwd=folder)
    try:
        wait_for(lambda: device.driven > 1.0 or run.process.poll() is not None)
        assert run.process.poll() is None, run.end()
        board = RunFolder.at(Path(os.environ["RIGD_STATE"]) / "pymeasure-test").board()
        pid = run.process.pid if victim == "daemon" else board[Word.PID_CYCLE]
        os.kill(pid, signal.SIGKILL)
        wait_for(lambda: not device.output)
    finally:
        ended = run.end()
    assert ended.code in (4, -signal.SIGKILL), ended.out + ended.err
    wait_for(lambda: is_free("pymeasure-test"))  # what the killed one started may still be ending


def test_stop_by_a_person_switches_it_off(supply: tuple[Supply2260B, Path]) -> None:
    device, folder = supply
    run = start(["run", "endless.yaml", "--rig", "rig.yaml"], cwd=folder)
    wait_for(lambda: device.driven > 1.0 or run.process.poll() is not None)
    run.process.send_signal(signal.SIGINT)
    ended = run.end()
    assert ended.code == 5, ended.out + ended.err
    assert not device.output
