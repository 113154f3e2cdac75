"""After any damage, every row of every chunk that is not touched is read, bit for bit.

Each damage is done to one of two recordings; `benchmarks/every_case.py` does it to both.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from numpy.typing import NDArray
from support.cases import some

from rigd.model import Channel, RecordingError, Stream
from rigd.record import Attachment, Recording, RecordingWriter, recover
from rigd.record.mcap.compression import Compression

Rows = NDArray[np.void]
Create = Callable[..., RecordingWriter]
MakeRows = Callable[..., Rows]

#: Wide, so that few rows fill a chunk.
FAST = Stream("fast", tuple(Channel(f"c{i}", "N") for i in range(60)), has_status=True)
SLOW = Stream("slow", tuple(Channel(f"v{i}", "V") for i in range(120)))
STREAMS = (FAST, SLOW)
SECONDS = 9
RATE_HZ = 100.0


@dataclass(frozen=True)
class Whole:
    """A sound recording: its bytes, rows by stream, and where each chunk stands."""

    content: bytes
    rows: Mapping[str, Rows]
    recording: Recording
    compression: Compression

    @cached_property
    def places(self) -> dict[str, dict[bytes, int]]:
        """The place of each row in its stream, by the row's bytes."""
        return {
            name: {row.tobytes(): place for place, row in enumerate(rows)}
            for name, rows in self.rows.items()
        }

    def untouched(self, damaged: bytes) -> dict[str, list[bytes]]:
        """Return the rows, as bytes, of chunks that are as they were, by stream."""
        found: dict[str, list[bytes]] = {name: [] for name in self.rows}
        names = {n: c.topic[1:] for n, c in self.recording.contents.channels.items()}
        for chunk in self.recording.contents.chunks:
            begin, end = chunk.chunk_start_offset, chunk.chunk_start_offset + chunk.chunk_length
            (channel,) = chunk.message_index_offsets
            if damaged[begin:end] != self.content[begin:end] or names[channel] not in self.rows:
                continue
            rows = self.rows[names[channel]]
            times = rows["t_ns"]
            inside = (times >= chunk.message_start_time) & (times <= chunk.message_end_time)
            found[names[channel]] += [row.tobytes() for row in rows[inside]]
        return found


