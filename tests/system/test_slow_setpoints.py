"""An oven at the wire: a procedure sets it within its rate, and every way out makes it safe."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from support.commands.command import rigd, start
from support.wire import OVEN, WireRig, is_free, wire_rig

from rigd.engine.shared import RunFolder, Word
from rigd.record import Recording

WARM = """\
procedure: warm
title: Warm up
doc: For tests.
trial:
  steps:
    - step: heat
      set: {oven.temperature: 28 degC}
      until: oven.measured > 27 degC for 0.5 s and oven.measured < 29 degC for 0.5 s
      timeout: 30 s
"""
#: Never reached, so that a run goes on until something ends it.
ENDLESS = (
    WARM.replace("28 degC", "90 degC").replace("27 degC", "102 degC").replace("29 degC", "104 degC")
)


@pytest.fixture(scope="module")
def oven(tmp_path_factory: pytest.TempPathFactory) -> Iterator[WireRig]:
    with wire_rig(tmp_path_factory.mktemp("oven"), "oven-test", shipped=OVEN) as rig:
        (rig.rig.parent / "warm.yaml").write_text(WARM)
        (rig.rig.parent / "endless.yaml").write_text(ENDLESS)
        yield rig


def output(oven: WireRig) -> bool:
    return bool(oven.parts()["oven"]["output"])


def wait_for(condition: Callable[[], bool], within_s: float = 30.0) -> None:
    deadline = time.monotonic() + within_s
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def test_oven_follows_within_rate_and_ends_safe(oven: WireRig) -> None:
    folder = oven.rig.parent
    done = rigd("run", "warm.yaml", "--rig", oven.rig, "--output", "warm.mcap", cwd=folder)
    assert done.code == 0, done.err
    assert not output(oven)
    recording = Recording.open(folder / "warm.mcap")
    rows = recording.read("oven")
    setpoints, times = rows["temperature_setpoint"], rows["t_ns"] * 1e-9
    known = np.flatnonzero(np.isfinite(setpoints))
    assert setpoints[known[0]] == 293.15
    assert setpoints[known[-1]] == 301.15, "a stop keeps it"
    changes = np.diff(setpoints[known])
    assert changes.max() > 0.0
    # A row has the setpoint of the newest cycle: late by a cycle at one end, at the other not.
    assert np.all(changes <= 5.0 * (np.diff(times[known]) + 0.25))
    assert any(event.kind == "waiver" for event in recording.events())


def test_without_waiver_it_is_not_armed(oven: WireRig) -> None:
    text = oven.rig.read_text()
    bare = oven.rig.with_name("bare.yaml")
    bare.write_text("\n".join(line for line in text.splitlines() if "waiver:" not in line))
    sent = oven.parts()["oven"]["set_temperature"]
    done = rigd("run", "warm.yaml", "--rig", bare, cwd=oven.rig.parent)
    assert done.code == 3
    assert "oven has no watchdog: nothing makes it safe if this computer fails" in done.err
    assert oven.parts()["oven"]["set_temperature"] == sent


@pytest.mark.parametrize("victim", ["daemon", "cycle"])
def test_killed_process_leaves_oven_safe(oven: WireRig, victim: str) -> None:
    run = start(["run", "endless.yaml", "--rig", str(oven.rig)], cwd=oven.rig.parent)
    try:
        wait_for(lambda: output(oven) or run.process.poll() is not None)
        if victim == "daemon":
            os.kill(run.process.pid, signal.SIGKILL)
        else:
            board = RunFolder.at(Path(os.environ["RIGD_STATE"]) / "oven-test").board()
            os.kill(board[Word.PID_CYCLE], signal.SIGKILL)
        wait_for(lambda: not output(oven))
    finally:
        ended = run.end()
    assert ended.code in (4, -signal.SIGKILL), ended.err
    wait_for(lambda: is_free("oven-test"))  # what the killed one has started may still be ending


@pytest.mark.parametrize("count", [1, 3], ids=["stop", "estop"])
def test_stop_by_a_person_switches_it_off(oven: WireRig, count: int) -> None:
    run = start(["run", "endless.yaml", "--rig", str(oven.rig)], cwd=oven.rig.parent)
    wait_for(lambda: output(oven))
    for _ in range(count):
        run.process.send_signal(signal.SIGINT)
        time.sleep(0.05)
    ended = run.end()
    assert ended.code == 5
    assert not output(oven)


def test_oven_that_stays_on_is_named(oven: WireRig) -> None:
    run = start(["run", "endless.yaml", "--rig", str(oven.rig)], cwd=oven.rig.parent)
    wait_for(lambda: output(oven))
    oven.ask(do="fault", part="oven", fault="stuck")
    ended = run.end()
    assert ended.code == 4
    assert "oven could not be made safe" in ended.out + ended.err
    oven.ask(do="clear", part="oven", fault="stuck")
