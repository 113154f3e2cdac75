"""The three-process form of a run, before anything is played."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from rigd.config.loader import load_rig
from rigd.daemon.forms import RecordingSpec, processes
from rigd.engine.control import Control
from rigd.engine.shared import RunFolder
from rigd.procedure.program import Recorded

RIG = load_rig("lugre-1")
SECOND_NS = 1_000_000_000


@pytest.mark.parametrize("earlier_s", [0, 60])
def test_time_stamps_are_wall_time_despite_long_preparation(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, earlier_s: int
) -> None:
    state = tmp_path / "state"
    state.mkdir(mode=0o700)
    monkeypatch.setenv("RIGD_STATE", str(state))
    held = RunFolder.take(RIG.name, command="test")
    kept = RecordingSpec(tmp_path / "run.mcap", {"cycle": Recorded()}, {}, (), "none", False)
    start_ns = time.time_ns() - earlier_s * SECOND_NS
    form = processes(RIG, Control(), 1, start_ns=start_ns, kept=kept, command="test", held=held)
    try:
        before_ns, run_ns, after_ns = time.time_ns(), form.host.t_ns, time.time_ns()
        assert before_ns - SECOND_NS // 10 < run_ns < after_ns + SECOND_NS // 10
        assert form.host.run_s >= earlier_s
    finally:
        form.host.close()
        form.release()
        held.release()