def record(create: Create, rows: MakeRows, start_ns: int, compression: Compression) -> None:
    """Record three trials of two seconds, one after the other."""
    given = {
        stream.name: rows(stream, int(SECONDS * RATE_HZ), rate_hz=RATE_HZ) for stream in STREAMS
    }
    attached = Attachment("procedure.yaml", "application/yaml", b"procedure: sweep\n")
    with create(streams=STREAMS, compression=compression, attachments=(attached,)) as writer:
        writer.event(start_ns, "run_start")
        for second in range(SECONDS):
            at = start_ns + second * 1_000_000_000
            if 1 <= second <= 7 and second % 2:
                if second > 1:
                    writer.event(at, "trial_end", second // 2, {"complete": True})
                if second < 7:
                    writer.event(at, "trial_start", second // 2 + 1, {"parameters": {}})
            for name, block in given.items():
                writer.write(name, block[second * 100 : second * 100 + 100])
        writer.event(start_ns + SECONDS * 1_000_000_000, "run_end", None, {"state": "complete"})


@pytest.fixture(params=["zstd", "none"])
def whole(
    request: pytest.FixtureRequest, create: Create, rows: MakeRows, start_ns: int, tmp_path: Path
) -> Whole:
    record(create, rows, start_ns, request.param)
    path = tmp_path / "run.mcap"
    recording = Recording.open(path)
    assert len(recording.contents.chunks) >= 2 * SECONDS - 2
    given = {
        stream.name: rows(stream, int(SECONDS * RATE_HZ), rate_hz=RATE_HZ) for stream in STREAMS
    }
    for name, block in given.items():
        assert recording.read(name).tobytes() == block.tobytes()
    return Whole(path.read_bytes(), given, recording, request.param)


def rows_of(recording: Recording) -> dict[str, list[bytes]]:
    return {
        name: [row.tobytes() for row in recording.read(name)]
        for name in (stream.name for stream in STREAMS)
        if name in recording.streams
    }


def rows_by_mcap(path: Path) -> dict[str, list[bytes]]:
    """Return the rows as another reader has them, every CRC checked."""
    found: dict[str, list[bytes]] = {stream.name: [] for stream in STREAMS}
    with path.open("rb") as file:
        for _, channel, message in make_reader(file, validate_crcs=True).iter_messages():
            if channel.topic[1:] in found:
                time = message.log_time.to_bytes(8, "little")
                found[channel.topic[1:]].append(time + message.data[4:])
    return found


def check(whole: Whole, damaged: bytes, path: Path) -> None:
    """Assert that nothing untouched is lost, and that what is lost is reported."""
    path.write_bytes(damaged)
    expected = whole.untouched(damaged)
    passed_over = Recording.open(path, partial=True)
    rows_before = rows_of(passed_over)
    report = recover(path)
    repaired = Recording.open(path)
    for read in (rows_before, rows_of(repaired), rows_by_mcap(path)):
        for name, rows in expected.items():
            got = read.get(name, [])
            assert set(rows) <= set(got), f"rows of {name} are lost"
            order = [whole.places[name][row] for row in got]  # a KeyError: never recorded
            assert order == sorted(set(order)), f"rows of {name} twice or out of order"
    assert recover(path).intact
    if report.original is not None:
        assert report.original.read_bytes() == damaged
    elif not report.intact:
        # Completed in place: nothing that was in the file is gone but its end.
        assert path.read_bytes().startswith(damaged[: passed_over.data_end])
    said(whole, repaired)


def said(whole: Whole, repaired: Recording) -> None:
    """Assert that a trial that lost a row is not complete."""
    for trial in repaired.trials:
        if not trial.complete:
            continue
        for name, given in whole.rows.items():
            inside = (given["t_ns"] >= trial.start_ns) & (given["t_ns"] < trial.end_ns)
            assert len(trial[name]) == int(inside.sum()), f"{trial} lacks rows of {name}"


def flips(content: bytes, random_: random.Random, count: int) -> bytes:
    damaged = bytearray(content)
    for _ in range(count):
        damaged[random_.randrange(len(content))] ^= random_.randrange(1, 256)
    return bytes(damaged)


def zeros(content: bytes, random_: random.Random) -> bytes:
    start = random_.randrange(len(content))
    end = start + random_.choice((1, 13, 512, 4096, 65536))
    return content[:start] + bytes(len(content[start:end])) + content[end:]


@pytest.mark.parametrize("seed", some(range(4), 2))
def test_random_damage_costs_only_the_chunks_it_touches(
    whole: Whole, tmp_path: Path, seed: int
) -> None:
    random_ = random.Random(seed)
    for number in range(10):
        damaged = whole.content
        for kind in random_.sample(("flip", "flips", "zeros", "cut"), random_.choice((1, 1, 2))):
            if kind == "flip":
                damaged = flips(damaged, random_, 1)
            elif kind == "flips":
                damaged = flips(damaged, random_, random_.randrange(2, 9))
            elif kind == "zeros":
                damaged = zeros(damaged, random_)
            else:
                damaged = damaged[: random_.randrange(len(damaged) // 3, len(damaged))]
        check(whole, damaged, tmp_path / f"damaged{number}.mcap")


def places(recording: Recording, content: bytes) -> dict[str, int]:
    """Return a byte of each part of a recording that has a meaning of its own."""
    contents = recording.contents
    chunk = contents.chunks[len(contents.chunks) // 2]
    start, index = chunk.chunk_start_offset, chunk.chunk_start_offset + chunk.chunk_length
    schema = content.index(b"\x03", 8 + 9)
    attachment, metadata = contents.attachments[0], contents.metadata[0]
    end = recording.data_end
    return {
        "magic": 2,
        "header opcode": 8,
        "header length": 9,
        "library": 8 + 9 + 4 + 4 + 4 + 3,
        "schema": schema + 20,
        "schema length": schema + 1,
        "attachment": attachment.offset + attachment.length - 10,
        "attachment length": attachment.offset + 2,
        "metadata": metadata.offset + 20,
        "metadata length": metadata.offset + 1,
        "chunk opcode": start,
        "chunk length, low": start + 1,
        "chunk length, high": start + 6,
        "chunk start time": start + 9,
        "chunk end time": start + 17,
        "chunk size": start + 25,
        "chunk CRC": start + 33,
        "compression name": start + 41,
        "chunk data": start + 80,
        "message index opcode": index,
        "message index length": index + 1,
        "message index channel": index + 9,
        "message index time": index + 15 + 3,
        "message index offset": index + 15 + 8,
        "DataEnd": end - 13,
        "DataEnd CRC": end - 3,
        "summary": end + 30,
        "footer": len(content) - 8 - 15,
        "last magic": len(content) - 3,
    }


def test_damage_in_every_part_of_a_file(whole: Whole, tmp_path: Path) -> None:
    parts = places(whole.recording, whole.content).items()
    cases = [(*part, size) for part in parts for size in (1, 9)]
    for name, place, size in some(cases, 2, begin=whole.compression == "none"):
        damaged = bytearray(whole.content)
        for byte in range(place, min(place + size, len(damaged))):
            damaged[byte] ^= 0x15
        try:
            check(whole, bytes(damaged), tmp_path / f"{name} {size}.mcap".replace(" ", "_"))
        except AssertionError as error:
            raise AssertionError(f"damage of {size} bytes in the {name}") from error


def test_wrong_head_of_chunk_costs_no_row(whole: Whole, tmp_path: Path) -> None:
    """No CRC covers the fields before the data, and that of the data proves these sound."""
    chunks = whole.recording.contents.chunks
    start = next(chunk for chunk in chunks if 2 in chunk.message_index_offsets).chunk_start_offset
    fields = {"start time": 9, "end time": 17, "size": 25, "size of the data": 41}
    if whole.compression != "none":
        fields |= {"name": 41, "size of the data": 41 + len(whole.compression)}
    for name, place in fields.items():
        damaged = bytearray(whole.content)
        damaged[start + place] ^= 0x15
        path = tmp_path / f"{name}.mcap".replace(" ", "_")
        path.write_bytes(damaged)
        for partial in (True, False):
            recording = Recording.open(path, partial=partial)
            for stream, rows in whole.rows.items():
                assert recording.read(stream).tobytes() == rows.tobytes(), f"wrong {name}"
            assert recording.gaps == ()
            report = recover(path)
            assert report.intact is not partial
        assert rows_by_mcap(path) == {
            stream: [row.tobytes() for row in rows] for stream, rows in whole.rows.items()
        }
        assert path.with_name(f"{path.name}.orig").read_bytes() == damaged


def test_truncated_index_costs_no_chunk(whole: Whole, tmp_path: Path) -> None:
    """The length that it gives reaches into the chunk behind it, which is sound."""
    chunks = whole.recording.contents.chunks
    first, lost = chunks[2], chunks[5]
    cuts = {"behind a sound chunk": (first, b""), "behind a damaged one": (lost, b"damaged")}
    for name, (chunk, spoilt) in cuts.items():
        start = chunk.chunk_start_offset + chunk.chunk_length
        cut = whole.content[: start - len(spoilt)] + spoilt + whole.content[start : start + 40]
        content = cut + whole.content[start + 40 + 48 :]
        path = tmp_path / "run.mcap"
        path.write_bytes(content)
        recover(path)
        got = rows_of(Recording.open(path))
        for other in chunks:
            if other is chunk and spoilt:
                continue
            (channel,) = other.message_index_offsets
            stream = whole.recording.contents.channels[channel].topic[1:]
            if stream not in whole.rows:
                continue
            times = whole.rows[stream]["t_ns"]
            inside = (times >= other.message_start_time) & (times <= other.message_end_time)
            rows = {row.tobytes() for row in whole.rows[stream][inside]}
            assert rows <= set(got[stream]), f"an index is cut {name}"


def test_damaged_header_hides_no_chunk(whole: Whole, tmp_path: Path) -> None:
    damaged = bytearray(whole.content)
    damaged[10] ^= 0x7F
    check(whole, bytes(damaged), tmp_path / "run.mcap")


def test_a_damaged_copy_of_a_definition_replaces_none(whole: Whole, tmp_path: Path) -> None:
    """The summary is not known as that, and a name in it is wrong."""
    damaged = bytearray(whole.content)
    damaged[whole.recording.data_end] ^= 0x40
    damaged[damaged.index(b"/fast", whole.recording.data_end) + 1] ^= 1
    check(whole, bytes(damaged), tmp_path / "run.mcap")


def test_definitions_that_are_lost_twice_leave_the_rows(whole: Whole, tmp_path: Path) -> None:
    """Neither the channels nor their copies in the summary are there."""
    damaged = bytearray(whole.content)
    first = whole.recording.contents.chunks[0].chunk_start_offset
    damaged[8:first] = bytes(first - 8)
    path = tmp_path / "damaged.mcap"
    path.write_bytes(damaged[: whole.recording.data_end])
    recover(path)
    repaired = Recording.open(path)
    for number, stream in enumerate(STREAMS, 2):
        rows = repaired.read(f"unnamed_{number}")
        assert rows.tobytes() == whole.rows[stream.name].tobytes()


def test_lost_rows_are_counted_and_placed(whole: Whole, tmp_path: Path) -> None:
    path = tmp_path / "damaged.mcap"
    chunks = [
        chunk for chunk in whole.recording.contents.chunks if 2 in chunk.message_index_offsets
    ]
    for position, chunk in enumerate(chunks):
        damaged = bytearray(whole.content)
        damaged[chunk.chunk_start_offset + 90] ^= 1
        path.write_bytes(damaged)
        report = recover(path)
        (gap,) = Recording.open(path).gaps
        assert report.gaps == (gap,)
        assert gap.stream == "fast"
        left = len(Recording.open(path).read("fast"))
        assert gap.rows == SECONDS * RATE_HZ - left, position
        assert (gap.start_ns, gap.end_ns) == (chunk.message_start_time, chunk.message_end_time)


def test_the_trials_that_lost_rows_are_not_complete(whole: Whole, tmp_path: Path) -> None:
    trial = whole.recording.trial(2)
    assert trial.complete
    damaged = bytearray(whole.content)
    inside = [
        chunk
        for chunk in whole.recording.contents.chunks
        if 2 in chunk.message_index_offsets
        and trial.start_ns < chunk.message_start_time
        and chunk.message_end_time < trial.end_ns
    ]
    damaged[inside[0].chunk_start_offset + 90] ^= 1
    path = tmp_path / "damaged.mcap"
    path.write_bytes(damaged)
    recover(path)
    states = {item.number: (item.complete, item.reason) for item in Recording.open(path).trials}
    assert states[1][0]
    assert states[3][0]
    assert states[2] == (False, "lost: 100 rows of fast")


def test_lost_rows_are_still_known_after_resuming(
    whole: Whole, rows: MakeRows, tmp_path: Path
) -> None:
    """The rows that follow are numbered on, so that no later repair finds another gap."""
    path = tmp_path / "damaged.mcap"
    chunks = [
        chunk for chunk in whole.recording.contents.chunks if 2 in chunk.message_index_offsets
    ]
    damaged = bytearray(whole.content)
    damaged[chunks[-1].chunk_start_offset + 90] ^= 1
    path.write_bytes(damaged)
    recover(path)
    before = Recording.open(path).gaps
    more = rows(FAST, 500, rate_hz=RATE_HZ, seed=5)
    more["t_ns"] += 20_000_000_000
    with RecordingWriter.append(path, streams=STREAMS) as writer:
        writer.write("fast", more)
    again = bytearray(path.read_bytes())
    last = Recording.open(path).contents.chunks[-1]
    again[last.chunk_start_offset + 90] ^= 1
    path.write_bytes(again)
    recover(path)
    first, second = Recording.open(path).gaps
    assert (first,) == before
    assert (second.rows, second.end_ns) == (
        len(more) - int((more["t_ns"] < last.message_start_time).sum()),
        more["t_ns"][-1],
    )
    assert path.with_name("damaged.mcap.orig2").read_bytes() == bytes(again)


@pytest.mark.parametrize("asks", [False, True])
def test_a_lost_answer_leaves_no_later_trial_complete(
    create: Create, start_ns: int, tmp_path: Path, asks: bool
) -> None:
    text = b"prompts: {load: {changes: load}}\n" if asks else b"procedure: sweep\n"
    attached = Attachment("procedure.yaml", "application/yaml", text)
    with create(attachments=(attached,)) as writer:
        writer.event(start_ns, "run_start")
        for number in range(1, 5):
            at = start_ns + number * 11_000_000_000  # a chunk of events for each trial
            writer.event(at, "trial_start", number)
            writer.event(at + 10_500_000_000, "trial_end", number, {"complete": True})
    path = tmp_path / "run.mcap"
    chunks = Recording.open(path).contents.chunks
    content = bytearray(path.read_bytes())
    content[chunks[1].chunk_start_offset + 60] ^= 1
    path.write_bytes(content)
    recover(path)
    complete = [trial.number for trial in Recording.open(path).trials if trial.complete]
    assert complete == ([1] if asks else [1, 3, 4]) or complete == ([] if asks else [3, 4])


def test_layout_that_hides_mcap_file_is_not_mixed(
    create: Create, rows: MakeRows, whole: Whole, tmp_path: Path
) -> None:
    """An attachment that is itself a recording: if it is damaged, its chunks are not ours."""
    inner = Attachment("other.mcap", "application/octet-stream", whole.content)
    given = rows(FAST, 300, rate_hz=RATE_HZ, seed=9)
    with create("outer.mcap", streams=STREAMS, attachments=(inner,)) as writer:
        writer.write("fast", given)
    path = tmp_path / "outer.mcap"
    content = bytearray(path.read_bytes())
    attachment = Recording.open(path).contents.attachments[0]
    content[attachment.offset + 30] ^= 1
    path.write_bytes(content)
    recover(path)
    assert Recording.open(path).read("fast").tobytes() == given.tobytes()


def test_file_that_is_no_recording_is_unchanged(tmp_path: Path) -> None:
    path = tmp_path / "old.csv"
    path.write_text("t,x\n" + "0.1,2\n" * 5000)
    with pytest.raises(RecordingError) as caught:
        Recording.open(path)
    assert "rigd recover" not in str(caught.value)
    assert "no MCAP recording" in str(caught.value)
    with pytest.raises(RecordingError, match="cannot be recovered"):
        recover(path)
    assert [item.name for item in tmp_path.iterdir()] == ["old.csv"]
