"""The rollback journal: what a flush is about to overwrite, safe in a file beside the recording.

A flush overwrites the open chunks that the last flush wrote with sealed ones. A process killed
in the middle of that write (the kernel stops at a page boundary) would lose up to a second of
rows that were on disk already. So those rows are first copied to ``RUN.mcap.journal``: ``recover``
puts them back when the recording is torn, and only what came after the last flush is lost.
SQLite's rollback journal does the same (https://www.sqlite.org/atomiccommit.html, section 3).
"""

from __future__ import annotations

import os
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from rigd.record.crc import crc32

_MAGIC: Final = b"rigdjrn1"
_HEAD: Final = struct.Struct("<8sQQI")  #: magic, offset, length, CRC of payload and offset


def journal_path(recording: Path) -> Path:
    """Return where the journal of a recording stands while it is being written."""
    return recording.with_name(recording.name + ".journal")


_MAX_PARTS: Final = os.sysconf("SC_IOV_MAX")


@dataclass(frozen=True)
class Saved:
    """Bytes that stood at ``offset`` of the recording before the last flush."""

    offset: int
    data: bytes


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
            flags = os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC
            self._fd = os.open(self._path, flags, 0o644)
        head = _HEAD.pack(_MAGIC, saved.offset, len(saved.data), _crc(saved.offset, saved.data))
        write_all(self._fd, (head, saved.data), 0)

    def close(self, *, remove: bool) -> None:
        """Close the journal, and remove it when the recording no longer needs it."""
        if self._fd is None:
            return
        os.close(self._fd)
        self._fd = None
        if remove:
            self._path.unlink(missing_ok=True)


def read_journal(recording: Path) -> Saved | None:
    """Return what the journal saved, or None where there is none or it is itself torn."""
    try:
        content = journal_path(recording).read_bytes()
    except FileNotFoundError:
        return None
    if len(content) < _HEAD.size:
        return None
    magic, offset, length, crc = _HEAD.unpack_from(content)
    data = content[_HEAD.size : _HEAD.size + length]
    if magic != _MAGIC or len(data) != length or _crc(offset, data) != crc:
        return None
    return Saved(offset, data)


def write_all(fd: int, parts: Sequence[bytes | memoryview], offset: int) -> None:
    """Write ``parts`` one after the other at ``offset``, in one call where the system lets us.

    Raises:
        OSError: the disk is full, a limit is reached, the disk fails; part may be written.

    """
    for start in range(0, len(parts), _MAX_PARTS):
        some = parts[start : start + _MAX_PARTS]
        size = sum(map(len, some))
        written = os.pwritev(fd, some, offset)
        if written < size:
            # Cut short: say it in the system's words, by asking for the rest.
            view = memoryview(b"".join(some))
            while written < size:
                written += os.pwrite(fd, view[written:], offset + written)
        offset += size


def _crc(offset: int, data: bytes) -> int:
    return crc32(data, crc32(offset.to_bytes(8, "little")))
