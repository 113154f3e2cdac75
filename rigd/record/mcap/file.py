"""Writes the file of a recording in progress, and replaces the end of that file safely."""

from __future__ import annotations

import errno
import os
from collections.abc import Sequence
from pathlib import Path
from shlex import quote
from typing import Final, Self

from rigd.model import RecordingError
from rigd.model.machine.system import BINARY, read_at, sync_data
from rigd.record.mcap.access import take
from rigd.record.mcap.chunks import Chunk
from rigd.record.mcap.contents import Contents, SummaryWriter
from rigd.record.mcap.crc import crc32
from rigd.record.mcap.journal import IDENTITY_BYTES, Identity, Journal, Saved, write_all

#: The errors of the system if a disk, a quota or the largest size of a file is reached.
_FULL: Final = (errno.ENOSPC, getattr(errno, "EDQUOT", None), errno.EFBIG)


class RecordingInUse(RecordingError):
    """Another process has the recording open for writing; the caller may try again."""


class RecordingFile:
    """Writes sealed data that never change, then the chunks and summary that each commit rewrites.

    Every commit leaves a complete MCAP file. The bytes that it overwrites are first saved in the
    journal; if the system refuses the write, the state of the last commit is restored.
    """

    def __init__(self, fd: int, path: Path, summary: SummaryWriter, sealed: int, crc: int) -> None:
        """Continue a file whose first ``sealed`` bytes, with the CRC ``crc``, do not change."""
        self.path = path
        self._fd = fd
        self._summary = summary
        self._sealed = sealed
        self._crc = crc
        self._tail = b""  #: the bytes that the last commit wrote after the sealed data
        self._open_size = 0  #: bytes of open chunks at the start of the tail
        self._torn = False  #: whether a write failed and could not be taken back
        self._journal = Journal(path)
        self._identity = Identity(sealed, crc)

    @property
    def sealed(self) -> int:
        """Number of bytes that no commit changes again."""
        return self._sealed

    @classmethod
    def create(cls, path: Path, prefix: bytes, summary: SummaryWriter) -> Self:
        """Make a file that holds ``prefix`` and no chunk yet.

        Raises:
            RecordingError: it exists, or cannot be written.

        """
        flags = os.O_RDWR | os.O_CREAT | os.O_EXCL | BINARY
        try:
            fd = os.open(path, flags, 0o644)
        except FileExistsError as error:
            raise RecordingError(
                f"{path} exists already", hint="Choose another name; rigd overwrites no recording."
            ) from error
        except OSError as error:
            raise write_error(path, error) from error
        file = cls(fd, path, summary, 0, 0)
        try:
            lock(fd, path)
            file.commit(prefix, (), ())
            file._identity = Identity(len(prefix), file._crc)
        except RecordingError:
            file.close()
            path.unlink(missing_ok=True)
            raise
        return file

    @classmethod
    def resume(cls, fd: int, path: Path, summary: SummaryWriter, sealed: int, crc: int) -> Self:
        """Continue a complete file, of which the first ``sealed`` bytes, with ``crc``, stay.

        Raises:
            RecordingError: its old tail cannot be read, which is put back if a write fails.

        """
        file = cls(fd, path, summary, sealed, crc)
        try:
            file._tail = read_at(fd, os.fstat(fd).st_size - sealed, sealed)
            begin = read_at(fd, min(sealed, IDENTITY_BYTES), 0)
            file._identity = Identity(len(begin), crc32(begin))
        except OSError as error:
            raise write_error(path, error) from error
        return file

    @property
    def contents(self) -> Contents:
        """What the file holds, up to the last commit."""
        return self._summary.contents

    @property
    def summary_size(self) -> int:
        """Bytes of the index, which every complete commit writes again."""
        return self._summary.index_size

    def commit(
        self,
        sealed: bytes,
        chunks: Sequence[Chunk],
        still_open: Sequence[Chunk],
        *,
        complete: bool = True,
    ) -> None:
        """Add ``sealed`` bytes and sealed chunks, and after them open chunks and the summary.

        Without ``complete`` the summary is left out: every row is in the file, but if no complete
        commit follows, the file must be recovered before it can be read.

        Raises:
            RecordingError: the system refuses; the file is as the last commit left it. Or it was
                removed, moved or changed meanwhile: then nothing is written.

        """
        self._check_untouched()
        at, crc = self._sealed + len(sealed), crc32(sealed, self._crc)
        parts: list[bytes | memoryview] = [sealed]
        for chunk in chunks:
            self._summary.add_chunk(chunk, at)
            crc = _crc_of(chunk, crc)
            parts += chunk.parts
            at += chunk.size
        seal_at, seal_crc = at, crc
        placed: list[tuple[int, Chunk]] = []
        for chunk in still_open:
            placed.append((at, chunk))
            crc = _crc_of(chunk, crc)
            at += chunk.size
        opened = b"".join(part for chunk in still_open for part in chunk.parts)
        tail = opened + (self._summary.tail(at, crc, placed) if complete else b"")
        try:
            self._replace([*parts, tail])
        except OSError as error:
            raise write_error(self.path, error, begun=True) from error
        self._sealed, self._crc = seal_at, seal_crc
        self._tail, self._open_size = tail, len(opened)

    def sync(self) -> None:
        """Wait until the committed data are on the disk.

        Raises:
            RecordingError: the disk fails.
        """
        try:
            sync_data(self._fd)
        except OSError as error:
            raise write_error(self.path, error, begun=True) from error

    def close(self) -> None:
        """Close the file; silent the second time. The journal stays if the file is damaged."""
        if self._fd < 0:
            return
        fd, self._fd = self._fd, -1
        self._journal.close(remove=not self._torn)
        os.close(fd)

    def _check_untouched(self) -> None:
        """Raise unless the file is still at its path, and as long as the last commit left it."""
        try:
            size = self.path.stat().st_size
        except OSError as error:
            raise RecordingError(
                f"{self.path} was removed or moved while it was being written: {error.strerror}",
                hint="Leave a recording where it is until its run has ended.",
            ) from error
        expected = self._sealed + len(self._tail)
        if size != expected:
            raise RecordingError(
                f"{self.path} was changed by another program while it was being written: it has "
                f"{size} bytes, expected {expected}",
                hint=f"`rigd recover {quote(str(self.path))}` keeps all intact records.",
            )

    def _replace(self, parts: Sequence[bytes | memoryview]) -> None:
        """Write ``parts`` over the tail; put the tail back if that fails."""
        if self._open_size:
            saved = Saved(self._sealed, self._tail[: self._open_size], self._identity)
            self._journal.save(saved)
        size = sum(map(len, parts))
        self._torn = True
        try:
            write_all(self._fd, parts, self._sealed)
            if size < len(self._tail):
                os.ftruncate(self._fd, self._sealed + size)
        except OSError:
            # The blocks under the old tail are allocated, so this needs no space.
            write_all(self._fd, (self._tail,), self._sealed)
            os.ftruncate(self._fd, self._sealed + len(self._tail))
            self._torn = False
            raise
        self._torn = False


