"""Who did what, and when: a file of JSON lines that is only ever appended to."""

from __future__ import annotations

import json
import logging
import os
import threading
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from time import time_ns
from typing import Any, Final

from rigd.model.errors import RecordingError

_LOG: Final = logging.getLogger(__name__)


class AuditLog:
    """The audit log of one rig, at ``path``.

    A line says ``time`` (UTC), ``who``, ``role`` where it is known, ``what``, its ``args`` and
    its ``result``: ``done``, or the code and the message of the refusal. Each is on disk before
    :meth:`write` returns. The file is opened anew for each line, so that it may be moved away.
    """

    def __init__(self, path: Path, clock: Callable[[], int] = time_ns) -> None:
        self.path = path
        self.broken = ""  #: why the last line could not be written, or ""
        self._clock = clock
        self._lock = threading.Lock()

    def write(
        self, who: str, what: str, args: Mapping[str, Any], result: str = "done", role: str = ""
    ) -> None:
        """Append one line; where that fails, :attr:`broken` says so until one could be."""
        moment = datetime.fromtimestamp(self._clock() * 1e-9, UTC)
        line = {"time": moment.isoformat(timespec="milliseconds"), "who": who}
        if role:
            line["role"] = role
        whole = json.dumps({**line, "what": what, "args": dict(args), "result": result})
        with self._lock:
            try:
                self._append(whole.encode() + b"\n")
            except OSError as error:
                self.broken = f"{self.path} cannot be written: {error.strerror}"
                _LOG.error("audit: %s; not kept: %s", self.broken, whole)
            else:
                self.broken = ""

    def check(self) -> None:
        """Make sure that what is done next will be kept.

        Raises:
            RecordingError: the file cannot be written.
        """
        if self.broken:
            self.write("rigd", "audit", {}, "kept again")
        else:
            try:
                os.close(self._open())
            except OSError as error:
                self.broken = f"{self.path} cannot be written: {error.strerror}"
        if self.broken:
            raise RecordingError(
                f"nobody could tell who did this: {self.broken}",
                hint="free its disk, or correct its owner; then ask again",
            )

    def _append(self, line: bytes) -> None:
        fd = self._open()
        try:
            # One write: lines of two processes never mix (O_APPEND).
            if os.write(fd, line) < len(line):
                raise OSError(28, "no space left for a whole line")
            os.fsync(fd)
        finally:
            os.close(fd)

    def _open(self) -> int:
        return os.open(self.path, os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC, 0o640)
