"""An idle rig is shown, never armed, and free again once that is over."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import pytest
from support.daemon.live import PATIENCE_S, Kept

from rigd.config.loader import load_rig
from rigd.daemon.live import Feed, Monitor
from rigd.daemon.live import monitor as module
from rigd.engine.shared import RunFolder
from rigd.model.errors import Blocked

RIG = load_rig("lugre-1")


@pytest.fixture(autouse=True)
def own_state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    state = tmp_path / "state"
    state.mkdir(mode=0o700)
    monkeypatch.setenv("RIGD_STATE", str(state))


def wait_for(condition: Callable[[], bool]) -> None:
    until = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < until
        time.sleep(0.02)


def test_idle_rig_is_shown_until_a_run_starts() -> None:
    kept = Kept()
    held = RunFolder.take(RIG.name, command="the daemon")
    with Feed(RIG, kept) as feed:
        monitor = Monitor(RIG, feed, held)
        monitor.start()
        wait_for(lambda: len(kept.frames.get("wheel_servo", [])) > 5)
        assert monitor.running
        servo = feed.latest().values["wheel_servo.current"]
        assert servo.value == pytest.approx(0.0, abs=0.1)
        assert servo.age_s < PATIENCE_S
        monitor.stop()
        monitor.stop()
        assert (monitor.running, monitor.problem) == (False, "")
        shown = len(kept.frames["wheel_servo"])
        feed.tick()
        assert len(kept.frames["wheel_servo"]) == shown
        assert kept.events == []
        # The rig is still the daemon's, and a run could begin.
        assert not held.has_job
        with pytest.raises(Blocked, match="the daemon"):
            RunFolder.take(RIG.name, command="another")
        held.release()
        RunFolder.take(RIG.name, command="another").release()


def test_failure_to_show_is_reported_once_and_retried(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(module, "AGAIN_S", 0.0)
    kept, told, held = Kept(), list[str](), RunFolder.take(RIG.name, command="somebody else")
    with Feed(RIG, kept) as feed:
        monitor = Monitor(RIG, feed, notify=told.append)
        monitor.start()
        wait_for(lambda: bool(monitor.problem))
        held.release()
        wait_for(lambda: len(kept.frames.get("wheel_servo", [])) > 5)
        assert monitor.problem == ""
        monitor.stop()
    assert len(told) == 1
    assert "somebody else" in told[0]


def test_monitor_can_be_stopped_while_opening() -> None:
    kept = Kept()
    monitor = Monitor(RIG, Feed(RIG, kept))
    monitor.start()
    monitor.stop()
    assert (monitor.running, monitor.problem, kept.events) == (False, "", [])
    RunFolder.take(RIG.name, command="another").release()
