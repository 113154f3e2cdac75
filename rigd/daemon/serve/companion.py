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

#: One that died is started again after this long: it may have died of something that lasts.
AGAIN_S: Final = 5.0
#: How long it may take to end.
END_S: Final = 3.0


class Companion:
    """Runs ``command`` from entering the context to leaving it; :meth:`tend` it now and then.

    It speaks to the daemon as every client does, and ends where the daemon is killed.
    """

    def __init__(self, name: str, command: Sequence[str], notices: Notices) -> None:
        self._name = name
        self._command = command
        self._notices = notices
        self._process: subprocess.Popen[bytes] | None = None
        self._again_at = 0.0

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
            how = how_ended(process.returncode)
            self._notices.note(f"{self._name} ended ({how}), and is started again", "warning")
            self._process, self._again_at = None, now + AGAIN_S
        if self._process is None and now >= self._again_at:
            self._start()

    def _start(self) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", "rigd.daemon.serve.tied", str(os.getpid()),
             *self._command],
            stdin=subprocess.DEVNULL,
            start_new_session=True,  # the terminal's Ctrl-C is for the daemon
        )  # fmt: skip
