"""A note is added to a recording as a whole or not at all, and no sample changes."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from numpy.typing import NDArray

from rigd.model import RecordingError, Stream
from rigd.record import Note, Recording, RecordingWriter, add_note, verify
from rigd.record.mcap.wire import DATA_END
from rigd.record.read.moment import recorded_at

Create = Callable[..., RecordingWriter]
MakeRows = Callable[..., NDArray[np.void]]
AT = datetime(2026, 11, 27, 8, tzinfo=UTC)


@pytest.fixture
def path(create: Create, rows: MakeRows, servo: Stream, tmp_path: Path) -> Path:
    with create() as writer:
        writer.event(int(rows(servo, 1)["t_ns"][0]), "run_start")
        writer.write("wheel_servo", rows(servo, 4_001))
    return tmp_path / "run.mcap"


def test_notes_are_added_and_samples_stay(path: Path) -> None:
    before, whole = path.read_bytes(), Recording.open(path)
    path.chmod(0o640)
    add_note(path, "wheel worn\nas seen later", "A. Miller", AT)
    add_note(path, "µ and \u65e5", "B", AT.replace(hour=7))
    after = Recording.open(path)
    assert after.info.notes == (
        Note("2026-11-27T07:00:00.000000Z", "B", "µ and \u65e5"),
        Note("2026-11-27T08:00:00.000000Z", "A. Miller", "wheel worn\nas seen later"),
    )
    data = whole.data_end - DATA_END.size
    assert path.read_bytes()[:data] == before[:data]
    assert after.read("wheel_servo").tobytes() == whole.read("wheel_servo").tobytes()
    assert verify(path).sound
    assert path.stat().st_mode & 0o777 == 0o640
    assert [item.name for item in path.parent.iterdir()] == ["run.mcap"]


def test_other_readers_of_mcap_find_the_note(path: Path) -> None:
    add_note(path, "worn", "B", AT)
    with path.open("rb") as file:
        found = {item.name: item.metadata for item in make_reader(file).iter_metadata()}
    assert found["notes"] == {"2026-11-27T08:00:00.000000Z": '{"author": "B", "text": "worn"}'}


def test_a_note_keeps_the_date_of_a_simulation(create: Create, tmp_path: Path) -> None:
    with create(metadata={"run": {"mode": "simulated, virtual time"}}):
        pass
    path = tmp_path / "run.mcap"
    os.utime(path, (1e9, 1e9))
    before = recorded_at(Recording.open(path).info)
    for text in ("first", "second"):
        add_note(path, text, "B")
        assert recorded_at(Recording.open(path).info) == before


def killed_after(calls: int, path: Path) -> bool:
    """Add a note in a process that is killed after ``calls`` calls that change files."""
    child = os.fork()
    if child:
        _, status = os.waitpid(child, 0)
        return os.WIFSIGNALED(status)
    left = [calls]

    def count(event: str = "call", *_: object) -> None:
        if event in ("call", "open", "os.rename", "os.truncate", "os.chmod", "os.remove"):
            left[0] -= 1
            if left[0] < 0:
                os.kill(os.getpid(), signal.SIGKILL)

    def counted(real: Callable[..., object]) -> Callable[..., object]:
        def call(*args: object) -> object:
            count()
            return real(*args)

        return call

    try:
        for name in ("pwritev", "fdatasync", "fsync", "ftruncate"):
            setattr(os, name, counted(getattr(os, name)))
        sys.addaudithook(count)
        add_note(path, "worn", "B")
    finally:
        os._exit(0)


def test_a_killed_note_leaves_the_recording_whole(path: Path) -> None:
    before, killed = path.read_bytes(), 0
    while killed_after(killed, path):
        killed += 1
        assert Recording.open(path).info.notes or path.read_bytes() == before
        assert verify(path).sound
        path.write_bytes(before)
        assert killed < 100
    assert killed > 5
    assert len(Recording.open(path).info.notes) == 1
    assert list(path.parent.glob("*.adding")) == []


@pytest.mark.parametrize(
    ("text", "author", "message"),
    [
        (" ", "B", "the note is empty"),
        ("worn", "", "the author of the note is empty"),
        ("a\x1b[2J", "B", "control character"),
        ("x" * 2001, "B", "at most 2000"),
    ],
)
def test_a_note_that_is_no_text_is_refused(
    path: Path, text: str, author: str, message: str
) -> None:
    before = path.read_bytes()
    with pytest.raises(ValueError, match=message):
        add_note(path, text, author)
    assert path.read_bytes() == before


def test_no_note_for_what_is_no_whole_recording(path: Path, create: Create, tmp_path: Path) -> None:
    whole = path.read_bytes()
    spoilt = bytearray(whole)
    spoilt[len(whole) // 2] ^= 1
    wrong = {"torn": whole[:-9], "spoilt": bytes(spoilt), "empty": b"", "other": b"text" * 99}
    for name, content in wrong.items():
        file = tmp_path / f"{name}.mcap"
        file.write_bytes(content)
        with pytest.raises(RecordingError, match=name):
            add_note(file, "worn", "B")
        assert file.read_bytes() == content
    with pytest.raises(RecordingError, match=r"none\.mcap"):
        add_note(tmp_path / "none.mcap", "worn", "B")
    with create("busy.mcap"), pytest.raises(RecordingError, match="being written"):
        add_note(tmp_path / "busy.mcap", "worn", "B")
    assert list(tmp_path.glob("*.adding")) == []
