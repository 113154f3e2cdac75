"""A file makes rigd neither unpack more bytes than it claims nor more than a bound."""

from __future__ import annotations

import json
import struct
import subprocess
import sys
import time
import zlib
from collections.abc import Callable
from pathlib import Path

import lz4.frame
import numpy as np
import pytest
import zstandard
from mcap.opcode import Opcode
from mcap.writer import CompressionType, Writer
from numpy.typing import NDArray

from rigd.model import ConfigError, RecordingError, Stream
from rigd.record import Recording, RecordingWriter, recover
from rigd.record.events.event import CDR_HEADER, cdr_string, parse_event
from rigd.record.mcap.chunks import index_messages
from rigd.record.mcap.compression import decompress
from rigd.record.mcap.contents import Contents, SummaryWriter
from rigd.record.mcap.wire import DATA_END, FRAME, MAGIC, Malformed, records
from rigd.record.read.brief import brief_info
from rigd.record.repair.verify import verify

Create = Callable[..., RecordingWriter]
MakeRows = Callable[..., NDArray[np.void]]

MIB = 1 << 20
ZEROS = bytes(MIB)


@pytest.fixture
def ours(create: Create, rows: MakeRows, servo: Stream, start_ns: int, tmp_path: Path) -> Path:
    with create() as writer:
        writer.write("wheel_servo", rows(servo, 1_000))
        writer.event(start_ns, "run_start", data={"by": "me"})
    return tmp_path / "run.mcap"


def packed(mib: int, compression: str, *, stated: bool = True) -> bytes:
    """Return so many MiB of zeros, compressed, which state their size or do not."""
    if compression == "zstd":
        size = {"size": mib * MIB} if stated else {}
        part = zstandard.ZstdCompressor(level=1, write_content_size=stated).compressobj(**size)
        return b"".join(part.compress(ZEROS) for _ in range(mib)) + part.flush()
    frame = lz4.frame.LZ4FrameCompressor()
    begin = frame.begin(mib * MIB if stated else 0)
    return bytes(begin + b"".join(frame.compress(ZEROS) for _ in range(mib)) + frame.flush())


def chunk(data: bytes, claimed: int, compression: str) -> bytes:
    """Return a Chunk record without CRC whose head claims ``claimed`` bytes."""
    name = compression.encode()
    head = struct.pack("<QQQII", 1, 2, claimed, 0, len(name)) + name
    content = head + struct.pack("<Q", len(data)) + data
    return FRAME.pack(Opcode.CHUNK, len(content)) + content


def with_more(ours: Path, target: Path, more: bytes) -> Path:
    """Write a recording with more records at the end of its data, without a summary."""
    content = memoryview(ours.read_bytes())
    body = b""
    for record in records(content, len(MAGIC)):
        if record.opcode == Opcode.DATA_END:
            break
        body += content[record.start : record.end]
    target.write_bytes(MAGIC + body + more)
    return target


def with_index(ours: Path, target: Path, change: Callable[[Contents], object]) -> Path:
    """Write a recording whose index is changed, with its right CRC."""
    recording = Recording.open(ours)
    change(recording.contents)
    end = recording.data_end - DATA_END.size
    data = ours.read_bytes()[:end]
    target.write_bytes(data + SummaryWriter(recording.contents).tail(end, zlib.crc32(data), ()))
    return target


#: Runs each function on each file, in a process that may take 48 MiB beside its largest chunk.
CHILD = """
import json, resource, sys, time
from pathlib import Path
from rigd.model import RecordingError
from rigd.record import Recording
from rigd.record import recover
from rigd.record.read.brief import brief_info
from rigd.record.repair.verify import verify

for call in (brief_info, verify, recover):
    try:
        call(Path(sys.argv[1]))  # all modules are imported
    except RecordingError:
        pass
used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
most = used + (int(sys.argv[2]) + 48 << 20)
resource.setrlimit(resource.RLIMIT_AS, (most, most))
found = []
for file in map(Path, sys.argv[3:]):
    for call in (brief_info, lambda path: Recording.open(path, partial=True), verify, recover):
        began = time.process_time()
        try:
            call(file)
            said = "read"
        except RecordingError as error:
            said = str(error)
        except MemoryError:
            said = "MemoryError"
        found.append((file.name, said, time.process_time() - began))
print(json.dumps(found))
"""


