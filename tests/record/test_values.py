"""Every value of a row, status words too, is the same bit for bit in the readers of others."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from numpy.typing import NDArray
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from rigd.model import Channel, Stream
from rigd.record import Recording, RecordingWriter
from rigd.record.mcap.compression import Compression
from rigd.record.mcap.crc import crc32

Create = Callable[..., RecordingWriter]
MakeRows = Callable[..., NDArray[np.void]]

STATUS_ONE = Stream("io/card_1", (Channel("x"),), has_status=True)
STATUS_TWO = Stream("drive", (Channel("a"), Channel("b")), has_status=True)
PLAIN = Stream("many", tuple(Channel(f"c{index}") for index in range(40)))
STREAMS = (STATUS_ONE, STATUS_TWO, PLAIN)

#: Zeros, ends of the range, denormals, infinities, and NaNs with a payload and a sign.
ODD_BITS = np.array(
    [
        0x0000000000000000, 0x8000000000000000, 0x0000000000000001, 0x7FEFFFFFFFFFFFFF,
        0x7FF0000000000000, 0xFFF0000000000000, 0x7FF8000000000000, 0xFFF8000000000123,
    ],
    "<u8",
)  # fmt: skip


def odd_rows(rows: MakeRows, stream: Stream) -> NDArray[np.void]:
    given = rows(stream, 1_300, seed=len(stream.channels))
    for position, channel in enumerate(stream.channels):
        given[channel.name][position : position + 8] = ODD_BITS.view("<f8")
    if stream.has_status:
        given["status"][:4] = [0, 1, 0x80000000, 0xFFFFFFFF]
    return given


@pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
def test_all_readers_return_equal_values(
    create: Create, rows: MakeRows, tmp_path: Path, compression: Compression
) -> None:
    path = tmp_path / "run.mcap"
    given = {stream.name: odd_rows(rows, stream) for stream in STREAMS}
    with create(streams=STREAMS, compression=compression) as writer:
        for start in range(0, 1_300, 90):
            for name, item in given.items():
                writer.write(name, item[start : start + 90])
    recording = Recording.open(path)
    typestore = get_typestore(Stores.EMPTY)
    for stream in STREAMS:
        expected = given[stream.name]
        assert recording.read(stream.name).tobytes() == expected.tobytes()
        with path.open("rb") as file:
            reader = make_reader(file, validate_crcs=True)
            payloads = [message.data for _, _, message in reader.iter_messages(f"/{stream.name}")]
        assert payloads == [b"\x00\x01\x00\x00" + row.tobytes()[8:] for row in expected]
        with AnyReader([path], default_typestore=typestore) as bag:
            connections = [item for item in bag.connections if item.topic == f"/{stream.name}"]
            found: list[tuple[int, Any]] = [
                (t_ns, bag.deserialize(raw, connection.msgtype))
                for connection, t_ns, raw in bag.messages(connections)
            ]
        assert [t_ns for t_ns, _ in found] == expected["t_ns"].tolist()
        for channel in stream.channels:
            column = np.array([getattr(item, channel.name) for _, item in found], "<f8")
            assert column.tobytes() == expected[channel.name].tobytes()
        if stream.has_status:
            assert [item.status for _, item in found] == expected["status"].tolist()


def test_rows_with_gaps_between_them_are_taken_too(
    create: Create, rows: MakeRows, tmp_path: Path
) -> None:
    given = rows(STATUS_TWO, 3_000)
    with create(streams=STREAMS) as writer:
        for start in range(0, 3_000, 300):
            writer.write("drive", given[start : start + 300 : 3])
    assert Recording.open(tmp_path / "run.mcap").read("drive").tobytes() == given[::3].tobytes()


@pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
def test_array_may_be_reused_after_each_call(
    create: Create, rows: MakeRows, tmp_path: Path, compression: Compression
) -> None:
    """Neither the caller's array nor one of the writer's own is read after it has changed."""
    given = rows(PLAIN, 20_000, rate_hz=50_000.0)
    buffer = given[:700].copy()
    with create(streams=STREAMS, compression=compression) as writer:
        for start in range(0, 20_000, 700):
            part = given[start : start + 700]
            buffer[: len(part)] = part
            writer.write("many", buffer[: len(part)])
            buffer["c0"] = -1.0
    path = tmp_path / "run.mcap"
    assert Recording.open(path).read("many").tobytes() == given.tobytes()
    with path.open("rb") as file:
        messages = make_reader(file, validate_crcs=True).iter_messages()
        assert [message.sequence for _, _, message in messages] == list(range(20_000))


def test_the_crc_is_that_of_the_format() -> None:
    """The check value of CRC-32 (https://reveng.sourceforge.io/crc-catalogue/all.htm)."""
    assert crc32(b"123456789") == 0xCBF43926
    assert crc32(b"6789", crc32(b"12345")) == 0xCBF43926
