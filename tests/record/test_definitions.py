"""Definitions of channels that are damaged twice, in the data and in the summary, cost no row."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from mcap.opcode import Opcode
from mcap.reader import make_reader
from numpy.typing import NDArray

from rigd.model import Stream
from rigd.record import Recording, RecordingWriter, recover, verify
from rigd.record.mcap.wire import Record, records

Create = Callable[..., RecordingWriter]
MakeRows = Callable[..., NDArray[np.void]]
Change = Callable[[bytes], bytes]

COUNT = 300


@pytest.fixture
def path(
    create: Create, rows: MakeRows, servo: Stream, force: Stream, start_ns: int, tmp_path: Path
) -> Path:
    with create() as writer:
        writer.event(start_ns, "run_start")
        for stream in (servo, force):
            writer.write(stream.name, rows(stream, COUNT))
        writer.event(start_ns + 10**9, "run_end", None, {"state": "complete"})
    return tmp_path / "run.mcap"


def definitions(path: Path, opcode: int) -> list[list[Record]]:
    """Return the schemas or channels in order, each with its copy in the summary.

    Of events, wheel_servo, force, and of what viewers read of trials.
    """
    end = Recording.open(path).data_end
    found = [
        record
        for record in records(memoryview(path.read_bytes())[:-8], 8)
        if record.opcode == opcode
    ]
    assert len([item for item in found if item.start < end]) == 4
    return [[found[number], found[4 + number]] for number in range(4)]


def spoil(path: Path, copies: list[Record], changed: Change) -> bytes:
    content = bytearray(path.read_bytes())
    for copy in copies:
        before = bytes(content[copy.start : copy.end])
        after = changed(before)
        assert len(after) == len(before) and after != before
        content[copy.start : copy.end] = after
    path.write_bytes(content)
    return bytes(content)


def wiped(record: bytes) -> bytes:
    return bytes(len(record))


def other_topic(record: bytes) -> bytes:
    return record.replace(b"/", b"x", 1)


def other_number(record: bytes) -> bytes:
    return record[:9] + b"\x63" + record[10:]


def torn_json(record: bytes) -> bytes:
    return record.replace(b'"channels"', b'"ch\0nnels"')


def other_opcode(record: bytes) -> bytes:
    return b"\x0f" + record[1:]


def check(path: Path, damaged: bytes, given: dict[str, bytes]) -> Recording:
    """Recover twice; every row is there under its name, for other readers, too."""
    assert not verify(path).sound
    report = recover(path)
    assert report.original is not None
    assert report.original.read_bytes() == damaged
    repaired = path.read_bytes()
    assert recover(path).intact
    assert path.read_bytes() == repaired
    recording = Recording.open(path)
    assert {name: recording.read(name).tobytes() for name in recording.streams} == given
    assert [event.kind for event in recording.events()] == ["run_start", "run_end"]
    with path.open("rb") as file:
        messages = sum(1 for _ in make_reader(file, validate_crcs=True).iter_messages())
    assert messages == 2 * COUNT + 2
    return recording


CASES = [
    *((number, change) for number in range(3) for change in (wiped, other_topic, other_number)),
    *((number, other_opcode) for number in range(3)),
    *((number, torn_json) for number in (1, 2)),
]


@pytest.mark.parametrize(("number", "change"), CASES)
def test_a_channel_damaged_twice_keeps_its_names(
    path: Path, rows: MakeRows, servo: Stream, force: Stream, number: int, change: Change
) -> None:
    given = {item.name: rows(item, COUNT).tobytes() for item in (servo, force)}
    damaged = spoil(path, definitions(path, Opcode.CHANNEL)[number], change)
    recording = check(path, damaged, given)
    for stream in (servo, force):
        names = [
            (channel.name, channel.unit, channel.low, channel.high) for channel in stream.channels
        ]
        found = recording.streams[stream.name].channels
        assert [(item.name, item.unit, item.low, item.high) for item in found] == names


@pytest.mark.parametrize("number", range(3))
@pytest.mark.parametrize("change", [wiped, other_number, other_opcode])
def test_a_schema_damaged_twice_costs_no_row(
    path: Path, rows: MakeRows, servo: Stream, force: Stream, number: int, change: Change
) -> None:
    given = {item.name: rows(item, COUNT).tobytes() for item in (servo, force)}
    check(path, spoil(path, definitions(path, Opcode.SCHEMA)[number], change), given)


def test_rows_without_any_definition_are_unnamed(
    path: Path, rows: MakeRows, servo: Stream, force: Stream
) -> None:
    copies = [*definitions(path, Opcode.SCHEMA)[2], *definitions(path, Opcode.CHANNEL)[2]]
    damaged = spoil(path, copies, wiped)
    found = verify(path).lines()
    assert any("channel 3 is lost: its rows are kept as /unnamed_3" in line for line in found)
    given = {"wheel_servo": rows(servo, COUNT), "unnamed_3": rows(force, COUNT)}
    check(path, damaged, {name: block.tobytes() for name, block in given.items()})


def test_schema_that_looks_like_end_hides_no_row(
    path: Path, rows: MakeRows, servo: Stream, force: Stream
) -> None:
    """One byte of the file; its summary is sound."""
    given = {item.name: rows(item, COUNT).tobytes() for item in (servo, force)}
    damaged = spoil(path, definitions(path, Opcode.SCHEMA)[0][:1], other_opcode)
    check(path, damaged, given)
