"""A repair that is killed, finds the disk full, or meets another's journal, costs nothing."""

from __future__ import annotations

import errno
import os
import signal
import sys
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import rigd.record.repair.rebuild
from rigd.model import RecordingError, Stream
from rigd.record import Recording, RecordingWriter, recover, verify
from rigd.record.mcap.journal import journal_path
from rigd.record.read.moment import recorded_at

Create = Callable[..., RecordingWriter]
MakeRows = Callable[..., NDArray[np.void]]


@pytest.fixture
def given(rows: MakeRows, servo: Stream) -> NDArray[np.void]:
    return rows(servo, 3_500)


@pytest.fixture
def damaged(create: Create, given: NDArray[np.void], tmp_path: Path) -> Path:
    """A recording with one bad byte in its second chunk."""
    path = tmp_path / "run.mcap"
    with create() as writer:
        writer.write("wheel_servo", given)
    content = bytearray(path.read_bytes())
    content[Recording.open(path).contents.chunks[1].chunk_start_offset + 500] ^= 1
    path.write_bytes(content)
    return path


def left(given: NDArray[np.void]) -> bytes:
    return np.concatenate([given[:1_000], given[2_000:]]).tobytes()


def step(name: str, act: Callable[[], None], monkeypatch: pytest.MonkeyPatch) -> None:
    """Have ``act`` done when the repair comes to the step of that name."""
    owner: object = {
        "write_all": rigd.record.repair.rebuild,
        "link": os,
        "sync_folder": sys.modules[recover.__module__],
        "replace": Path,
        "fsync": os,
    }[name]

    def instead(*_args: object, **_options: object) -> None:
        act()

    monkeypatch.setattr(owner, name, instead)


@pytest.mark.parametrize("at", ["write_all", "fsync", "link", "replace", "sync_folder"])
def test_killed_repair_is_done_again(
    damaged: Path, given: NDArray[np.void], monkeypatch: pytest.MonkeyPatch, at: str
) -> None:
    before = damaged.read_bytes()
    child = os.fork()
    if child == 0:
        try:
            step(at, lambda: os.kill(os.getpid(), signal.SIGKILL), monkeypatch)
            recover(damaged)
        finally:
            os._exit(0)
    _, status = os.waitpid(child, 0)
    assert os.WIFSIGNALED(status)
    # At every moment a whole file stands under the name: the damaged or the repaired one.
    read = Recording.open(damaged, partial=True).read("wheel_servo")
    assert read.tobytes() == left(given)
    recover(damaged)
    assert Recording.open(damaged).read("wheel_servo").tobytes() == left(given)
    assert damaged.with_name("run.mcap.orig").read_bytes() == before
    names = {path.name for path in damaged.parent.iterdir()}
    assert names == {"run.mcap", "run.mcap.orig"}


@pytest.mark.parametrize("at", ["write_all", "fsync", "link", "replace"])
def test_a_full_disk_leaves_the_damaged_file(
    damaged: Path, monkeypatch: pytest.MonkeyPatch, at: str
) -> None:
    before = damaged.read_bytes()

    def full() -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    step(at, full, monkeypatch)
    with pytest.raises(RecordingError, match="No space left on device"):
        recover(damaged)
    assert damaged.read_bytes() == before
    assert not damaged.with_name("run.mcap.recovering").exists()


def flushed(create: Create, name: str, rows: NDArray[np.void], **options: object) -> Path:
    """Return a recording as ``kill -9`` leaves it between two flushes, with its journal."""
    writer = create(name, **options)
    path: Path = writer._file.path
    writer.write("wheel_servo", rows[:900])
    writer.flush()
    writer.write("wheel_servo", rows[900:950])
    writer.flush()
    kept = {item: item.read_bytes() for item in (path, journal_path(path))}
    writer.close()
    for item, content in kept.items():
        item.write_bytes(content)
    return path


def test_journal_of_another_run_changes_no_row(
    create: Create, rows: MakeRows, servo: Stream, start_ns: int
) -> None:
    """It once cut a sound file off where the other's open chunks had stood."""
    other = flushed(create, "other.mcap", rows(servo, 1_000, seed=7), start_ns=start_ns + 1)
    given = rows(servo, 3_500)
    with create() as writer:
        writer.write("wheel_servo", given)
    path = other.with_name("run.mcap")
    whole = path.read_bytes()
    last = Recording.open(path).contents.chunks[-1]
    path.write_bytes(whole[: last.chunk_start_offset + 200])
    journal = journal_path(other).read_bytes()
    journal_path(path).write_bytes(journal)
    report = recover(path)
    assert not report.from_journal
    assert Recording.open(path).read("wheel_servo").tobytes() == given[:3_000].tobytes()
    assert report.original is not None
    assert journal_path(report.original).read_bytes() == journal


def test_own_journal_fills_torn_flush_and_keeps_rest(
    create: Create, rows: MakeRows, servo: Stream
) -> None:
    given = rows(servo, 1_000)
    path = flushed(create, "run.mcap", given)
    content = bytearray(path.read_bytes())
    open_chunk = Recording.open(path).contents.chunks[-1]
    content[open_chunk.chunk_start_offset + 40] ^= 1
    path.write_bytes(content)
    report = recover(path)
    assert report.from_journal
    assert Recording.open(path).read("wheel_servo").tobytes() == given[:900].tobytes()
    # What the torn flush had added on top is known to be lost.
    (gap,) = Recording.open(path).gaps
    assert (gap.stream, gap.rows) == ("wheel_servo", 50)


