"""Repairs a recording in place: everything up to the first damage is kept, the rest is cut off."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from rigd.model import RecordingError
from rigd.record.contents import SummaryWriter, rows_of
from rigd.record.crc import crc32
from rigd.record.file import lock, write_error
from rigd.record.journal import Saved, journal_path, read_journal, write_all
from rigd.record.prefix import LIBRARY, build_extras
from rigd.record.scan import Scan, scan, walk
from rigd.record.wire import Malformed, map_file

#: Metadata record that says a recording was repaired, and so interrupted.
RECOVERY_METADATA: Final = "recovery"


class Headless(RecordingError):
    """Not even the beginning of a recording is there: nothing can be kept of it."""


@dataclass(frozen=True)
class RecoveryReport:
    """What :func:`recover` did; ``rows_kept`` by topic, ``lost_bytes`` cut off the end."""

    path: Path
    intact: bool  #: nothing was wrong, and nothing was changed
    problem: str  #: what was wrong; empty where intact
    from_journal: bool  #: whether rows came back from the journal of a torn flush
    rows_kept: dict[str, int]
    lost_bytes: int


def recover(path: Path, *, trusted: int = 0) -> RecoveryReport:
    """Make a recording readable again, in place; does nothing to an intact one.

    The first ``trusted`` bytes are not checked (:mod:`~rigd.record.scan`). It may be interrupted
    and run again. A repaired recording has a metadata record ``recovery``; its run counts as
    interrupted, as it has no ``run_end`` event.

    Raises:
        Headless: empty, or no MCAP file.
        InUse: being written.
        RecordingError: missing, damaged but not written by rigd, or the disk refuses.

    """
    try:
        fd = os.open(path, os.O_RDWR | os.O_CLOEXEC)
    except OSError as error:
        raise RecordingError(f"cannot open {path}: {error.strerror}") from error
    try:
        lock(fd, path)
        return _recover(fd, path, trusted)
    except OSError as error:
        raise write_error(path, error) from error
    finally:
        os.close(fd)


def _recover(fd: int, path: Path, trusted: int) -> RecoveryReport:
    size = os.fstat(fd).st_size
    found = _scan(fd, path, trusted)
    problem, from_journal, lost = found.problem, False, 0
    if not found.intact:
        _refuse_foreign(path, found)
        saved = read_journal(path)
        if saved is not None and _journal_has_more(found, saved):
            write_all(fd, (saved.data,), saved.offset)
            os.ftruncate(fd, saved.offset + len(saved.data))
            found, from_journal = _scan(fd, path, trusted), True
        lost = max(size - found.data_end, 0)
        _finish(fd, found, problem)
    journal_path(path).unlink(missing_ok=True)
    topics = {number: channel.topic for number, channel in found.contents.channels.items()}
    return RecoveryReport(
        path=path,
        intact=not problem,
        problem=problem,
        from_journal=from_journal,
        rows_kept={topics[number]: count for number, count in found.contents.counts.items()},
        lost_bytes=lost,
    )


def _refuse_foreign(path: Path, found: Scan) -> None:
    """Refuse to cut a file that may only be laid out in a way that rigd does not know."""
    if not found.library.startswith(LIBRARY):
        raise RecordingError(
            f"{path} was written by {found.library!r} and is not as rigd expects: {found.problem}",
            hint="rigd repairs in place only what it wrote; `mcap recover` makes a repaired copy.",
        )


def _scan(fd: int, path: Path, trusted: int) -> Scan:
    if os.fstat(fd).st_size == 0:
        raise Headless(f"{path} is empty", hint="Nothing was recorded; the file can be deleted.")
    try:
        return scan(map_file(fd), trusted)
    except Malformed as error:
        raise Headless(
            f"{path} cannot be recovered: {error}", hint="It is no recording, or lost its head."
        ) from error


def _journal_has_more(found: Scan, saved: Saved) -> bool:
    """Return whether the journal has rows of some channel that the torn file lost."""
    if saved.offset > found.data_end:
        return False  # the damage is before what the journal saved
    in_journal = Scan(data_end=saved.offset)
    in_journal.contents.channels = found.contents.channels
    try:
        walk(memoryview(saved.data), in_journal, saved.offset)
    except Malformed:
        return False  # its CRC held, so it belongs to another file of this name
    in_file: dict[int, int] = {}
    for chunk in found.contents.chunks:
        if chunk.chunk_start_offset >= saved.offset:
            for channel in chunk.message_index_offsets:
                in_file[channel] = in_file.get(channel, 0) + rows_of(chunk)
    return any(
        count > in_file.get(channel, 0) for channel, count in in_journal.contents.counts.items()
    )


def _finish(fd: int, found: Scan, problem: str) -> None:
    """Write what is missing behind the sound data, and cut off the rest."""
    contents = found.contents
    start = found.data_end + len(found.missing_index)
    marked = RECOVERY_METADATA in (index.name for index in contents.metadata)
    # Once is enough: a recovery that was itself interrupted leaves its mark in the sound part.
    mark = {} if marked else {RECOVERY_METADATA: {"problem": problem}}
    added = found.missing_index + build_extras(mark, (), contents.start_ns, start, contents)
    end = found.data_end + len(added)
    tail = SummaryWriter(contents).tail(end, crc32(added, found.data_crc), ())
    write_all(fd, (added, tail), found.data_end)
    os.ftruncate(fd, end + len(tail))
    os.fdatasync(fd)
    found.data_end = end