def _crc_of(chunk: Chunk, crc: int) -> int:
    for part in chunk.parts:
        crc = crc32(part, crc)
    return crc


def lock(fd: int, path: Path) -> None:
    """Take the file for writing; the system gives it back when the process ends.

    Raises:
        RecordingInUse: another process is writing it.

    """
    try:
        taken = take(fd)
    except OSError as error:
        raise write_error(path, error) from error
    if not taken:
        raise RecordingInUse(
            f"{path} is being written by another process", hint="Wait until its run has ended."
        )


def write_error(path: Path, error: OSError, *, begun: bool = False) -> RecordingError:
    """Return the message for the user if the system refuses to write ``path``.

    ``begun``: it holds a run already, which can be continued.
    """
    todo = "Its folder must be there and yours to write"
    if error.errno in _FULL:
        todo = "Free space on that disk" + ("" if begun else " or record elsewhere")
    rest = f", and `rigd run --resume {quote(str(path))}` plays what is missing" if begun else ""
    return RecordingError(
        f"cannot write {path}: {error.strerror}",
        hint=f"{todo}; the data flushed before are readable{rest}.",
    )


def open_locked(path: Path) -> int:
    """Open a file for writing; again if another process has just replaced it by a new one.

    Raises:
        RecordingInUse: another process is writing it.
        OSError: it cannot be opened.
    """
    while True:
        fd = os.open(path, os.O_RDWR | BINARY)
        try:
            lock(fd, path)
            if os.path.samestat(os.fstat(fd), path.stat()):
                return fd
        except BaseException:
            os.close(fd)
            raise
        os.close(fd)
