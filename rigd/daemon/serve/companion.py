"""A process beside the daemon that it starts, starts again where it dies, and ends: the panel."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Sequence
from types import TracebackType
from typing import Final, Self

from rigd.daemon.serve.notices import Notices
from rigd.engine.deaths import how_ended

#: One that died is started again after this long, and twice as long each time it dies again: it
#: may die of something that lasts, and each start takes a second of a processor.
AGAIN_S: Final = 5.0
LONGEST_S: Final = 300.0
#: One that has lived for so long died of something else than the one before.
LIVED_S: Final = 60.0
#: How long it may take to end.
END_S: Final = 3.0


class Companion:
    """Runs ``command`` from entering the context to leaving it; :meth:`tend` it now and then.

    It speaks to the daemon as every client does, and ends where the daemon is killed. Whatever
    becomes of it, the daemon goes on.
    """

    def __init__(self, name: str, command: Sequence[str], notices: Notices) -> None:
        self._name = name
        self._command = command
        self._notices = notices
        self._process: subprocess.Popen[bytes] | None = None
        self._started_at = self._again_at = 0.0  # monotonic, s
        self._wait_s = AGAIN_S / 2

    def __enter__(self) -> Self:
        self._start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        process = self._process
        if process is None:
            return
        process.terminate()
        try:
            process.wait(END_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()

    def tend(self) -> None:
        """See that it lives."""
        process, now = self._process, time.monotonic()
        if process is not None and process.poll() is not None:
            self._process = None
            self._failed(f"ended ({how_ended(process.returncode)})")
        if self._process is None and now >= self._again_at:
            self._start()

    def _start(self) -> None:
        self._started_at = time.monotonic()
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", "rigd.daemon.serve.tied", str(os.getpid()),
                 *self._command],
                stdin=subprocess.DEVNULL,
                start_new_session=True,  # the terminal's Ctrl-C is for the daemon
            )  # fmt: skip
        except OSError as error:
            self._failed(f"cannot be started ({error.strerror})")

    def _failed(self, how: str) -> None:
        now = time.monotonic()
        lived_s = now - self._started_at
        longer_s = AGAIN_S if lived_s > LIVED_S else 2 * self._wait_s
        self._wait_s = min(longer_s, LONGEST_S)
        self._again_at = now + self._wait_s
        self._notices.note(
            f"{self._name} {how}, and is started again in {self._wait_s:.0f} s", "warning"
        )
