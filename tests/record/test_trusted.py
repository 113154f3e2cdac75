"""Bytes that are trusted are walked faster, and lead to the same file."""

from __future__ import annotations

import random
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from rigd.model import Stream
from rigd.record import Recording, RecordingWriter, recover


@pytest.fixture
def sealed_and_path(
    create: Callable[..., RecordingWriter], rows: Callable[..., Any], servo: Stream, force: Stream
) -> tuple[int, Path]:
    """A recording of several sealed chunks, as it is while it is being written."""
    writer = create()
    blocks = {stream.name: rows(stream, 6000) for stream in (servo, force)}
    for start in range(0, 6000, 50):
        for name, block in blocks.items():
            writer.write(name, block[start : start + 50])
        writer.event(int(block["t_ns"][start]), "note", 0, {"start": start})
        writer.flush()
    path = Path(writer._file.path)
    shutil.copy(path, path.with_name("as_killed.mcap"))
    sealed = writer.sealed
    writer.close()
    return sealed, path.with_name("as_killed.mcap")


def test_torn_file_is_repaired_to_same_bytes(sealed_and_path: tuple[int, Path]) -> None:
    sealed, path = sealed_and_path
    whole = path.read_bytes()
    assert 100_000 < sealed < len(whole)
    other = path.with_name("other.mcap")
    random_ = random.Random(3)
    for size in [sealed, len(whole), *(random_.randrange(sealed, len(whole)) for _ in range(30))]:
        path.write_bytes(whole[:size])
        other.write_bytes(whole[:size])
        report = recover(path, trusted=sealed)
        assert report.rows_kept == recover(other).rows_kept
        assert path.read_bytes() == other.read_bytes()


def test_going_on_with_trusted_file_makes_same_bytes(
    sealed_and_path: tuple[int, Path], rows: Callable[..., Any], servo: Stream, force: Stream
) -> None:
    sealed, path = sealed_and_path
    other = path.with_name("other.mcap")
    shutil.copy(path, other)
    more = rows(servo, 100, seed=2)
    more["t_ns"] += 10_000_000_000
    for item, trusted in ((path, sealed), (other, 0)):
        with RecordingWriter.append(item, streams=(servo, force), trusted=trusted) as writer:
            writer.write("wheel_servo", more)
    assert path.read_bytes() == other.read_bytes()
    assert Recording.open(path).count("wheel_servo") == 6100


def test_damage_after_the_trusted_part_is_found(sealed_and_path: tuple[int, Path]) -> None:
    sealed, path = sealed_and_path
    content = bytearray(path.read_bytes())
    content[sealed + 2000] ^= 1
    path.write_bytes(content)
    report = recover(path, trusted=sealed)
    assert not report.intact
    assert "CRC" in report.problem
