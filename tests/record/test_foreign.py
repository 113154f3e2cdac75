"""Files that something else wrote are read if that is valid, and else refused."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from numpy.typing import NDArray

from rigd.cli.main import main
from rigd.model import RecordingError, Stream
from rigd.record import Recording, RecordingWriter, recover
from rigd.record.export import Format, export
from rigd.record.mcap.chunks import ChunkHead, unpack_chunk

Create = Callable[..., RecordingWriter]
MakeRows = Callable[..., NDArray[np.void]]


def repack(source: Path, target: Path, **options: object) -> None:
    """Write all messages of a file again with the mcap library, in order of time."""
    with source.open("rb") as file, target.open("wb") as out:
        writer = Writer(out, **options)  # type: ignore[arg-type]  # any of its keywords
        writer.start("ros2", "another")
        numbers: dict[int, int] = {}
        for schema, channel, message in make_reader(file).iter_messages():
            assert schema is not None
            if channel.id not in numbers:
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                numbers[channel.id] = writer.register_channel(
                    channel.topic, channel.message_encoding, number, channel.metadata
                )
            writer.add_message(
                numbers[channel.id],
                message.log_time,
                message.data,
                message.publish_time,
                message.sequence,
            )
        writer.finish()  # type: ignore[no-untyped-call]  # the library leaves it untyped


@pytest.fixture
def ours(
    create: Create, rows: MakeRows, servo: Stream, force: Stream, start_ns: int, tmp_path: Path
) -> Path:
    with create() as writer:
        writer.write("wheel_servo", rows(servo, 2_500))
        writer.write("force", rows(force, 2_500, seed=3))
        writer.event(start_ns, "run_start", data={"by": "me"})
    return tmp_path / "run.mcap"


@pytest.mark.parametrize("compression", list(CompressionType))
def test_a_repacked_recording_reads_the_same(
    ours: Path, tmp_path: Path, compression: CompressionType
) -> None:
    """Another tool mixes the streams within its chunks."""
    theirs = tmp_path / "theirs.mcap"
    repack(ours, theirs, compression=compression, chunk_size=100_000)
    expected, recording = Recording.open(ours), Recording.open(theirs)
    assert recording.streams == expected.streams
    for name in expected.streams:
        assert recording.read(name).tobytes() == expected.read(name).tobytes()
    assert recording.events() == expected.events()
    assert not recording.written_by_rigd


@pytest.mark.parametrize("chunk_size", [200, 100_000, 1 << 30])
def test_window_of_mixed_chunks_has_its_rows(ours: Path, tmp_path: Path, chunk_size: int) -> None:
    theirs = tmp_path / "theirs.mcap"
    repack(ours, theirs, chunk_size=chunk_size)
    expected, recording = Recording.open(ours), Recording.open(theirs)
    first, last = expected.start_ns, expected.end_ns
    low, high = (first + share * (last - first) // 4 for share in (1, 3))
    for name in expected.streams:
        rows = recording.read(name, low, high)
        assert len(rows)
        assert rows.tobytes() == expected.read(name, low, high).tobytes()


def test_mixed_chunk_is_unpacked_once(
    ours: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each stream and each trial reads the same chunks: unpacking them costs the most."""
    theirs = tmp_path / "theirs.mcap"
    repack(ours, theirs, chunk_size=1 << 30)
    unpacked = []

    def counted(head: ChunkHead, *, check_crc: bool = True) -> bytes | memoryview:
        unpacked.append(head.size)
        return unpack_chunk(head, check_crc=check_crc)

    monkeypatch.setattr("rigd.record.read.rows.unpack_chunk", counted)
    recording = Recording.open(theirs)
    for name in (*recording.streams, *recording.streams):
        recording.read(name)
    recording.events()
    assert len(unpacked) == 1


def test_changed_chunk_is_not_served_from_memory(ours: Path, tmp_path: Path) -> None:
    theirs = tmp_path / "theirs.mcap"
    repack(ours, theirs, compression=CompressionType.NONE)
    recording = Recording.open(theirs)
    recording.read("force")
    content = bytearray(theirs.read_bytes())
    chunk = recording.contents.chunks[0]
    content[chunk.chunk_start_offset + 9 + 24] ^= 1  # the CRC of the chunk
    theirs.write_bytes(content)
    with pytest.raises(RecordingError, match="CRC"):
        recording.read("force")


def test_cut_foreign_file_is_read_and_recovered(ours: Path, tmp_path: Path) -> None:
    theirs = tmp_path / "theirs.mcap"
    repack(ours, theirs, chunk_size=100_000)
    assert recover(theirs).intact
    chunk = Recording.open(theirs).contents.chunks[1]
    content = theirs.read_bytes()[: chunk.chunk_start_offset + chunk.chunk_length + 40]
    theirs.write_bytes(content)
    expected = Recording.open(ours).read("force")
    read = Recording.open(theirs, partial=True).read("force")
    assert 0 < len(read) < len(expected)
    assert read.tobytes() == expected[: len(read)].tobytes()
    with pytest.raises(RecordingError, match="was written by 'another' and is damaged"):
        recover(theirs, others=False)
    assert theirs.read_bytes() == content
    report = recover(theirs)
    assert report.original is not None
    assert report.original.read_bytes() == content
    assert Recording.open(theirs).read("force").tobytes() == read.tobytes()


