"""`rigd run` interrupted: stopped, aborted, paused, killed, and resumed."""

from __future__ import annotations

import signal
from pathlib import Path

import numpy as np
import pytest
from support.commands.command import rigd, start

from rigd.record import Recording
from rigd.sdk.shipped_files import shipped_folder

#: A cycle that a loaded machine misses does no harm: nothing moves.
STILL = """\
procedure: still
title: Stands still
doc: Three trials without a current.
repeats: 3
trial:
  steps:
    - step: rest
      set: {wheel_servo.current: 0 A}
      for: 2 s
"""


def few(folder: Path, step: str = "0.45 A") -> tuple[str, ...]:
    """Write a campaign of four short trials, and return the words that run it on the rig."""
    text = (shipped_folder("procedures") / "constant_current.yaml").read_text("utf-8")
    assert text.count("step: 0.15 A") == 1
    (folder / "few.yaml").write_text(text.replace("step: 0.15 A", f"step: {step}"), "utf-8")
    short = ("--set", "brake_at=0.4 m", "--set", "longest_drive=1 s")
    return ("run", "few.yaml", "--rig", "lugre-1", *short)


def states(path: Path) -> tuple[str, list[str]]:
    """Return the ending of a recording and the names of the steps it played."""
    recording = Recording.open(path)
    steps = [str(e.data["name"]) for e in recording.events() if e.kind == "step"]
    return recording.info.state, steps


@pytest.mark.parametrize(
    ("name", "told"), [("SIGINT", "Ctrl-C"), ("SIGTERM", "SIGTERM"), ("SIGHUP", "SIGHUP")]
)
def test_signal_stops_run_safe_with_its_file_finished(tmp_path: Path, name: str, told: str) -> None:
    path = tmp_path / "stopped.mcap"
    run = start([*few(tmp_path), "--pace", "2", "--output", path], tmp_path)
    run.wait_for("trial 2/4")
    run.signal(signal.Signals[name])
    ended = run.end()
    assert ended.code == 5, ended.err
    state, steps = states(path)
    assert state == "stopped"
    assert steps[-1] == "hold"  # `finish` of the procedure
    recording = Recording.open(path)
    assert recording.read("wheel_servo")["current_setpoint"][-1] == 0.0
    assert f"stopped by {told}" in ended.out

    # At a pace, cycles that a loaded machine misses could end it early.
    resumed = rigd("run", "--resume", path, "--pace", "virtual", "--json", cwd=tmp_path)
    assert resumed.code == 0, resumed.err
    info = Recording.open(path).info
    assert (info.state, info.trials_done) == ("complete", 4)
    # The first trial was complete and is not played again.
    assert [trial.number for trial in info.trials] == [1, 2, 2, 3, 4]


def test_a_second_ctrl_c_aborts_without_finish(tmp_path: Path) -> None:
    path = tmp_path / "aborted.mcap"
    run = start(
        ["run", "constant_current", "--rig", "lugre-1", "--pace", "1", "--output", path], tmp_path
    )
    run.wait_for("trial 1/10")
    run.signal(signal.SIGINT)
    run.wait_for("Ctrl-C: stopping. Again: abort")
    run.signal(signal.SIGINT)
    ended = run.end()
    assert ended.code == 5, ended.err
    state, _ = states(path)
    assert state == "aborted"
    assert Recording.open(path).read("wheel_servo")["current_setpoint"][-1] == 0.0


def test_pause_waits_between_trials_and_resume_continues(tmp_path: Path) -> None:
    path = tmp_path / "paused.mcap"
    (tmp_path / "still.yaml").write_text(STILL, "utf-8")
    run = start(
        ["run", "still.yaml", "--rig", "lugre-1", "--pace", "1", "--output", path], tmp_path
    )
    run.wait_for("trial 1/3")
    run.signal(signal.SIGUSR1)
    run.wait_for("; Ctrl-Z resumes, Ctrl-C stops")
    run.signal(signal.SIGUSR1)
    run.wait_for("trial 2/3")
    run.signal(signal.SIGINT)
    assert run.end().code == 5
    info = Recording.open(path).info
    assert info.trials[0].complete


def test_killed_run_is_resumed_from_its_torn_file(tmp_path: Path) -> None:
    """In virtual time: at a pace, cycles that a loaded machine misses let the rig overrun."""
    path = tmp_path / "killed.mcap"
    run = start([*few(tmp_path, step="0.15 A"), "--output", path], tmp_path)
    run.wait_for("trial 3/10")
    run.signal(signal.SIGKILL)
    run.end()
    with path.open("r+b") as stream:  # and the disk lost its last bytes too
        stream.truncate(path.stat().st_size - 100)
    path.with_name(path.name + ".journal").unlink(missing_ok=True)
    assert rigd("info", path, cwd=tmp_path).code == 0
    resumed = rigd("run", "--resume", path, cwd=tmp_path)
    assert resumed.code == 0, resumed.err
    info = Recording.open(path).info
    assert (info.state, info.trials_done) == ("complete", 10)
    times = Recording.open(path).read("carriage")["t_ns"]
    assert np.all(np.diff(times) > 0)
