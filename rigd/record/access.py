"""Reads files at a given position on every operating system, also while another process writes.

rigd writes recordings on Linux only. It reads, exports and identifies from recordings on Windows
and macOS too, although these systems lack some functions of Linux.
"""

from __future__ import annotations

import os
import stat
from importlib import import_module
from pathlib import Path
from shlex import quote
from types import ModuleType

from rigd.model import RecordingError

fcntl: ModuleType | None
try:
    fcntl = import_module("fcntl")
except ImportError:  # Windows
    fcntl = None


def require_writing() -> None:
    """Raise unless this system has the functions for writing recordings.

    Raises:
        RecordingError: it lacks one.
    """
    if fcntl is None or not hasattr(os, "pwritev"):
        raise RecordingError(
            "recordings are made and repaired on Linux only",
            hint="Here they can be read: `rigd info`, `verify`, `identify`, `report`, `export`.",
        )


def how_to_recover(path: Path) -> str:
    """Return what ``rigd recover`` does with a file that is damaged, or lacks its end."""
    return (
        f"`rigd recover {quote(str(path))}` leaves out what is damaged and keeps the damaged file "
        f"as {path.name}.orig; a file that only lacks its end is completed in place."
    )


def require_regular(path: Path) -> None:
    """Raise unless there is a regular file: to open a pipe waits for its writer.

    Raises:
        OSError: missing.
        RecordingError: a folder, a pipe or a device.

    """
    mode = path.stat().st_mode
    if not stat.S_ISREG(mode):
        kind, hint = "a pipe, a socket or a device", "Give a recording: FILE.mcap."
        if stat.S_ISDIR(mode):
            kind, hint = "a folder", f"`rigd runs {quote(str(path))}` lists its recordings."
        raise RecordingError(f"{path} is {kind}, not a file", hint=hint)


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


def share(fd: int) -> bool:
    """Lock a file against writers until it is closed; return False if a writer has it open.

    On systems without such locks, rigd does not write.
    """
    if fcntl is None:
        return True
    try:
        fcntl.flock(fd, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def take(fd: int) -> bool:
    """Take a file for writing until it is closed; return False if another process has it.

    Raises:
        OSError: files cannot be locked on this system or file system.

    """
    require_writing()
    if fcntl is None:
        return False
    try:
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True
