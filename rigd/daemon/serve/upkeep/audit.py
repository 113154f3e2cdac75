"""Writes the audit log of a rig: one JSON line per command; lines are only appended."""

from __future__ import annotations

import errno
import json
import logging
import os
import threading
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from time import time_ns
from typing import Any, Final

from rigd.engine.shared.scarce import insist
from rigd.model.errors import RecordingError

_LOG: Final = logging.getLogger(__name__)
#: How long to wait for a free descriptor, in s; meanwhile the daemon gives no sign of life.
_PATIENCE_S: Final = 2.0


class AuditLog:
    """The audit log of one rig, at ``path``.

    A line has ``time`` (UTC), ``who`` (the client), the ``user`` if that client acts for several
    people, ``role`` if known, ``what`` (the verb), its ``args`` and its ``result``: ``done``, or
    the code and the message of the refusal. Each line is on disk before :meth:`write` returns. The
    file is opened again for each line, so that it may be moved. If lines could not be written, the
    next line states how many are missing.
    """

    def __init__(self, path: Path, clock: Callable[[], int] = time_ns) -> None:
        self.path = path
        self.broken = ""  #: why the last line could not be written, or ""
        self._missing = 0  #: lines that could not be written since one could
        self._clock = clock
        self._lock = threading.Lock()

    def write(
        self,
        who: str,
        what: str,
        args: Mapping[str, Any],
        result: str = "done",
        *,
        role: str = "",
        user: str = "",
    ) -> None:
        """Append a line; after a failure, :attr:`broken` has the reason until a line succeeds."""
        optional = {name: text for name, text in (("user", user), ("role", role)) if text}
        entry = {"who": who, **optional, "what": what, "args": dict(args), "result": result}
        line = self._line(entry)
        with self._lock:
            try:
                if self._missing:
                    missing = {"who": "rigd", "what": "audit", "args": {"missing": self._missing}}
                    self._append(self._line({**missing, "result": "kept again"}))
                    self._missing = 0
                insist(lambda: self._append(line), _PATIENCE_S)
            except OSError as error:
                self._missing += 1
                self.broken = f"{self.path} cannot be written: {error.strerror}"
                _LOG.error("audit: %s; not kept: %s", self.broken, line)
            else:
                self.broken = ""

    def check(self) -> None:
        """Check that the next command can be logged.

        Raises:
            RecordingError: the file cannot be written.
        """
        if self.broken:
            self.write("rigd", "audit", {}, "tried again")
        else:
            try:
                os.close(insist(self._open, _PATIENCE_S))
            except OSError as error:
                self.broken = f"{self.path} cannot be written: {error.strerror}"
        if self.broken:
            raise RecordingError(
                f"this command could not be logged: {self.broken}",
                hint="free its disk, or correct its owner; then ask again",
            )

    def _line(self, entry: Mapping[str, Any]) -> str:
        moment = datetime.fromtimestamp(self._clock() * 1e-9, UTC)
        return json.dumps({"time": moment.isoformat(timespec="milliseconds"), **entry})

    def _append(self, line: str) -> None:
        fd = self._open()
        try:
            # A line that a full disk or a power failure has cut short stays, and gets an end.
            whole = f"{'' if _ends(fd) else chr(10)}{line}\n".encode()
            # One write: lines of two processes never mix (O_APPEND).
            if os.write(fd, whole) < len(whole):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            os.fsync(fd)
        finally:
            os.close(fd)

    def _open(self) -> int:
        return os.open(self.path, os.O_RDWR | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC, 0o640)


def _ends(fd: int) -> bool:
    """Return whether the last line of a file has its end."""
    size = os.fstat(fd).st_size
    return size == 0 or os.pread(fd, 1, size - 1) == b"\n"
