"""Files of other programs: every message is read and kept, and no habit of rigd is demanded."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from support.cases import some
from support.recordings.odd_mcap import VALID, Content, content_of, messages_in

from rigd.model import RecordingError, Stream
from rigd.record import Recording, RecordingWriter, recover, verify
from rigd.record.read.condition import FileCondition

ROWS = 400  #: of each stream
#: Messages of one chunk at most; the writers here put as many into one.
CHUNK = 220
ONE_CHUNK = ("other numbers",)
LOOSE = (
    "no chunks", "no chunks, no summary", "attachments between", "no end of the data",
)  # fmt: skip
NO_CRC = (
    *LOOSE, "half in chunks", "no CRC", "other numbers", "empty chunks", "defined in each chunk",
    "longer records",
)  # fmt: skip
Create = Callable[..., RecordingWriter]
MakeRows = Callable[..., NDArray[np.void]]
Key = tuple[int, int, int, bytes]


@pytest.fixture
def ours(
    create: Create, rows: MakeRows, servo: Stream, force: Stream, start_ns: int, tmp_path: Path
) -> Path:
    with create() as writer:
        writer.event(start_ns, "run_start", data={"procedure": "sweep"})
        for trial in (1, 2):
            begin = start_ns + (trial - 1) * 200_000_000
            writer.event(begin, "trial_start", trial, {"number": trial, "parameters": {}})
            writer.event(begin, "step", trial, {"name": "drive"})
            writer.event(begin + 180_000_000, "trial_end", trial, {"complete": True})
        writer.event(start_ns + 390_000_000, "run_end", data={"state": "complete"})
        writer.write("wheel_servo", rows(servo, ROWS))
        writer.write("force", rows(force, ROWS, seed=3))
    return tmp_path / "run.mcap"


@pytest.fixture
def content(ours: Path) -> Content:
    return content_of(ours)


def all_messages(data: bytes) -> dict[str, set[Key]]:
    return {topic: set(found) for topic, found in messages_in(data).items()}


def every(data: bytes) -> set[Key]:
    return {key for messages in messages_in(data).values() for key in messages}


@pytest.mark.parametrize("name", VALID)
def test_odd_valid_file_is_read_and_left_alone(
    name: str, ours: Path, content: Content, tmp_path: Path
) -> None:
    """Rows, events, trials, attachments and metadata are those of the recording.

    Nothing of it is called damaged, and `recover` leaves it alone.
    """
    theirs = tmp_path / "theirs.mcap"
    VALID[name](content, theirs)
    expected, recording = Recording.open(ours), Recording.open(theirs)
    assert recording.condition is FileCondition.VALID
    assert (recording.streams, recording.other_topics) == (expected.streams, ())
    for stream in expected.streams:
        assert recording.read(stream).tobytes() == expected.read(stream).tobytes()
        batches = list(recording.batches(stream, rows=100))
        assert np.concatenate(batches).tobytes() == expected.read(stream).tobytes()
        assert recording.count(stream) == expected.count(stream)
    assert recording.events() == expected.events()
    assert [trial.info for trial in recording.trials] == [trial.info for trial in expected.trials]
    assert recording.attachments.items() >= expected.attachments.items()
    assert recording.metadata.items() >= expected.metadata.items()
    assert (recording.losses, recording.gaps, recording.written_by_rigd) == ((), (), False)
    before = theirs.read_bytes()
    found = verify(theirs)
    assert (found.condition, found.damages) == (FileCondition.VALID, ())
    assert found.rows == {topic: len(keys) for topic, keys in all_messages(before).items()}
    assert recover(theirs).intact
    assert theirs.read_bytes() == before


@pytest.mark.parametrize("name", some(list(VALID), 3))
def test_cut_odd_file_keeps_every_message(name: str, content: Content, tmp_path: Path) -> None:
    """Every message that the reader of others finds before the cut is in the repaired file."""
    theirs = tmp_path / "theirs.mcap"
    VALID[name](content, theirs)
    data = theirs.read_bytes()[:-12_000]
    theirs.write_bytes(data)
    assert verify(theirs).condition is FileCondition.DAMAGED
    if name in ONE_CHUNK:
        with pytest.raises(RecordingError, match="no message"):
            recover(theirs)
        assert [item.name for item in tmp_path.iterdir() if item != tmp_path / "run.mcap"] == [
            "theirs.mcap"
        ]
        assert theirs.read_bytes() == data
        return
    report = recover(theirs)
    assert report.original is not None
    assert report.original.read_bytes() == data
    repaired = all_messages(theirs.read_bytes())
    for topic, messages in all_messages(data).items():
        assert messages <= repaired[topic]
    assert verify(theirs).damages == ()
    rows = {topic: len(items) for topic, items in repaired.items()}
    assert verify(theirs).rows == rows


@pytest.mark.parametrize(
    ("name", "place"), some([(name, place) for name in VALID for place in (0.2, 0.4, 0.7)], 5)
)
def test_bad_bytes_cost_only_what_they_hit(
    name: str, place: float, content: Content, tmp_path: Path
) -> None:
    """All messages of intact chunks are kept, and those outside of chunks but the one hit."""
    theirs = tmp_path / "theirs.mcap"
    VALID[name](content, theirs)
    data = bytearray(theirs.read_bytes())
    whole = every(bytes(data))
    at = int(place * len(data))
    data[at : at + 16] = b"\xff" * 16
    theirs.write_bytes(data)
    found = verify(theirs)
    if found.condition is FileCondition.VALID:
        assert name in NO_CRC  # other values of a row are no damage there
        return
    try:
        recover(theirs)
    except RecordingError as error:
        assert "no message" in str(error)
        assert name in ONE_CHUNK
        assert theirs.read_bytes() == data
        return
    repaired = every(theirs.read_bytes())
    assert len(whole - repaired) <= (2 if name in LOOSE else CHUNK)
    assert len(repaired - whole) <= (CHUNK if name in NO_CRC else 0)


@pytest.mark.parametrize(
    ("name", "place"),
    [(name, place) for name in ("mixed channels", "no summary") for place in (9, 17, 25, 41)]
    + [("no CRC", 9), ("no CRC", 17)],
)
def test_wrong_head_of_chunk_costs_no_message(
    name: str, place: int, content: Content, tmp_path: Path
) -> None:
    """A byte of its first or last time, its size or its compression is wrong."""
    theirs = tmp_path / "theirs.mcap"
    VALID[name](content, theirs)
    data = bytearray(theirs.read_bytes())
    messages = every(bytes(data))
    data[Recording.open(theirs).contents.chunks[1].chunk_start_offset + place] ^= 0x15
    theirs.write_bytes(data)
    assert verify(theirs).condition is FileCondition.DAMAGED
    read = Recording.open(theirs, partial=True)
    assert [len(read.read(stream)) for stream in ("wheel_servo", "force")] == [ROWS, ROWS]
    assert recover(theirs).gaps == ()
    assert every(theirs.read_bytes()) == messages
    assert verify(theirs).condition is FileCondition.VALID


@pytest.mark.parametrize("name", ["mixed channels", "no summary", "no chunks", "swapped"])
def test_trial_that_lost_rows_is_not_complete(name: str, content: Content, tmp_path: Path) -> None:
    """Bytes of the second trial are wrong; before the repair and after it."""
    theirs = tmp_path / "theirs.mcap"
    VALID[name](content, theirs)
    data = bytearray(theirs.read_bytes())
    chunks = Recording.open(theirs).contents.chunks
    hit = min(
        chunks, key=lambda chunk: abs(chunk.message_start_time - content.messages[550].log_time)
    )
    at = hit.chunk_start_offset + 60
    if name == "no chunks":
        at = bytes(data).index(content.messages[550].data) - 31 + 1  # the length of its record
    data[at : at + 16] = b"\xff" * 16
    theirs.write_bytes(data)
    for _ in range(2):
        recording = Recording.open(theirs, partial=True)
        assert [trial.complete for trial in recording.trials] == [True, False]
        assert recording.gaps
        assert recording.losses
        recover(theirs)
        assert verify(theirs).damages == ()
