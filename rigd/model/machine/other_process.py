"""Finds out that another process has been killed, before the kernel has cleared it away.

The end of a socket, a pidfd and waitpid(2) show the end of a process only after the kernel has
freed its memory, for which its threads need processor time: 77 to 165 ms for 300 MB and 11 threads,
69 to 745 ms beside programs that compute on each processor. ``/proc/PID/stat`` (proc(5)) showed
each of these 16 kills within 0.2 ms, and reading it takes 5 us. A process that is slow or stopped
(SIGSTOP) does not look like that.
"""

from __future__ import annotations

import os
import signal
from contextlib import suppress
from pathlib import Path
from typing import Final

from rigd.model.machine.system import readable

#: Places in /proc/PID/stat after the name, and what shows there that the process ends.
_STATE: Final = 0
_FLAGS: Final = 6
_PENDING: Final = 28
_ENDED: Final = (b"Z", b"X")
_EXITING: Final = 0x4 | 0x400  #: PF_EXITING, PF_SIGNALED of <linux/sched.h>
_SIGKILL: Final = 1 << 8  #: the kernel gives it to each thread of a process that a signal ends


class OtherProcess:
    """A process that may end at any time; its number may be used again then without harm.

    Raises:
        OSError: this process has no descriptor left.
    """

    def __init__(self, pid: int) -> None:
        self._handle: int | None = None  #: pidfd; None: it has ended
        with suppress(ProcessLookupError):
            self._handle = os.pidfd_open(pid)
        self._stat: int | None = None  #: None: it does not show
        with suppress(FileNotFoundError, ProcessLookupError, PermissionError):
            self._stat = os.open(f"/proc/{pid}/stat", os.O_RDONLY | os.O_CLOEXEC)

    def ending(self) -> bool:
        """Return whether it ends or has ended: it executes no more of its own code."""
        if self._handle is None or self._stat is None:
            return self.ended()
        try:
            return shows_end(os.pread(self._stat, 1024, 0))
        except ProcessLookupError:  # it is gone
            return True

    def ended(self, within_s: float = 0.0) -> bool:
        """Return whether it has ended with all threads and files; wait at most ``within_s``."""
        return self._handle is None or readable(self._handle, within_s)


def how_ended(code: int) -> str:
    """Put an exit code of :mod:`subprocess` in words that follow the name of the process."""
    if code >= 0:
        return f"ended by itself (exit code {code})"
    try:
        return f"was ended by {signal.Signals(-code).name}"
    except ValueError:  # most real-time signals have no name
        return f"was ended by signal {-code}"


def child_ending(pid: int) -> bool:
    """Return whether a child that was not waited for yet ends or has ended, as far as it shows."""
    try:
        return shows_end(Path(f"/proc/{pid}/stat").read_bytes())
    except OSError:
        return False


def shows_end(stat: bytes) -> bool:
    """Return whether the content of /proc/PID/stat shows that the process ends or has ended."""
    found = stat.rpartition(b")")[2].split()
    return (
        found[_STATE] in _ENDED
        or bool(int(found[_FLAGS]) & _EXITING)
        or bool(int(found[_PENDING]) & _SIGKILL)
    )