@pytest.mark.parametrize("code", [errno.EPERM, errno.EOPNOTSUPP])
def test_repair_copies_where_files_have_one_name(
    damaged: Path, given: NDArray[np.void], monkeypatch: pytest.MonkeyPatch, code: int
) -> None:
    before, mine = damaged.read_bytes(), damaged.with_name("run.mcap.orig")
    mine.write_text("mine")

    def no_links() -> None:
        raise OSError(code, os.strerror(code))

    step("link", no_links, monkeypatch)
    report = recover(damaged)
    assert report.original == damaged.with_name("run.mcap.orig2")
    assert report.original.read_bytes() == before
    assert mine.read_text() == "mine"
    assert Recording.open(damaged).read("wheel_servo").tobytes() == left(given)
    assert not list(damaged.parent.glob("*.copying"))


def test_second_name_of_original_is_not_overwritten(damaged: Path, given: NDArray[np.void]) -> None:
    mine = damaged.with_name("run.mcap.orig")
    mine.write_text("mine")
    report = recover(damaged)
    assert report.original == damaged.with_name("run.mcap.orig2")
    assert mine.read_text() == "mine"


def test_a_missing_end_alone_is_written_in_place(
    create: Create, given: NDArray[np.void], tmp_path: Path
) -> None:
    """What a long run that is killed leaves: all rows, and no summary. Nothing is copied."""
    path = tmp_path / "run.mcap"
    with create() as writer:
        writer.write("wheel_servo", given)
    end = Recording.open(path).data_end - 13
    os.truncate(path, end)
    assert recover(path).original is None
    assert Recording.open(path).read("wheel_servo").tobytes() == given.tobytes()
    assert [item.name for item in tmp_path.iterdir()] == ["run.mcap"]


def test_a_second_recording_behind_the_end_is_kept(
    damaged: Path, create: Create, given: NDArray[np.void], tmp_path: Path
) -> None:
    """As `cat first second > run.mcap` makes it: the end of the first is sound."""
    path = tmp_path / "both.mcap"
    with create(path) as writer:
        writer.write("wheel_servo", given[:10])
    joined = path.read_bytes() + damaged.read_bytes()
    path.write_bytes(joined)
    report = recover(path)
    assert report.original is not None
    assert report.original.read_bytes() == joined
    assert Recording.open(path).read("wheel_servo").tobytes() == given[:10].tobytes()


@pytest.mark.parametrize(
    "cut", ["within a chunk", "within an index", "between records", "within its end", "not"]
)
def test_two_recordings_in_a_file_are_never_mixed(
    create: Create, rows: MakeRows, servo: Stream, start_ns: int, tmp_path: Path, cut: str
) -> None:
    """As `cat first second > run.mcap` makes it, of a first that was killed, or not."""
    for name, seed in (("first.mcap", 1), ("second.mcap", 2)):
        with create(name) as writer:
            writer.event(start_ns, "run_start")
            writer.write("wheel_servo", rows(servo, 2_500, seed=seed))
            if seed == 2:
                writer.event(start_ns + 10**10, "run_end", None, {"state": "complete"})
    first, second = (tmp_path / name for name in ("first.mcap", "second.mcap"))
    recording = Recording.open(first)
    chunk = recording.contents.chunks[-1]
    last = chunk.chunk_start_offset
    end = {
        "within a chunk": last + 100,
        "within an index": last + chunk.chunk_length + 100,
        "between records": last,
        "within its end": recording.data_end + 40,
        "not": first.stat().st_size,
    }[cut]
    path = tmp_path / "both.mcap"
    joined = first.read_bytes()[:end] + second.read_bytes()
    path.write_bytes(joined)
    assert any(f"another recording begins at byte {end}" in line for line in verify(path).lines())

    report = recover(path)
    assert report.another == end
    assert report.original is not None
    assert report.original.read_bytes() == joined
    kept = Recording.open(path).read("wheel_servo")
    assert len(kept) >= 1_000
    assert kept.tobytes() == rows(servo, 2_500, seed=1)[: len(kept)].tobytes()
    assert Recording.open(path).info.state == "interrupted"
    assert recover(path).intact
    path.write_bytes(joined[report.another :])
    behind = Recording.open(path).read("wheel_servo")
    assert behind.tobytes() == rows(servo, 2_500, seed=2).tobytes()


def test_a_repair_by_a_link_repairs_the_file(
    damaged: Path, given: NDArray[np.void], tmp_path: Path
) -> None:
    before = damaged.read_bytes()
    link = tmp_path / "elsewhere" / "latest.mcap"
    link.parent.mkdir()
    link.symlink_to(damaged)
    report = recover(link)
    assert link.is_symlink()
    assert report.original == damaged.with_name("run.mcap.orig")
    assert report.original.read_bytes() == before
    assert Recording.open(damaged).read("wheel_servo").tobytes() == left(given)
    assert list(link.parent.iterdir()) == [link]


@pytest.mark.parametrize("lost_bytes", [20, 2_000])
def test_repair_keeps_the_date_of_a_simulation(
    create: Create, rows: MakeRows, force: Stream, tmp_path: Path, lost_bytes: int
) -> None:
    path = tmp_path / "run.mcap"
    with create(metadata={"run": {"mode": "simulated, virtual time", "rig": "bench"}}) as writer:
        writer.write("force", rows(force, 3_000))
    path.write_bytes(path.read_bytes()[:-lost_bytes])
    os.utime(path, (1e9, 1e9))
    before = recorded_at(Recording.open(path, partial=True).info)
    assert before.at == datetime.fromtimestamp(1e9, UTC)
    assert not recover(path).intact
    repaired = Recording.open(path)
    assert recorded_at(repaired.info) == before
    assert repaired.info.rig == "bench"


def test_repair_keeps_the_file_mode(damaged: Path) -> None:
    damaged.chmod(0o640)
    recover(damaged)
    assert damaged.stat().st_mode & 0o777 == 0o640
