"""Maps a file into the memory of several processes; the file remains when they end.

The first page holds 64-bit words: the type of the file, and counters. Only one process writes a
given word, with one aligned store (an item of a memoryview of format ``Q``), so that a reader never
sees a half-written word. The writer first writes the data, then the counter that announces them. On
x86-64 every processor sees the stores in that order. On AArch64 the interpreter's own locking
between two byte codes orders the stores in practice, but nothing guarantees it.
"""

from __future__ import annotations

import mmap
import os
from pathlib import Path
from typing import Final, Self

from rigd.model.errors import RecordingError

#: Bytes of the page that holds the words; the payload begins on the next one.
HEAD_BYTES: Final = 4096
_MAGIC, _IDENTITY = (
    0,
    1,
)  #: type of the file; users of the class have the words from 2 on
FIRST_FREE_WORD: Final = 2


class SharedFile:
    """A mapped file of one page of words and a payload of any size.

    ``magic`` (8 bytes) names the kind of file and its version, ``identity`` the layout of its
    content: a process that expects another layout is refused.
    """

    def __init__(self, path: Path, fd: int, size: int = 0) -> None:
        """Use :meth:`create`, :meth:`attach` or :meth:`unshared`."""
        self.path = path
        # Populated: a page touched for the first time within a cycle costs up to 38 ms.
        kept: dict[str, int] = {}
        if hasattr(mmap, "MAP_SHARED"):  # Windows has no choice of flags
            kept["flags"] = mmap.MAP_SHARED | getattr(mmap, "MAP_POPULATE", 0)
        memory = memoryview(mmap.mmap(fd, size, **kept))
        self.words = memory[:HEAD_BYTES].cast("Q")
        self.payload = memory[HEAD_BYTES:]

    @classmethod
    def create(cls, path: Path, magic: bytes, identity: int, size: int) -> Self:
        """Make a file with a payload of ``size`` bytes, all zero, in allocated memory.

        Raises:
            RecordingError: it exists already, or there is no room for it.
        """
        try:
            fd = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600)
        except OSError as error:
            raise _cannot("make", path, error) from error
        try:
            # Allocated, not only declared: a write to a hole in a full tmpfs kills the process.
            os.posix_fallocate(fd, 0, HEAD_BYTES + size)
            made = cls(path, fd)
        except OSError as error:
            path.unlink()
            raise _cannot("make", path, error) from error
        finally:
            os.close(fd)
        made.words[_IDENTITY] = identity
        made.words[_MAGIC] = _word(magic)
        return made

    @classmethod
    def attach(cls, path: Path, magic: bytes, identity: int) -> Self:
        """Map a file that :meth:`create` made.

        Raises:
            RecordingError: it is missing, or not the expected file.
        """
        try:
            fd = os.open(path, os.O_RDWR | os.O_CLOEXEC)
        except OSError as error:
            raise _cannot("open", path, error) from error
        try:
            if os.fstat(fd).st_size < HEAD_BYTES:
                raise _foreign(path)
            found = cls(path, fd)
        finally:
            os.close(fd)
        if (found.words[_MAGIC], found.words[_IDENTITY]) != (_word(magic), identity):
            raise _foreign(path)
        return found

    @classmethod
    def unshared(cls, size: int) -> Self:
        """Make the same in private memory of this process; its path names no file."""
        return cls(Path(), -1, HEAD_BYTES + size)


def _word(magic: bytes) -> int:
    return int.from_bytes(magic, "little")


def _cannot(verb: str, path: Path, error: OSError) -> RecordingError:
    hint = "RIGD_STATE names a folder in memory (tmpfs) with room for a minute of samples."
    return RecordingError(
        f"cannot {verb} {path}: {error.strerror}", hint=hint if verb == "make" else None
    )


def _foreign(path: Path) -> RecordingError:
    return RecordingError(
        f"{path} has another layout than expected",
        hint="Another version of rigd made it, or it belongs to another rig.",
    )
