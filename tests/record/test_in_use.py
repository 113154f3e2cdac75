"""A recording that is written while it is read: what is read is right, or refused."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rigd.config.lab.publication import Author, Publication
from rigd.model import Channel, RecordingError, Stream
from rigd.record import Recording, RecordingWriter
from rigd.record.export import export
from rigd.record.export.rocrate import Published, export_rocrate
from rigd.record.mcap.file import RecordingInUse

Rows = Callable[..., np.ndarray[Any, Any]]

#: Both streams are still in open chunks, and then ``b`` is sealed where the chunk of ``a`` was.
A, B = (Stream(name, (Channel("x", "N"),)) for name in "ab")


@pytest.fixture
def overtaken(
    create: Callable[..., RecordingWriter], rows: Rows, tmp_path: Path
) -> tuple[RecordingWriter, Recording]:
    """A writer, and its recording as it was opened before ``b`` got more rows."""
    writer = create(streams=(A, B))
    given = rows(B, 1_500)
    given["x"] = np.arange(1_500)
    writer.write("a", rows(A, 700))
    writer.write("b", given[:600])
    writer.flush()
    recording = Recording.open(tmp_path / "run.mcap")
    writer.write("b", given[600:])
    writer.flush()
    return writer, recording


def test_rows_of_overtaken_index_are_never_missing(
    overtaken: tuple[RecordingWriter, Recording], tmp_path: Path
) -> None:
    writer, recording = overtaken
    with writer:
        for stream in "ab":
            with pytest.raises(RecordingInUse, match="is being written"):
                recording.read(stream)
        with pytest.raises(RecordingInUse, match="is being written"):
            export(recording, tmp_path / "tables", "csv", streams=["a"])


def test_index_from_before_the_end_is_void(
    overtaken: tuple[RecordingWriter, Recording],
) -> None:
    writer, recording = overtaken
    writer.close()
    for stream in "ab":
        with pytest.raises(RecordingError, match="written to since it was opened") as raised:
            recording.read(stream)
        assert raised.value.hint == "Open it again."
    assert len(Recording.open(recording.path).read("a")) == 700


def test_recording_in_use_is_not_published(
    overtaken: tuple[RecordingWriter, Recording], tmp_path: Path
) -> None:
    writer, recording = overtaken
    publication = Publication("CC-BY-4.0", authors=(Author("Ada"),))
    with writer, pytest.raises(RecordingInUse, match="is being written"):
        opened = Recording.open(recording.path)
        export_rocrate([Published(opened)], tmp_path / "crate", publication)
    assert not (tmp_path / "crate").exists()
