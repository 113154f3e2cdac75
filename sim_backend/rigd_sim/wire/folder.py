"""Locks the folder of a simulation, so that only one simulation at a time uses the folder."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Final, Self

from rigd.sdk import LinkError

#: Longest path of a socket, with its final zero (sun_path in linux/un.h).
LONGEST_PATH: Final = 108
LOCK: Final = "lock"


class Folder:
    """Holds ``path`` for this process; other files in it are left alone."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._lock: int | None = None

    def __enter__(self) -> Self:
        """Take the folder.

        Raises:
            LinkError: another simulation has it, or it cannot be used.

        """
        import fcntl  # Windows has none

        try:
            self.path.mkdir(mode=0o700, parents=True, exist_ok=True)
            lock = os.open(self.path / LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        except OSError as error:
            raise LinkError(
                f"the folder of the simulation cannot be used: {error}",
                hint="give another `folder` under `simulation:` in the rig file",
            ) from error
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            owner = os.read(lock, 20).decode() or "unknown"
            os.close(lock)
            raise LinkError(
                f"{self.path} is in use by another `rigd sim`, process {owner}",
                hint="end that one, or give another `folder` under `simulation:`",
            ) from None
        os.ftruncate(lock, 0)
        os.write(lock, str(os.getpid()).encode())
        self._lock = lock
        return self

    def __exit__(self, *_: object) -> None:
        """Release the folder; the lock file stays, so that no process locks a removed file."""
        if self._lock is not None:
            os.ftruncate(self._lock, 0)
            os.close(self._lock)
            self._lock = None

    def socket(self, name: str) -> Path:
        """Return the path of the socket or name ``name``; one that was left there is removed.

        Raises:
            LinkError: it is too long for a socket.

        """
        path = self.path / name
        if len(os.fsencode(path)) >= LONGEST_PATH:
            raise LinkError(
                f"{path} is too long for a socket: at most {LONGEST_PATH - 1} bytes",
                hint="give a shorter `folder` under `simulation:`",
            )
        if path.is_socket():
            path.unlink()  # of a simulation that was killed: the folder is ours now
        return path
