"""Covers what differs between Linux, Windows and macOS: files, and what needs Linux.

Names of ``os`` are asked for when they are used: each system has others.
"""

from __future__ import annotations

import os
import select
import socket
import struct
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

from rigd.model.errors import Exit, RigdError

if TYPE_CHECKING:
    from _typeshed import FileDescriptorLike

#: For ``os.open``: the bytes of a file as they are. Windows otherwise changes ends of lines.
BINARY: Final[int] = getattr(os, "O_BINARY", 0)


#: asm-generic/socket.h: nine numbers of 32 bits, of which the last, SK_MEMINFO_DROPS, counts what
#: found the queue full.
_SO_MEMINFO: Final = 55
_MEMORY_INFO: Final = struct.Struct("=9I")


class NeedsLinux(RigdError):
    """A command or device that this operating system cannot run."""

    exit_code = Exit.BAD_INPUT


def on_linux() -> bool:
    """Return whether this is Linux, where rigs run."""
    return sys.platform == "linux"


def require_linux(what: str) -> None:
    """Do nothing on Linux.

    Raises:
        NeedsLinux: this is another system; ``what`` begins the sentence.
    """
    if not on_linux():
        raise NeedsLinux(
            f"{what} needs Linux; on this system rigd reads, imports, exports and identifies "
            "recordings, runs in virtual time, and reaches rigs elsewhere by `rigd remote`"
        )


def readable(handle: FileDescriptorLike, timeout_s: float) -> bool:
    """Wait until bytes have arrived at a descriptor, or it has ended; False after ``timeout_s``.

    Any descriptor will do: ``select.select`` refuses those above 1023, which a daemon with many
    connections has.
    """
    poll = select.poll()
    poll.register(handle, select.POLLIN)
    return bool(poll.poll(max(0.0, timeout_s) * 1e3))


def dropped(own: socket.socket) -> int:
    """Return how many packets found the queue of ``own`` full since it was opened; 0: not known."""
    try:
        known = own.getsockopt(socket.SOL_SOCKET, _SO_MEMINFO, _MEMORY_INFO.size)
        return int(_MEMORY_INFO.unpack(known)[-1])
    except (OSError, struct.error):  # closed, or not Linux from 4.12 on
        return 0


def read_at(fd: int, length: int, offset: int) -> bytes:
    """Return up to ``length`` bytes from byte ``offset`` of a file that no other thread reads."""
    if hasattr(os, "pread"):
        return os.pread(fd, length, offset)
    os.lseek(fd, offset, os.SEEK_SET)
    parts: list[bytes] = []
    while length > 0 and (part := os.read(fd, length)):
        parts.append(part)
        length -= len(part)
    return b"".join(parts)


def write_at(fd: int, parts: Sequence[bytes | memoryview], offset: int) -> int:
    """Write ``parts`` one after the other at byte ``offset``, in one call where there is one.

    Return the number of bytes written, which is less if the system cuts the call short.

    Raises:
        OSError: nothing can be written.
    """
    if hasattr(os, "pwritev"):
        return os.pwritev(fd, parts, offset)
    os.lseek(fd, offset, os.SEEK_SET)
    return os.write(fd, b"".join(parts))


def copy_mode(fd: int, mode: int) -> None:
    """Give an open file the permissions ``mode``, where files have such."""
    if hasattr(os, "fchmod"):
        os.fchmod(fd, mode & 0o777)


def sync_data(fd: int) -> None:
    """Wait until the bytes of a file are on the disk."""
    if hasattr(os, "fdatasync"):
        os.fdatasync(fd)
    else:
        os.fsync(fd)


def sync_folder(folder: Path) -> None:
    """Wait until the disk has the new names in a folder; Windows offers no way to wait."""
    if not hasattr(os, "O_DIRECTORY"):
        return
    fd = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(fd)
    finally:
        os.close(fd)
