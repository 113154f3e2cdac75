"""Runs a child process of the daemon (the panel): starts it, restarts it if it dies, ends it."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Final, Self

from rigd.daemon.serve.upkeep.notices import Notices
from rigd.engine.system.child import Child

#: One that died is started again at once. If it dies again it is started after this long, and after
#: twice as long each time: it may die of something that lasts, and a start costs a second of CPU.
AGAIN_S: Final = 0.5
LONGEST_S: Final = 300.0
#: A process that has run for so long begins again with the shortest pause, in s.
LIVED_S: Final = 60.0
#: The spare is started this long after the process that it can replace, in s: that starts first.
SPARE_S: Final = 3.0
#: How long a process may take to end, in s.
END_S: Final = 3.0


class SupervisedProcess:
    """Runs ``command`` while the context is entered; the caller calls :meth:`tend` regularly.

    The process is a client of the daemon, and ends if the daemon is killed. Its failures do not
    affect the daemon. ``spare`` is the same command, but it waits for a line on its standard input
    before it begins: it has loaded everything, and replaces a process that has died within a
    fraction of a second, even on a busy machine.
    """

    def __init__(
        self, name: str, command: Sequence[str], notices: Notices, spare: Sequence[str] = ()
    ) -> None:
        self._name = name
        self._command = command
        self._notices = notices
        self._spare_command = spare
        self._child: Child | None = None
        self._spare: Child | None = None
        self._started_at = self._again_at = 0.0  # monotonic, s
        self._wait_s: float | None = None  # before the start that follows the next death

    def __enter__(self) -> Self:
        self._start()
        return self

    def __exit__(self, *_: object) -> None:
        children = [child for child in (self._child, self._spare) if child is not None]
        for child in children:
            child.terminate()
        for child in children:
            if not child.wait(END_S):
                child.fence(None)
            child.close_stdin()

    def tend(self) -> None:
        """Start the process again if it has ended."""
        now = time.monotonic()
        if self._child is not None and (how := self._child.ended):
            self._child = None
            self._failed(how)
        if self._child is None and now >= self._again_at:
            self._start()
        if self._spare is not None and self._spare.ended:
            self._spare.close_stdin()
            self._spare = None
        if self._spare is None and self._spare_command and now >= self._started_at + SPARE_S:
            self._stand_by()

    def _start(self) -> None:
        self._started_at = time.monotonic()
        try:
            self._child = self._take_spare() or Child(self._command, tied=True)
        except OSError as error:
            self._failed(f"cannot be started ({error.strerror})")

    def _take_spare(self) -> Child | None:
        """Let the spare begin, and return it; None if there is none."""
        spare, self._spare = self._spare, None
        return spare if spare is not None and spare.wake() else None

    def _stand_by(self) -> None:
        if self._child is None:
            return
        try:
            self._spare = Child(self._spare_command, tied=True, stdin=True)
        except OSError as error:
            self._spare_command = ()
            self._notices.note(f"{self._name} has no spare ({error.strerror})", "warning")

    def _failed(self, how: str) -> None:
        now = time.monotonic()
        if self._wait_s is None or now - self._started_at > LIVED_S:
            wait_s, self._wait_s = 0.0, AGAIN_S
        else:
            wait_s, self._wait_s = self._wait_s, min(2 * self._wait_s, LONGEST_S)
        self._again_at = now + wait_s
        when = f"in {wait_s:g} s" if wait_s else "at once"
        self._notices.note(f"{self._name} {how}, and is started again {when}", "warning")
