"""The point at which a sweep with a damaged recording continues."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rigd.daemon.execute import perform
from rigd.daemon.resume import read_resume_point
from rigd.daemon.run_request import requested
from rigd.engine.play.control import Control
from rigd.model import RecordingError
from rigd.model.about import About
from rigd.model.channels import Channel, Stream
from rigd.model.rows import row_dtype
from rigd.model.severity import Severity
from rigd.record import Recording, RecordingWriter

AXIS = Stream("axis", tuple(Channel(f"c{i}", "m") for i in range(60)))
SECOND = 1_000_000_000


def test_a_trial_that_lost_rows_is_played_again(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    rows = np.zeros(600, row_dtype(AXIS))
    rows["t_ns"] = np.arange(600) * (SECOND // 100)
    run = {"procedure": "sweep", "rig": "bench", "seed": "1"}
    with RecordingWriter.create(
        path,
        streams=[AXIS],
        metadata={"run": run},
        attachments=(),
        start_ns=0,
        compression="none",
    ) as writer:
        writer.event(0, "run_start")
        for number in (1, 2, 3):
            writer.event((2 * number - 2) * SECOND, "trial_start", number)
            writer.event(2 * number * SECOND, "trial_end", number, {"complete": True})
        writer.write("axis", rows)
    assert read_resume_point(path).done == {1, 2, 3}
    chunk = next(
        item
        for item in Recording.open(path).contents.chunks
        if 2 in item.message_index_offsets and item.message_start_time == 3 * SECOND
    )
    content = bytearray(path.read_bytes())
    content[chunk.chunk_start_offset + 200] ^= 1
    path.write_bytes(content)
    assert read_resume_point(path).done == {1, 3}
    assert path.with_name("run.mcap.orig").read_bytes() == content


@pytest.mark.parametrize("seed", ["", "one"])
def test_recording_without_a_seed_is_not_resumed(tmp_path: Path, seed: str) -> None:
    path = tmp_path / "imported.mcap"
    run = {"procedure": "old_bench", "rig": "bench", "mode": "imported", "seed": seed}
    RecordingWriter.create(
        path, streams=[AXIS], metadata={"run": run}, attachments=(), start_ns=0
    ).close()
    with pytest.raises(RecordingError, match="does not name its run, so it cannot be resumed"):
        read_resume_point(path)


@pytest.mark.parametrize(
    ("begun", "given", "pace"),
    [(0.5, None, 0.5), (0.5, 2.0, 2.0), (0.5, 0.0, None), (None, None, None)],
)
def test_resumed_run_keeps_pace_unless_one_given(
    tmp_path: Path, begun: float | None, given: float | None, pace: float | None
) -> None:
    path = tmp_path / "run.mcap"
    asked = requested("quick", "lugre-1", overrides={}, about=About(), pace=begun, output=path)
    control = Control()
    control.request(Severity.STOP, "stopped by the test")
    perform(asked, control)
    resumed = requested(
        "quick", "lugre-1", overrides={}, about=About(), pace=given, resume=read_resume_point(path)
    )
    assert resumed.pace == pace