def in_child(ours: Path, chunk_mib: int, files: list[Path]) -> list[tuple[str, str, float]]:
    """Return file name, outcome and CPU seconds of each function with each file."""
    command = [sys.executable, "-c", CHILD, str(ours), str(chunk_mib), *map(str, files)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return [tuple(line) for line in json.loads(done.stdout)]


def test_lying_chunk_takes_no_memory(ours: Path, tmp_path: Path) -> None:
    """Files of a few KB whose chunks hold 256 MiB, and claim 1000 bytes."""
    files = [
        with_more(ours, tmp_path / f"{how}{stated}.mcap", chunk(data, 1000, how))
        for how in ("zstd", "lz4")
        for stated in (True, False)
        for data in [packed(256, how, stated=stated)]
    ]
    found = in_child(ours, 0, files)
    assert len(found) == 16
    assert not [name for name, said, _ in found if said == "MemoryError"]
    assert max(cpu_s for _, _, cpu_s in found) < 5


@pytest.mark.parametrize("how", ["zstd", "lz4"])
def test_large_honest_chunk_is_refused_whole(ours: Path, tmp_path: Path, how: str) -> None:
    """`recover` does not leave it out either: it is no damage."""
    file = with_more(ours, tmp_path / "big.mcap", chunk(packed(80, how), 80 * MIB, how))
    content = file.read_bytes()
    for call in (verify, lambda path: Recording.open(path, partial=True), recover):
        with pytest.raises(RecordingError, match=r"big.mcap.*83886080 bytes.*64 MiB") as refused:
            call(file)
        assert "RIGD_CHUNK_MIB=80" in str(refused.value)
    assert file.read_bytes() == content


def test_many_chunks_are_refused_as_sum(ours: Path, tmp_path: Path) -> None:
    bomb = chunk(packed(64, "zstd"), 64 * MIB, "zstd")
    found = in_child(ours, 64, [with_more(ours, tmp_path / "many.mcap", bomb * 400)])
    assert ["1000 times the bytes" in said for _, said, _ in found] == [False, True, True, True]
    assert "the file has no end" in found[0][1]
    assert max(cpu_s for _, _, cpu_s in found) < 5


def message(channel: int, data: bytes = b"") -> bytes:
    return (
        FRAME.pack(Opcode.MESSAGE, 22 + len(data)) + struct.pack("<HIQQ", channel, 0, 1, 1) + data
    )


def test_more_messages_than_bytes_are_refused(
    ours: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A file of 50 KB whose chunks have two million messages."""
    monkeypatch.setenv("RIGD_CHUNK_MIB", "4")
    part = message(2, b"a") + message(2, b"bb")
    data = part * (4 * MIB // len(part))
    bomb = chunk(zstandard.ZstdCompressor(level=1).compress(data), len(data), "zstd")
    found = in_child(ours, 20, [with_more(ours, tmp_path / "many.mcap", bomb * 15)])
    refused = ["more records than the file has bytes" in said for _, said, _ in found]
    assert refused[1:] == [True] * 3
    assert max(cpu_s for _, _, cpu_s in found) < 5


def test_cost_is_not_topics_times_messages() -> None:
    """It was: 60,000 topics took `info` and `verify` over a minute."""
    data = b"".join(message(number) for number in range(20_000)) * 10
    contents = Contents()
    began = time.process_time()
    found = index_messages(data)
    for number in range(60_000):
        contents.add_messages(number, 1, number, number)
    assert time.process_time() - began < 2  # 7 s were needed, 0.1 s are
    assert {len(times) for times, _ in found.values()} == {10}
    assert list(found) == list(range(20_000))
    assert (contents.messages, contents.start_ns, contents.end_ns) == (60_000, 0, 59_999)


def test_large_attachment_is_not_held(ours: Path, tmp_path: Path) -> None:
    head = struct.pack("<QQIIQ", 1, 1, 0, 0, 128 * MIB)
    content = head + bytes(128 * MIB)
    content += struct.pack("<I", zlib.crc32(content))
    more = FRAME.pack(Opcode.ATTACHMENT, len(content)) + content
    # The file is mapped, which counts as memory: `recover` does so twice.
    found = in_child(ours, 288, [with_more(ours, tmp_path / "large.mcap", more)])
    assert [said for _, said, _ in found][1:] == ["read"] * 3


def test_index_that_claims_gigabytes_is_refused(ours: Path, tmp_path: Path) -> None:
    def claim(contents: Contents) -> None:
        for index in contents.chunks:
            index.uncompressed_size = 1 << 30

    file = with_index(ours, tmp_path / "index.mcap", claim)
    with pytest.raises(RecordingError, match="1000 times the bytes of the file"):
        Recording.open(file)


@pytest.mark.parametrize("kind", ["metadata", "attachments", "chunks"])
def test_index_that_repeats_records_is_refused(ours: Path, tmp_path: Path, kind: str) -> None:
    file = with_index(
        ours, tmp_path / "index.mcap", lambda contents: getattr(contents, kind).extend(
            getattr(contents, kind) * 2000
        )
    )  # fmt: skip
    with pytest.raises(RecordingError, match="its index names more bytes than it has"):
        Recording.open(file)


def test_events_of_many_bytes_are_refused(
    create: Create, start_ns: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Objects of Python take 20 times the bytes of their JSON."""
    with create() as writer:
        writer.event(start_ns, "run_start", data={"by": "x" * 2_000_000})
    file = tmp_path / "run.mcap"
    assert len(Recording.open(file).events()) == 1
    monkeypatch.setenv("RIGD_CHUNK_MIB", "4")
    for call in (brief_info, lambda path: Recording.open(path).events()):
        with pytest.raises(RecordingError, match="its events have more than 50 times"):
            call(file)


def test_nested_event_is_a_damaged_one() -> None:
    body = cdr_string("run_end") + struct.pack("<id", -1, 0.0)
    text = CDR_HEADER + body + cdr_string("[" * 100_000)
    with pytest.raises(Malformed, match="a damaged event"):
        parse_event(0, memoryview(text))


def test_asked_bound_permits_what_was_refused(
    ours: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "theirs.mcap"
    with file.open("wb") as out:
        writer = Writer(out, chunk_size=4 * MIB, compression=CompressionType.ZSTD)
        writer.start("", "another")
        channel = writer.register_channel("/a", "cdr", writer.register_schema("", "", b""))
        for number in range(3):
            writer.add_message(channel, number, ZEROS, number)
        writer.finish()  # type: ignore[no-untyped-call]  # the library leaves it untyped
    monkeypatch.setenv("RIGD_CHUNK_MIB", "2")
    with pytest.raises(RecordingError, match="RIGD_CHUNK_MIB=4"):
        verify(file)
    monkeypatch.setenv("RIGD_CHUNK_MIB", "4")
    assert verify(file).rows == {"/a": 3}


@pytest.mark.parametrize("text", ["0", "1.5", "much"])
def test_bound_that_is_none_is_named(
    ours: Path, monkeypatch: pytest.MonkeyPatch, text: str
) -> None:
    monkeypatch.setenv("RIGD_CHUNK_MIB", text)
    with pytest.raises(ConfigError, match=f"RIGD_CHUNK_MIB={text} is no number of MiB"):
        Recording.open(ours)


@pytest.mark.parametrize("size", [0, 1, 4 * MIB, 4 * MIB + 1, 16 * MIB])
@pytest.mark.parametrize("stated", [True, False])
def test_honest_chunk_is_unpacked(size: int, stated: bool) -> None:
    data = (b"".join(number.to_bytes(4, "little") for number in range(1 << 16)) * 65)[:size]
    assert len(data) == size
    small = zstandard.ZstdCompressor(write_content_size=stated).compress(data)
    assert decompress(memoryview(small), "zstd", size) == data
    small = lz4.frame.compress(data, store_size=stated, content_checksum=True)
    assert decompress(memoryview(small), "lz4", size) == data
    for wrong in (size + 1, max(size - 1, 0)):
        if wrong != size:
            with pytest.raises(Malformed):
                decompress(memoryview(small), "lz4", wrong)


def test_chunk_of_zeros_ends_early() -> None:
    """Else 64 MiB of zeros, 2 KB in the file, are seven million records."""
    with pytest.raises(Malformed, match="no record begins at byte 0"):
        index_messages(bytes(100))
