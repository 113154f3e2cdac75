"""Saves a copy of the bytes that the next flush overwrites (a rollback journal).

A flush overwrites the open chunks of the last flush with sealed (final) chunks. If a process is
killed in the middle of that write (the kernel stops at a page boundary), up to a second of rows
that were already on disk would be lost. So the recorder first copies those rows to
``RUN.mcap.journal``. If the recording is torn, ``recover`` restores the rows, and only the rows
after the last flush are lost. The journal carries the CRC of the first bytes of its recording;
beside any other recording it is ignored. SQLite's rollback journal does the same
(https://www.sqlite.org/atomiccommit.html, section 3).
"""

from __future__ import annotations

import os
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from rigd.model.machine.system import BINARY, write_at
from rigd.record.mcap.crc import crc32

_MAGIC: Final = b"rigdjrn2"
#: Magic, offset, length, identity (bytes and their CRC), CRC of all but the magic.
_HEAD: Final = struct.Struct("<8sQQQII")
#: At most so many bytes identify a recording: they contain its metadata.
IDENTITY_BYTES: Final = 64 * 1024


def journal_path(recording: Path) -> Path:
    """Return the path of the journal of a recording, which exists while it is written."""
    return recording.with_name(recording.name + ".journal")


#: Parts that one call writes; 16 is the least that POSIX asks of a system.
_MAX_PARTS: Final = os.sysconf("SC_IOV_MAX") if hasattr(os, "sysconf") else 16


@dataclass(frozen=True)
class Identity:
    """Identifies a recording by the CRC of its first ``size`` bytes."""

    size: int
    crc: int

    def is_of(self, buffer: memoryview) -> bool:
        """Return whether a file begins with these bytes."""
        return 0 < self.size <= len(buffer) and crc32(buffer[: self.size]) == self.crc


@dataclass(frozen=True)
class Saved:
    """Holds bytes that were at ``offset`` of the recording ``identity`` before the last flush."""

    offset: int
    data: bytes
    identity: Identity


class Journal:
    """The journal of the recording being written; made when first needed."""

    def __init__(self, recording: Path) -> None:
        self._path = journal_path(recording)
        self._fd: int | None = None

    def save(self, saved: Saved) -> None:
        """Write the bytes a flush is about to overwrite.

        Raises:
            OSError: the journal cannot be written.

        """
        if self._fd is None:
            flags = os.O_RDWR | os.O_CREAT | os.O_TRUNC | BINARY
            self._fd = os.open(self._path, flags, 0o644)
        write_all(self._fd, (_head(saved), saved.data), 0)

    def close(self, *, remove: bool) -> None:
        """Close the journal, and remove it when the recording no longer needs it."""
        if self._fd is None:
            return
        os.close(self._fd)
        self._fd = None
        if remove:
            self._path.unlink(missing_ok=True)


def read_journal(recording: Path) -> Saved | None:
    """Return the content of the journal, or None if it is missing or damaged."""
    try:
        content = journal_path(recording).read_bytes()
    except FileNotFoundError:
        return None
    if len(content) < _HEAD.size:
        return None
    magic, offset, length, *identity, _ = _HEAD.unpack_from(content)
    saved = Saved(offset, content[_HEAD.size : _HEAD.size + length], Identity(*identity))
    if magic != _MAGIC or content[: _HEAD.size] != _head(saved):
        return None
    return saved


def write_all(fd: int, parts: Sequence[bytes | memoryview], offset: int) -> None:
    """Write ``parts`` one after the other at ``offset``, in a single call if the system permits.

    Raises:
        OSError: the disk is full, a limit is reached, the disk fails; part may be written.
    """
    for start in range(0, len(parts), _MAX_PARTS):
        some = parts[start : start + _MAX_PARTS]
        size = sum(map(len, some))
        written = write_at(fd, some, offset)
        if written < size:
            # Cut short: writing the rest raises the system's error.
            view = memoryview(b"".join(some))
            while written < size:
                written += write_at(fd, (view[written:],), offset + written)
        offset += size


def _head(saved: Saved) -> bytes:
    fields = (saved.offset, len(saved.data), saved.identity.size, saved.identity.crc)
    crc = crc32(saved.data, crc32(struct.pack("<QQQI", *fields)))
    return _HEAD.pack(_MAGIC, *fields, crc)
