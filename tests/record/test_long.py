"""A long recording is not rewritten at every flush, and loses nothing by it."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from rigd.model import RecordingError, Stream
from rigd.model.channels import Channel
from rigd.model.rows import row_dtype
from rigd.record import Recording, RecordingWriter, recover
from rigd.record.write import writer as writing

STREAM = Stream("s", tuple(Channel(f"c{index}") for index in range(12)))


def rows(start: int, count: int) -> NDArray[Any]:
    made = np.zeros(count, row_dtype(STREAM))
    made["t_ns"] = 1_000_000_000 + np.arange(start, start + count) * 1_000_000
    made["c0"] = np.arange(start, start + count)
    return made


@pytest.fixture
def spare(monkeypatch: pytest.MonkeyPatch) -> Callable[[int], None]:
    return lambda limit: monkeypatch.setattr(writing, "SPARED_SUMMARY_BYTES", limit)


def test_long_summary_is_written_every_two_seconds_only(
    tmp_path: Path, spare: Callable[[int], None]
) -> None:
    spare(100)
    now = [0.0]
    path = tmp_path / "long.mcap"
    with RecordingWriter.create(
        path, streams=[STREAM], metadata={}, attachments=[], start_ns=0,
        sync_interval_s=None, clock=lambda: now[0],
    ) as writer:  # fmt: skip
        complete = []
        for tenth in range(60):
            now[0] = tenth * 0.1
            writer.write("s", rows(tenth * 100, 100))
            writer.flush()
            try:
                Recording.open(path)
                complete.append(tenth)
            except RecordingError:
                # A kill at this moment: the file as it is, recovered, holds every row.
                killed = tmp_path / "killed.mcap"
                killed.write_bytes(path.read_bytes())
                recover(killed)
                found = Recording.open(killed).read("s")["c0"]
                assert np.array_equal(found, np.arange((tenth + 1) * 100))
    long = [tenth for tenth in complete if tenth > 20]
    assert long, "the summary was never written again"
    assert all(b - a >= 19 for a, b in itertools.pairwise(long))
    assert np.array_equal(Recording.open(path).read("s")["c0"], np.arange(6000))


def test_complete_flush_leaves_a_file_to_read(tmp_path: Path, spare: Callable[[int], None]) -> None:
    spare(100)
    path = tmp_path / "long.mcap"
    with RecordingWriter.create(
        path, streams=[STREAM], metadata={}, attachments=[], start_ns=0,
        sync_interval_s=None, clock=lambda: 0.0,
    ) as writer:  # fmt: skip
        for tenth in range(10):
            writer.write("s", rows(tenth * 100, 100))
            writer.flush()
            writer.flush(complete=True)
            assert len(Recording.open(path).read("s")) == (tenth + 1) * 100


def test_closed_file_is_independent_of_summary_limit(
    tmp_path: Path, spare: Callable[[int], None]
) -> None:
    contents = []
    for limit in (0, 10**9):
        spare(limit)
        path = tmp_path / f"{limit}.mcap"
        with RecordingWriter.create(
            path, streams=[STREAM], metadata={}, attachments=[], start_ns=0
        ) as writer:
            for part in range(40):
                writer.write("s", rows(part * 100, 100))
                writer.flush()
        contents.append(path.read_bytes())
    assert contents[0] == contents[1]
