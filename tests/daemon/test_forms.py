"""The three-process form of a run, before anything is played."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import pytest
from support.recordings.blocks import alive

from rigd.config.loader import load_rig
from rigd.daemon.forms import RecordingSpec, processes
from rigd.engine.play.control import Control
from rigd.engine.shared import RecorderState, RunFolder, Word
from rigd.model.errors import RecordingError
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


def test_failed_start_leaves_no_recorder_nor_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    state = tmp_path / "state"
    state.mkdir(mode=0o700)
    monkeypatch.setenv("RIGD_STATE", str(state))
    held = RunFolder.take(RIG.name, command="test")
    recorders: list[int] = []

    def no_room(rig: object, folder: RunFolder, *_: Any, **__: Any) -> None:
        board = folder.board()
        while board[Word.RECORDER_STATE] == RecorderState.STARTING:
            time.sleep(0.01)
        assert kept.path.exists()
        recorders.append(board[Word.PID_RECORDER])
        raise RecordingError("cannot make latest: No space left on device")

    monkeypatch.setattr("rigd.engine.process.launch.launch", no_room)
    kept = RecordingSpec(tmp_path / "run.mcap", {"cycle": Recorded()}, {}, (), "none", False)
    try:
        for _ in range(2):  # the rig is free for another run
            with pytest.raises(RecordingError, match="No space left"):
                processes(
                    RIG, Control(), 1, start_ns=time.time_ns(), kept=kept, command="test", held=held
                )
            assert not held.has_job
            assert not kept.path.exists()
        assert not any(map(alive, recorders))
    finally:
        held.release()
