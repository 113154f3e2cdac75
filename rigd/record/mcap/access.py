"""Locks the files of recordings between processes, and checks that they are files."""

from __future__ import annotations

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


def has_locks() -> bool:
    """Return whether this system locks files for a process; Windows does not lock them like that.

    There nobody stops two processes that write one recording; the first one finds at its next
    flush that its file has changed, and ends.
    """
    return fcntl is not None


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


def share(fd: int) -> bool:
    """Lock a file against writers until it is closed; return False if a writer has it open.

    Systems without such locks always grant it.
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

    Systems without such locks always grant it.

    Raises:
        OSError: files cannot be locked on this file system.

    """
    if fcntl is None:
        return True
    try:
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True
