"""The summary for lists is that of the whole index, read at a tenth of its cost."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from rigd.model import RecordingError, Stream
from rigd.record import Recording, RecordingWriter, recover
from rigd.record.read.brief import brief_info

Create = Callable[..., RecordingWriter]
MakeRows = Callable[..., NDArray[np.void]]


def same(path: Path) -> None:
    """Check both summaries of a recording against one another."""
    whole = Recording.open(path).info
    assert replace(brief_info(path), streams=whole.streams, attachments=whole.attachments) == whole


def fill(writer: RecordingWriter, rows: NDArray[np.void]) -> None:
    start = int(rows["t_ns"][0])
    writer.event(start, "run_start")
    writer.event(start + 1, "trial_start", 1, {"parameters": {"speed": 0.1}, "units": {}})
    writer.write("wheel_servo", rows)
    writer.event(start + 2, "trial_end", 1, {"complete": True})
    writer.event(start + 3, "run_end", None, {"state": "complete"})


def test_brief_summary_is_that_of_the_index(
    create: Create, rows: MakeRows, servo: Stream, tmp_path: Path
) -> None:
    path = tmp_path / "run.mcap"
    with create() as writer:
        fill(writer, rows(servo, 4_001))
    same(path)
    streams = tuple(Recording.open(path).streams.values())
    with RecordingWriter.append(path, streams=streams, metadata={"run": {"rig": "x"}}) as writer:
        writer.event(int(2e18), "run_start")
    same(path)
    assert (brief_info(path).rig, brief_info(path).state) == ("x", "interrupted")
    with create("empty.mcap"):
        pass
    same(tmp_path / "empty.mcap")


def test_a_repaired_recording_is_read_whole(
    create: Create, rows: MakeRows, servo: Stream, tmp_path: Path
) -> None:
    path = tmp_path / "run.mcap"
    with create() as writer:
        fill(writer, rows(servo, 40_001))
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)
    recover(path)
    same(path)
    assert brief_info(path).gaps


def test_every_damaged_end_is_refused_alike(
    create: Create, rows: MakeRows, servo: Stream, tmp_path: Path
) -> None:
    path = tmp_path / "run.mcap"
    with create() as writer:
        fill(writer, rows(servo, 100))
    whole = path.read_bytes()
    for cut in range(1, 3000, 97):
        path.write_bytes(whole[:-cut])
        with pytest.raises(RecordingError):
            brief_info(path)
    rng = np.random.default_rng(1)
    for at in rng.integers(0, len(whole), 150):
        spoilt = bytearray(whole)
        spoilt[at] ^= 0x55
        path.write_bytes(spoilt)
        try:
            expected = Recording.open(path).info
        except RecordingError:
            with pytest.raises(RecordingError):
                brief_info(path)
        else:
            found = brief_info(path)
            assert (found.state, found.trials) == (expected.state, expected.trials)