def test_plain_ros2_messages_of_float64_are_columns(tmp_path: Path) -> None:
    path = tmp_path / "foreign.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start("ros2")
        point = writer.register_schema("a/msg/P", "ros2msg", b"# here\nfloat64 x  # m\nfloat64 y\n")
        text = writer.register_schema("a/msg/S", "ros2msg", b"string data\n")
        points = writer.register_channel("/arm/tip", "cdr", point)
        words = writer.register_channel("/words", "cdr", text)
        for number in range(3):
            payload = b"\x00\x01\x00\x00" + np.array([number, -number], "<f8").tobytes()
            writer.add_message(points, number, payload, number)
            writer.add_message(words, number, b"\x00\x01\x00\x00", number)
        writer.finish()  # type: ignore[no-untyped-call]  # the library leaves it untyped
    recording = Recording.open(path)
    assert list(recording.streams) == ["arm/tip"]
    assert recording.other_topics == ("/words",)
    assert recording.read("arm/tip")["y"].tolist() == [0.0, -1.0, -2.0]
    assert recording.events() == []
    with pytest.raises(RecordingError, match="no stream 'words'"):
        recording.read("words")


def write_two_channels(path: Path, chunk_size: int, second: bytes = b"float64 x\n") -> None:
    """Ten messages of a channel, from 1 on, and three of another of the topic between them."""
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=chunk_size)
        writer.start("ros2")
        channels = [
            writer.register_channel("/p", "cdr", writer.register_schema(name, "ros2msg", text))
            for name, text in (("a/msg/P", b"float64 x\n"), ("a/msg/Q", second))
        ]
        for t_ns in range(1, 14):
            payload = b"\x00\x01\x00\x00" + np.array([t_ns], "<f8").tobytes()
            writer.add_message(channels[t_ns % 4 == 0], t_ns, payload, t_ns)
        writer.finish()  # type: ignore[no-untyped-call]  # the library leaves it untyped


@pytest.mark.parametrize("chunk_size", [1, 1 << 20])
def test_two_channels_of_a_topic_are_one(tmp_path: Path, chunk_size: int) -> None:
    write_two_channels(tmp_path / "merged.mcap", chunk_size)
    recording = Recording.open(tmp_path / "merged.mcap")
    assert recording.count("p") == 13
    assert recording.read("p")["x"].tolist() == list(range(1, 14))
    assert recording.other_topics == ()


def test_channels_of_a_topic_that_differ_stay(tmp_path: Path) -> None:
    write_two_channels(tmp_path / "merged.mcap", 1 << 20, b"float64 y\n")
    recording = Recording.open(tmp_path / "merged.mcap")
    assert recording.read("p")["x"].tolist() == [1, 2, 3, 5, 6, 7, 9, 10, 11, 13]
    assert recording.other_topics == ("/p",)


def test_topics_that_cannot_be_read_are_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_two_channels(path := tmp_path / "merged.mcap", 1 << 20, b"float64 y\n")
    assert main(["info", str(path)]) == 0
    assert "not read    /p (cdr a/msg/Q, 3 messages)\n" in capsys.readouterr().out
    target = ["--to", "csv", "--output", str(tmp_path / "out")]
    assert main(["export", str(path), *target]) == 0
    told = f"warning: {path}: not exported, because rigd cannot read them as columns: /p (cdr "
    assert told in capsys.readouterr().err


@pytest.mark.parametrize("format", ["csv", "parquet", "mat"])
def test_streams_of_one_file_name_are_refused(tmp_path: Path, format: Format) -> None:
    with (tmp_path / "two.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start("ros2")
        schema = writer.register_schema("a/msg/P", "ros2msg", b"float64 x\n")
        for topic in ("/imu/left", "/imu.left"):
            channel = writer.register_channel(topic, "cdr", schema)
            writer.add_message(channel, 1, b"\x00\x01\x00\x00" + bytes(8), 1)
        writer.finish()  # type: ignore[no-untyped-call]  # the library leaves it untyped
    recording, out = Recording.open(tmp_path / "two.mcap"), tmp_path / "out"
    with pytest.raises(RecordingError, match=r"'imu/left' and 'imu\.left' would both be imu\.left"):
        export(recording, out, format)
    assert not out.exists()
    assert export(recording, out, format, streams=["imu.left"])


def test_no_flipped_byte_goes_unnoticed(ours: Path) -> None:
    """With any byte wrong: an error, or the same rows; never other rows, never a crash.

    Walking the file finds every wrong byte, as the CRC of the data section covers all.
    """
    rows = Recording.open(ours).read("wheel_servo")
    expected, whole = rows.tobytes(), {row.tobytes() for row in rows}
    content = bytearray(ours.read_bytes())
    places = np.random.default_rng(11).integers(0, len(content), 300)
    noticed = 0
    for place in map(int, places):
        content[place] ^= 0x41
        ours.write_bytes(content)
        content[place] ^= 0x41
        try:
            assert Recording.open(ours).read("wheel_servo").tobytes() == expected
        except RecordingError:
            noticed += 1
        try:
            found = Recording.open(ours, partial=True)
            assert found.problem
            read = found.read("wheel_servo")
            assert len({row.tobytes() for row in read} & whole) == len(read)
            assert (np.diff(read["t_ns"]) > 0).all()
        except RecordingError:
            noticed += 1
    assert noticed > 50
