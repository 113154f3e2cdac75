"""Viewers find trial and step as numbers on ``/trial``; rigd itself needs only the events."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from rigd.model import Channel, Stream
from rigd.record import Recording, RecordingWriter, recover, verify
from rigd.record.mcap.schema import TRIAL_CHANNEL

Create = Callable[..., RecordingWriter]
MakeRows = Callable[..., NDArray[np.void]]
Mark = tuple[int, int, int, int, str]

RUN: list[tuple[str, int | None, dict[str, Any]]] = [
    ("run_start", None, {}),
    ("step", None, {"name": "home"}),
    ("trial_start", 0, {"number": 0, "repeat": 2}),
    ("step", 0, {"name": "rest"}),
    ("step", 0, {"name": "drive"}),
    ("hold", 0, {"step": "drive", "phase": "held"}),
    ("hold", 0, {"step": "drive", "phase": "returning"}),
    ("hold", 0, {"step": "drive", "phase": "over"}),
    ("late", 0, {"missed_slots": 1}),
    ("trial_end", 0, {"complete": True}),
    ("step", None, {"name": "back"}),
    ("prompt", None, {"name": "look"}),
    ("answer", None, {"name": "look"}),
    ("run_end", None, {"state": "complete"}),
]
MARKS: list[Mark] = [
    (1, -1, -1, 0, "home"),
    (2, 0, 2, -1, ""),
    (3, 0, 2, 0, "rest"),
    (4, 0, 2, 1, "drive"),
    (5, 0, 2, -1, ""),
    (7, 0, 2, 1, "drive"),
    (9, -1, -1, -1, ""),
    (10, -1, -1, 0, "back"),
    (11, -1, -1, -1, ""),
]


def play(writer: RecordingWriter, start_ns: int, first: int = 0, last: int | None = None) -> None:
    """Write the events of the run from ``first`` to before ``last``, a second apart."""
    for number, (kind, trial, data) in list(enumerate(RUN))[first:last]:
        writer.event(start_ns + number * 10**9, kind, trial, data)


def marks(path: Path, start_ns: int) -> list[Mark]:
    """What a reader that is not rigd's finds, with its time in s."""
    with AnyReader([path], default_typestore=get_typestore(Stores.EMPTY)) as reader:
        wanted = [item for item in reader.connections if item.topic == "/trial"]
        found: list[Mark] = []
        for connection, t_ns, raw in reader.messages(wanted):
            it: Any = reader.deserialize(raw, connection.msgtype)
            second = (t_ns - start_ns) // 10**9
            found.append((second, it.number, it.repeat, it.step, it.step_name))
    return found


@pytest.fixture
def path(create: Create, tmp_path: Path, start_ns: int) -> Path:
    with create() as writer:
        play(writer, start_ns)
    return tmp_path / "run.mcap"


def test_trial_and_step_are_numbers_for_viewers(path: Path, start_ns: int) -> None:
    assert marks(path, start_ns) == MARKS


def test_recording_for_rigd_has_no_further_stream(path: Path) -> None:
    recording = Recording.open(path)
    assert set(recording.streams) == {"wheel_servo", "force"}
    assert recording.other_topics == ()
    assert verify(path).sound


@pytest.mark.parametrize("cut", range(1, len(RUN)))
def test_series_continues_where_recorder_was_killed(
    create: Create, tmp_path: Path, start_ns: int, servo: Stream, force: Stream, cut: int
) -> None:
    path = tmp_path / "run.mcap"
    writer = create()
    play(writer, start_ns, last=cut)
    writer.flush(complete=True)
    writer._file.close()  # as a kill does, without the end
    with RecordingWriter.append(path, streams=[servo, force]) as again:
        play(again, start_ns, first=cut)
    assert marks(path, start_ns) == MARKS
    assert verify(path).sound


def spoil(path: Path, offset: int) -> None:
    content = bytearray(path.read_bytes())
    content[offset] ^= 0xFF
    path.write_bytes(content)


def test_lost_series_costs_no_trial(path: Path, start_ns: int) -> None:
    (chunk,) = [
        item
        for item in Recording.open(path).contents.chunks
        if TRIAL_CHANNEL in item.message_index_offsets
    ]
    spoil(path, chunk.chunk_start_offset + chunk.chunk_length - 5)
    assert not verify(path).sound
    recover(path)
    recording = Recording.open(path)
    assert recording.gaps == ()
    assert recording.trial(0).complete
    assert marks(path, start_ns) == []
    with RecordingWriter.append(path, streams=tuple(recording.streams.values())) as writer:
        play(writer, start_ns + 10**11)
    assert [mark[1:] for mark in marks(path, start_ns)] == [mark[1:] for mark in MARKS]
    assert verify(path).sound


def test_lost_definition_of_series_is_written_anew(path: Path, start_ns: int) -> None:
    content = path.read_bytes()
    at = content.index(b"/trial")
    content = content.replace(b"/trial", b"/trxal")
    path.write_bytes(content)
    assert at
    recover(path)
    assert marks(path, start_ns) == MARKS
    assert set(Recording.open(path).streams) == {"wheel_servo", "force"}


def test_recording_without_series_is_read_and_continued(
    create: Create, tmp_path: Path, start_ns: int, rows: MakeRows
) -> None:
    """As older recordings, and those of a rig with a device of that name."""
    trial = Stream("trial", (Channel("load", "N"),))
    path = tmp_path / "run.mcap"
    with create(streams=[trial]) as writer:
        play(writer, start_ns, last=5)
        writer.write("trial", rows(trial, 10))
    with RecordingWriter.append(path, streams=[trial]) as writer:
        play(writer, start_ns, first=5)
    recording = Recording.open(path)
    assert recording.count("trial") == 10
    assert recording.info.state == "complete"
    assert TRIAL_CHANNEL not in recording.contents.channels
    assert verify(path).sound
