"""A resumed run continues the same recording, and only if that is valid."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer
from numpy.typing import NDArray

from rigd.model import RecordingError, Stream
from rigd.record import Attachment, Recording, RecordingWriter, recover, verify

Create = Callable[..., RecordingWriter]
MakeRows = Callable[..., NDArray[np.void]]


def test_metadata_can_follow_the_rows(
    create: Create, rows: MakeRows, servo: Stream, tmp_path: Path
) -> None:
    given = rows(servo, 3_000)
    with create() as writer:
        writer.write("wheel_servo", given[:1_700])
        writer.add_metadata({"run": {"trials": "2"}, "import": {"map": "m.yaml"}})
        writer.write("wheel_servo", given[1_700:])
    recording = Recording.open(tmp_path / "run.mcap")
    assert recording.read("wheel_servo").tobytes() == given.tobytes()
    assert recording.metadata["run"]["procedure"] == "sweep"
    assert recording.metadata["run"]["trials"] == "2"
    assert recording.metadata["import"] == {"map": "m.yaml"}
    assert verify(recording.path).sound


def test_rows_and_events_go_on(
    create: Create, rows: MakeRows, servo: Stream, force: Stream, tmp_path: Path, start_ns: int
) -> None:
    path = tmp_path / "run.mcap"
    given = rows(servo, 3_000)
    with create() as writer:
        writer.event(start_ns, "run_start")
        writer.write("wheel_servo", given[:1_700])
    again = RecordingWriter.append(
        path,
        streams=(servo, force),
        metadata={"run": {"resumed": "1"}},
        attachments=(Attachment("rig-2.yaml", "application/yaml", b"name: bench\n"),),
        sync_interval_s=None,
    )
    with again as writer:
        writer.event(start_ns + 9, "run_start")
        writer.write("wheel_servo", given[1_700:])
        writer.flush()
        assert Recording.open(path).read("wheel_servo").tobytes() == given.tobytes()
    recording = Recording.open(path)
    assert recording.read("wheel_servo").tobytes() == given.tobytes()
    assert recording.metadata["run"]["procedure"] == "sweep"
    assert recording.metadata["run"]["resumed"] == "1"
    assert list(recording.attachments) == ["rig.yaml", "rig-2.yaml"]
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        sequence = [message.sequence for _, _, message in reader.iter_messages("/wheel_servo")]
    assert sequence == list(range(3_000))
    assert recover(path).intact


def test_a_recovered_recording_is_continued(
    create: Create, rows: MakeRows, servo: Stream, force: Stream, tmp_path: Path
) -> None:
    path = tmp_path / "run.mcap"
    given = rows(servo, 3_000)
    with create() as writer:
        writer.write("wheel_servo", given[:2_500])
    os.truncate(path, Recording.open(path).contents.chunks[-1].chunk_start_offset + 50)
    with pytest.raises(RecordingError, match="rigd recover"):
        RecordingWriter.append(path, streams=(servo, force))
    recover(path)
    with RecordingWriter.append(path, streams=(servo, force)) as writer:
        writer.write("wheel_servo", given[2_000:])
    assert Recording.open(path).read("wheel_servo").tobytes() == given.tobytes()
    assert Recording.open(path).info.recovered


def test_other_streams_are_refused(
    create: Create, servo: Stream, force: Stream, tmp_path: Path
) -> None:
    path = tmp_path / "run.mcap"
    create().close()
    before = path.read_bytes()
    with pytest.raises(RecordingError, match="stream force differs"):
        RecordingWriter.append(path, streams=(servo,))
    with pytest.raises(RecordingError, match="stream wheel_servo differs"):
        RecordingWriter.append(path, streams=(replace(servo, doc="another"), force))
    assert path.read_bytes() == before


def test_a_foreign_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "foreign.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        writer.finish()  # type: ignore[no-untyped-call]  # the library leaves it untyped
    with pytest.raises(RecordingError, match="not written by rigd"):
        RecordingWriter.append(path, streams=())


def test_two_writers_exclude_each_other(
    create: Create, servo: Stream, force: Stream, tmp_path: Path
) -> None:
    with create(), pytest.raises(RecordingError, match="being written by another"):
        RecordingWriter.append(tmp_path / "run.mcap", streams=(servo, force))


def test_append_without_rows_keeps_every_value(
    create: Create, rows: MakeRows, servo: Stream, force: Stream, tmp_path: Path
) -> None:
    path = tmp_path / "run.mcap"
    with create() as writer:
        writer.write("wheel_servo", rows(servo, 2_000))
    before = path.read_bytes()
    RecordingWriter.append(path, streams=(servo, force)).close()
    assert path.read_bytes() == before
