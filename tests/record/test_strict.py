"""Foxglove's own reader (npm @mcap/core) agrees with every offset, length and CRC."""

from __future__ import annotations

import hashlib
import json
import subprocess
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from rigd.model import Stream
from rigd.record import Recording, RecordingWriter, recover
from rigd.record.mcap.compression import Compression
from rigd.record.mcap.wire import DATA_END, encode_data_end

Create = Callable[..., RecordingWriter]
MakeRows = Callable[..., NDArray[np.void]]
Check = Callable[[Path], dict[str, Any]]

STRICT = Path(__file__).parent / "strict"


@pytest.fixture
def check(node_packages: tuple[str, Path]) -> Check:
    """Runs check.mjs on a file."""
    node, packages = node_packages

    def run(path: Path) -> dict[str, Any]:
        command = [node, str(STRICT / "check.mjs"), str(packages), str(path)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        topics: dict[str, Any] = json.loads(done.stdout)
        return topics

    return run


def digest(rows: NDArray[np.void]) -> dict[str, Any]:
    """Return what check.mjs reports on a topic that holds ``rows``."""
    hashed = hashlib.sha256()
    for row in rows:
        encoded = row.tobytes()
        hashed.update(encoded[:8] + b"\x00\x01\x00\x00" + encoded[8:])
    return {"count": len(rows), "sha256": hashed.hexdigest()}


@pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
def test_closed_recordings_pass_the_strict_check(
    check: Check,
    create: Create,
    rows: MakeRows,
    servo: Stream,
    force: Stream,
    start_ns: int,
    tmp_path: Path,
    compression: Compression,
) -> None:
    moved, pressed = rows(servo, 3_300), rows(force, 400, rate_hz=100.0)
    with create(compression=compression) as writer:
        writer.event(start_ns, "run_start")
        for start in range(0, 3_300, 300):
            writer.write("wheel_servo", moved[start : start + 300])
        writer.write("force", pressed)
    topics = check(tmp_path / "run.mcap")
    assert topics["/wheel_servo"] == digest(moved)
    assert topics["/force"] == digest(pressed)
    assert topics["/events"]["count"] == 1


def test_a_recording_without_messages(check: Check, create: Create, tmp_path: Path) -> None:
    create().close()
    assert check(tmp_path / "run.mcap") == {}


def test_recordings_while_they_are_written(
    check: Check, create: Create, rows: MakeRows, servo: Stream, force: Stream, tmp_path: Path
) -> None:
    moved, pressed = rows(servo, 2_100), rows(force, 2_100)
    with create() as writer:
        for start in range(0, 2_100, 700):
            writer.write("wheel_servo", moved[start : start + 700])
            writer.write("force", pressed[start : start + 700])
            writer.flush()
            topics = check(tmp_path / "run.mcap")
            assert topics["/wheel_servo"] == digest(moved[: start + 700])
            assert topics["/force"] == digest(pressed[: start + 700])


def test_recovered_and_continued_recordings(
    check: Check, create: Create, rows: MakeRows, servo: Stream, force: Stream, tmp_path: Path
) -> None:
    path = tmp_path / "run.mcap"
    moved = rows(servo, 4_000)
    with create() as writer:
        writer.write("wheel_servo", moved[:2_500])
    last = Recording.open(path).contents.chunks[-1]
    # In the message index behind the last chunk, which recovery must rebuild.
    path.write_bytes(path.read_bytes()[: last.chunk_start_offset + last.chunk_length + 500])
    recover(path)
    assert check(path)["/wheel_servo"] == digest(moved[:2_500])
    with RecordingWriter.append(path, streams=(servo, force)) as writer:
        writer.write("wheel_servo", moved[2_500:])
    assert check(path)["/wheel_servo"] == digest(moved)


def test_strict_check_finds_a_wrong_offset(
    check: Check, create: Create, rows: MakeRows, servo: Stream, tmp_path: Path
) -> None:
    path = tmp_path / "run.mcap"
    with create(compression="none") as writer:
        writer.write("wheel_servo", rows(servo, 100))
    chunk = Recording.open(path).contents.chunks[-1]
    content = bytearray(path.read_bytes())
    content[chunk.chunk_start_offset + chunk.chunk_length + 15 + 8] ^= 1  # first offset
    path.write_bytes(content)
    with pytest.raises(AssertionError, match="CRC of the data section"):
        check(path)
    end = Recording.open(path).data_end - DATA_END.size
    content[end : end + DATA_END.size] = encode_data_end(zlib.crc32(content[:end]))
    path.write_bytes(content)
    with pytest.raises(AssertionError, match="no message at 1 of the chunk"):
        check(path)
