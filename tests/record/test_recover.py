"""After any cut or tear, what was on disk before stays, and a second repair does nothing.

One place in four is cut or torn; `benchmarks/every_case.py` tries all.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from numpy.typing import NDArray
from support.cases import some

from rigd.catalogue import search
from rigd.model import RecordingError, Stream
from rigd.record import Recording, RecordingWriter, recover, verify
from rigd.record.mcap.journal import journal_path

Create = Callable[..., RecordingWriter]
MakeRows = Callable[..., NDArray[np.void]]

PAGE = 4096


def assert_strictly_sound(path: Path) -> None:
    """Every record is read, in order and by index, with every CRC checked."""
    with path.open("rb") as file:
        messages = sum(1 for _ in make_reader(file, validate_crcs=True).iter_messages())
    assert messages == Recording.open(path).contents.messages
    assert recover(path).intact


def test_any_truncation_keeps_every_whole_chunk(
    create: Create, rows: MakeRows, servo: Stream, force: Stream, tmp_path: Path
) -> None:
    moved, pressed = rows(servo, 4_000), rows(force, 4_000)
    with create("whole.mcap") as writer:
        for start in range(0, 4_000, 500):
            writer.write("wheel_servo", moved[start : start + 500])
            writer.write("force", pressed[start : start + 500])
    whole = (tmp_path / "whole.mcap").read_bytes()
    contents = Recording.open(tmp_path / "whole.mcap").contents
    first = contents.chunks[0].chunk_start_offset
    cuts = np.random.default_rng(5).integers(first, len(whole) - 1, 60)
    for cut in some(list(map(int, cuts)), 4):
        path = tmp_path / "cut.mcap"
        path.write_bytes(whole[:cut])
        with pytest.raises(RecordingError, match="rigd recover"):
            Recording.open(path)
        report = recover(path)
        kept = [
            chunk
            for chunk in contents.chunks
            if chunk.chunk_start_offset + chunk.chunk_length <= cut
        ]
        assert not report.intact
        assert len(Recording.open(path).contents.chunks) == len(kept)
        for name, given in (("wheel_servo", moved), ("force", pressed)):
            read = Recording.open(path).read(name)
            assert len(read) == report.rows_kept.get(f"/{name}", 0)
            assert read.tobytes() == given[: len(read)].tobytes()
        assert Recording.open(path).info.recovered
        assert_strictly_sound(path)


def test_a_cut_file_can_be_looked_into(
    create: Create, rows: MakeRows, servo: Stream, tmp_path: Path
) -> None:
    given = rows(servo, 3_500)
    with create() as writer:
        writer.write("wheel_servo", given)
    path = tmp_path / "run.mcap"
    last = Recording.open(path).contents.chunks[-1]
    os.truncate(path, last.chunk_start_offset + 100)
    recording = Recording.open(path, partial=True)
    assert "ends within a record" in recording.problem
    assert recording.read("wheel_servo").tobytes() == given[:3_000].tobytes()
    assert recording.info.problem == recording.problem


@pytest.mark.parametrize("portion", [100, 1_050])
def test_interrupted_flush_loses_no_earlier_row(
    create: Create,
    rows: MakeRows,
    servo: Stream,
    force: Stream,
    tmp_path: Path,
    portion: int,
) -> None:
    """The kernel stops a killed process's write at a page: all pages before it new, the rest old.

    ``portion`` rows later the flush either rewrites the open chunks, or replaces them by sealed.
    """
    path = tmp_path / "run.mcap"
    moved, pressed = rows(servo, 3_000), rows(force, 3_000)
    writer = create()
    flushed = 950
    writer.write("wheel_servo", moved[:flushed])
    writer.write("force", pressed[:flushed])
    writer.flush()
    old = path.read_bytes()
    writer.write("wheel_servo", moved[flushed : flushed + portion])
    writer.write("force", pressed[flushed : flushed + portion])
    writer.flush()
    new = path.read_bytes()
    journal = journal_path(path).read_bytes()
    writer.close()
    changed = next(i for i, (a, b) in enumerate(zip(old, new, strict=False)) if a != b)
    pages = range(changed // PAGE + 1, len(new) // PAGE + 1)
    assert len(pages) > 20
    from_journal = 0
    for page in some(pages, 4):
        torn = tmp_path / "torn.mcap"
        torn.write_bytes(new[: page * PAGE] + old[page * PAGE :])
        journal_path(torn).write_bytes(journal)
        report = recover(torn)
        from_journal += report.from_journal
        for name, given in (("wheel_servo", moved), ("force", pressed)):
            read = Recording.open(torn).read(name)
            assert len(read) >= flushed
            assert read.tobytes() == given[: len(read)].tobytes()
        assert not journal_path(torn).exists()
        assert_strictly_sound(torn)
    assert from_journal > 0


def test_torn_journal_beside_sound_file_is_ignored(
    create: Create, rows: MakeRows, servo: Stream, tmp_path: Path
) -> None:
    path = tmp_path / "run.mcap"
    with create() as writer:
        writer.write("wheel_servo", rows(servo, 100))
    before = path.read_bytes()
    journal_path(path).write_bytes(b"rigdjrn1" + bytes(30))
    assert recover(path).intact
    assert path.read_bytes() == before
    assert not journal_path(path).exists()


def test_a_damaged_chunk_alone_is_left_out(
    create: Create, rows: MakeRows, servo: Stream, tmp_path: Path
) -> None:
    path = tmp_path / "run.mcap"
    given = rows(servo, 3_500)
    with create() as writer:
        writer.write("wheel_servo", given)
    content = bytearray(path.read_bytes())
    second = Recording.open(path).contents.chunks[1]
    content[second.chunk_start_offset + second.chunk_length // 2] ^= 0x10
    path.write_bytes(content)
    with pytest.raises(RecordingError, match=r"CRC|decompress"):
        Recording.open(path).read("wheel_servo")
    damaged = path.read_bytes()
    report = recover(path)
    assert report.rows_kept == {"/wheel_servo": 2_500}
    assert report.lost_bytes >= second.chunk_length
    kept = np.concatenate([given[:1_000], given[2_000:]])
    assert Recording.open(path).read("wheel_servo").tobytes() == kept.tobytes()
    assert report.original == tmp_path / "run.mcap.orig"
    assert report.original.read_bytes() == damaged
    (gap,) = Recording.open(path).gaps
    times = given["t_ns"]
    assert (gap.stream, gap.rows) == ("wheel_servo", 1_000)
    assert (gap.start_ns, gap.end_ns) == (times[1_000], times[1_999])
    assert_strictly_sound(path)


@pytest.mark.parametrize("content", [b"", b"\x00", b"nonsense" * 100, b"\x89MCAP0\r\n"])
def test_file_that_is_no_recording_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "odd.mcap"
    path.write_bytes(content)
    with pytest.raises(RecordingError, match=r"odd\.mcap"):
        Recording.open(path)
    if content[:5] != b"\x89MCAP":
        with pytest.raises(RecordingError, match=r"odd\.mcap"):
            recover(path)
        assert path.read_bytes() == content


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    for action in (Recording.open, recover):
        with pytest.raises(RecordingError, match=r"none\.mcap"):
            action(tmp_path / "none.mcap")


@pytest.mark.timeout(30)
def test_a_pipe_is_refused_at_once(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.mcap")
    for action in (Recording.open, recover, verify):
        with pytest.raises(RecordingError, match=r"pipe\.mcap is a pipe"):
            action(tmp_path / "pipe.mcap")
    (broken,) = search(tmp_path).broken
    assert "is a pipe" in str(broken.problem)


def test_a_file_that_changes_is_not_called_damaged(
    create: Create, rows: MakeRows, servo: Stream, tmp_path: Path
) -> None:
    path = tmp_path / "run.mcap"
    given = rows(servo, 3_000)
    with create() as writer:
        writer.write("wheel_servo", given[:1_500])
        writer.flush()
        recording = Recording.open(path)  # its last chunk is not yet where it will be
        writer.write("wheel_servo", given[1_500:])
        writer.flush()
        with pytest.raises(RecordingError, match="is being written"):
            recording.read("wheel_servo")
    assert Recording.open(path).read("wheel_servo").tobytes() == given.tobytes()


def test_recover_refuses_file_being_written(create: Create, tmp_path: Path) -> None:
    with create(), pytest.raises(RecordingError, match="being written"):
        recover(tmp_path / "run.mcap")


KILLED = """
import sys
from pathlib import Path
import numpy as np
from rigd.model import Channel, Stream
from rigd.model.rows import row_dtype
from rigd.record import RecordingWriter

stream = Stream("fast", tuple(Channel(f"c{i}") for i in range(12)))
rows = np.zeros(100, row_dtype(stream))
writer = RecordingWriter.create(
    Path(sys.argv[1]), streams=(stream,), metadata={}, attachments=(), start_ns=0
)
done = 0
while True:
    rows["t_ns"] = np.arange(done, done + 100) * 1_000_000
    rows["c0"] = np.arange(done, done + 100)
    writer.write("fast", rows)
    writer.flush()
    done += 100
    print(done, flush=True)
"""


@pytest.mark.parametrize("reports", [1, 9, 23, 60])
def test_kill_9_loses_no_flushed_row(tmp_path: Path, reports: int) -> None:
    path = tmp_path / "run.mcap"
    command = [sys.executable, "-c", KILLED, str(path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        for _ in range(reports):
            process.stdout.readline()
        process.send_signal(signal.SIGKILL)
        flushed = max([reports * 100, *map(int, process.stdout.read().split("\n")[:-1])])
    recover(path)
    read = Recording.open(path).read("fast")
    assert len(read) >= flushed
    assert (read["c0"] == np.arange(len(read))).all()
    assert Recording.open(path).info.state == "interrupted"
