"""What goes into a recording comes out of it, bit for bit, through readers of others too."""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from numpy.typing import NDArray
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from rigd.model import RecordingError, Stream
from rigd.record import NO_TRIAL, Event, Recording, RecordingWriter, recover
from rigd.record.mcap.compression import Compression

Create = Callable[..., RecordingWriter]
MakeRows = Callable[..., NDArray[np.void]]


@pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
def test_rows_come_back_bit_for_bit(
    create: Create,
    rows: MakeRows,
    servo: Stream,
    force: Stream,
    tmp_path: Path,
    compression: Compression,
) -> None:
    moved, pressed = rows(servo, 25_000), rows(force, 3_000, seed=2, rate_hz=100.0)
    moved["current"][7] = math.nan
    with create(compression=compression) as writer:
        for start in range(0, len(moved), 700):
            writer.write("wheel_servo", moved[start : start + 700])
            if start % 1400 == 0:
                writer.flush()
        writer.write("force", pressed)
    recording = Recording.open(tmp_path / "run.mcap")
    assert recording.streams == {"wheel_servo": servo, "force": force}
    assert recording.read("wheel_servo").tobytes() == moved.tobytes()
    assert recording.read("force").tobytes() == pressed.tobytes()
    assert recording.count("wheel_servo") == len(moved)
    assert recording.span_ns("force") == (pressed["t_ns"][0], pressed["t_ns"][-1])


def test_a_window_of_time_is_half_open(
    create: Create, rows: MakeRows, servo: Stream, tmp_path: Path
) -> None:
    given = rows(servo, 5_000)
    with create() as writer:
        writer.write("wheel_servo", given)
    recording = Recording.open(tmp_path / "run.mcap")
    low, high = int(given["t_ns"][990]), int(given["t_ns"][3010])
    assert recording.read("wheel_servo", low, high).tobytes() == given[990:3010].tobytes()
    assert len(recording.read("wheel_servo", high, low)) == 0


def test_every_flush_leaves_a_complete_file(
    create: Create, rows: MakeRows, servo: Stream, tmp_path: Path
) -> None:
    given = rows(servo, 3_000)
    with create() as writer:
        for end in range(100, 3_001, 100):
            writer.write("wheel_servo", given[end - 100 : end])
            writer.flush()
            read = Recording.open(tmp_path / "run.mcap").read("wheel_servo")
            assert read.tobytes() == given[:end].tobytes()


def test_metadata_attachments_and_events_come_back(
    create: Create, tmp_path: Path, start_ns: int
) -> None:
    with create() as writer:
        writer.event(start_ns + 5, "run_start")
        writer.event(
            start_ns + 10,
            "trial_start",
            3,
            {"parameters": {"load": np.float64(2.5), "bad": math.nan}, "list": [np.int64(1)]},
        )
    recording = Recording.open(tmp_path / "run.mcap")
    assert recording.events() == [
        Event(start_ns + 5, "run_start", NO_TRIAL, {}),
        Event(
            start_ns + 10,
            "trial_start",
            3,
            {"parameters": {"load": 2.5, "bad": "nan"}, "list": [1]},
        ),
    ]
    assert recording.metadata["parameters"] == {"torque": "0.15 A", "note": "µ and \u65e5"}
    assert recording.attachments["rig.yaml"].data == b"name: bench\n"
    assert recording.start_ns == start_ns


def test_python_mcap_reads_it_with_all_crcs(
    create: Create, rows: MakeRows, servo: Stream, tmp_path: Path
) -> None:
    given = rows(servo, 2_500)
    with create() as writer:
        writer.write("wheel_servo", given)
    with (tmp_path / "run.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        messages = list(reader.iter_messages(topics=["/wheel_servo"]))
        assert reader.get_header().profile == "ros2"
        assert [attachment.name for attachment in reader.iter_attachments()] == ["rig.yaml"]
    assert [message.sequence for _, _, message in messages] == list(range(2_500))
    for (schema, channel, message), row in zip(messages, given, strict=True):
        assert schema is not None
        assert (schema.name, channel.message_encoding) == ("rigd/msg/WheelServo", "cdr")
        assert message.log_time == message.publish_time == row["t_ns"]
        assert message.data == b"\x00\x01\x00\x00" + row.tobytes()[8:]


def test_rosbags_decodes_it(
    create: Create, rows: MakeRows, servo: Stream, tmp_path: Path, start_ns: int
) -> None:
    given = rows(servo, 1_200)
    with create() as writer:
        writer.write("wheel_servo", given)
        writer.event(start_ns, "step", 4, {"name": "run in"})
    typestore = get_typestore(Stores.EMPTY)
    with AnyReader([tmp_path / "run.mcap"], default_typestore=typestore) as reader:
        decoded: list[tuple[str, Any]] = [
            (connection.topic, reader.deserialize(data, connection.msgtype))
            for connection, _, data in reader.messages()
        ]
    samples = [message for topic, message in decoded if topic == "/wheel_servo"]
    for field in ("current", "speed", "counts", "status"):
        assert [getattr(message, field) for message in samples] == given[field].tolist()
    (event,) = [message for topic, message in decoded if topic == "/events"]
    assert (event.kind, event.trial, event.time) == ("step", 4, 0.0)
    assert event.data == '{"name":"run in"}'


def test_units_are_in_schema_and_channel(create: Create, tmp_path: Path) -> None:
    create().close()
    contents = Recording.open(tmp_path / "run.mcap").contents
    (channel,) = [item for item in contents.channels.values() if item.topic == "/wheel_servo"]
    text = contents.schemas[channel.schema_id].data.decode()
    assert "# [A]; range -10 .. 10; motor current\nfloat64 current\n" in text
    assert "of the wheel not the motor\nfloat64 speed\n" in text
    assert channel.metadata["speed.unit"] == "rad/s"
    assert channel.metadata["source"] == "sim-servo"


def test_writer_refuses_unknown_stream_or_wrong_rows(
    create: Create, rows: MakeRows, servo: Stream, force: Stream
) -> None:
    with create() as writer:
        with pytest.raises(RecordingError, match="no stream 'wheel'"):
            writer.write("wheel", rows(servo, 1))
        with pytest.raises(RecordingError, match="wrong layout"):
            writer.write("force", rows(servo, 1))
        early = rows(force, 1)
        early["t_ns"] = -1
        with pytest.raises(RecordingError, match="before 1970"):
            writer.write("force", early)
        with pytest.raises(RecordingError, match="event 'odd' cannot be recorded"):
            writer.event(0, "odd", data={"thing": object()})
    with pytest.raises(RecordingError, match="closed"):
        writer.flush()


def test_no_recording_is_overwritten(create: Create, tmp_path: Path) -> None:
    create().close()
    before = (tmp_path / "run.mcap").read_bytes()
    with pytest.raises(RecordingError, match="exists already"):
        create()
    assert (tmp_path / "run.mcap").read_bytes() == before


def test_missing_folder_is_not_reported_as_full_disk(tmp_path: Path) -> None:
    path = tmp_path / "gone" / "run.mcap"
    with pytest.raises(RecordingError, match="No such file or directory") as refused:
        RecordingWriter.create(path, streams=(), metadata={}, attachments=(), start_ns=0)
    assert "folder must be there" in str(refused.value)


def test_recording_removed_while_writing_is_reported_at_flush(
    create: Create, rows: MakeRows, servo: Stream, tmp_path: Path
) -> None:
    writer = create()
    writer.write("wheel_servo", rows(servo, 10))
    writer.flush()
    (tmp_path / "run.mcap").unlink()
    writer.write("wheel_servo", rows(servo, 10))
    with pytest.raises(RecordingError, match=r"run\.mcap was removed or moved"):
        writer.flush()
    writer.close()
    assert list(tmp_path.iterdir()) == []


def test_recording_truncated_while_writing_is_left_to_recover(
    create: Create, rows: MakeRows, servo: Stream, tmp_path: Path
) -> None:
    writer = create()
    for _ in range(5):
        writer.write("wheel_servo", rows(servo, 10_000))
        writer.flush()
    path = tmp_path / "run.mcap"
    whole = path.stat().st_size
    os.truncate(path, whole // 2)
    writer.write("wheel_servo", rows(servo, 10))
    with pytest.raises(RecordingError, match=f"{whole // 2} bytes, .*{whole}"):
        writer.flush()
    writer.close()
    assert path.stat().st_size == whole // 2
    recover(path)
    kept = Recording.open(path).read("wheel_servo")
    assert 0 < len(kept) < 50_000


def test_closing_removes_the_journal(
    create: Create, rows: MakeRows, servo: Stream, tmp_path: Path
) -> None:
    with create() as writer:
        for _ in range(3):
            writer.write("wheel_servo", rows(servo, 10))
            writer.flush()
        assert (tmp_path / "run.mcap.journal").exists()
    assert [path.name for path in tmp_path.iterdir()] == ["run.mcap"]


def test_disk_is_asked_at_most_once_interval(
    create: Create, rows: MakeRows, servo: Stream, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = [0.0]
    calls: list[float] = []
    monkeypatch.setattr("os.fdatasync", lambda fd: calls.append(now[0]))
    with create(sync_interval_s=1.0, clock=lambda: now[0]) as writer:
        for tick in range(1, 31):
            now[0] = tick / 8
            writer.write("wheel_servo", rows(servo, 1))
            writer.flush()
        assert calls == [1.0, 2.0, 3.0]
    assert len(calls) == 4
