"""Keeps file descriptors free for the daemon, however many connections are open.

The operating system limits the number of files and connections that a process has open
(RLIMIT_NOFILE). Connections that never authenticate can use up this number. Therefore a separate
thread counts the open descriptors and ends such connections before the limit is reached. Some
descriptors are reserved for this thread.
"""

from __future__ import annotations

import logging
import resource
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from rigd.daemon.serve.notices import Level
from rigd.engine.shared.scarce import NO_DESCRIPTOR
from rigd.remote.server import Admission

_LOG: Final = logging.getLogger(__name__)

#: More than a rig with all its clients ever needs (about 100).
WANTED: Final = 65_536
#: Reserved for the thread that counts, and for zenoh to close its connections.
KEPT_BACK: Final = 32
#: The descriptors are counted this often, in s.
LOOK_S: Final = 0.05
#: From this part of the limit on, unauthenticated connections are ended.
BUSY: Final = 0.75
#: If no descriptor is free for so long, the daemon asks to be restarted, in s.
HELPLESS_S: Final = 10.0


class Descriptors:
    """Counts the file descriptors of this process and keeps some free."""

    def __init__(self) -> None:
        #: how many there may be
        self.limit, self._hard = resource.getrlimit(resource.RLIMIT_NOFILE)
        self._most = self.limit
        #: how many there were at the last count
        self.used = self._count()
        self.unauthenticated_ended = 0  #: connections
        self.accept_pauses = 0  #: how often no connection was accepted for a while
        self._ended = 0  # connections that this ended
        self._full_since_s: float | None = None
        self._crowded = False

    def raise_limit(self) -> None:
        """Allow as many as may be, but for those that are kept back."""
        unlimited = self._hard == resource.RLIM_INFINITY
        self._most = WANTED if unlimited else min(WANTED, self._hard)
        self.limit = self._most - KEPT_BACK
        self._set(self.limit)

    def as_status(self) -> dict[str, int]:
        """Return the counters for the status."""
        return {
            "descriptors": self.used,
            "descriptors_most": self.limit,
            "unauthenticated_ended": self.unauthenticated_ended,
            "accept_pauses": self.accept_pauses,
        }

    @contextmanager
    def watched(self, admission: Admission, note: Callable[[str, Level], None]) -> Iterator[None]:
        """Count them while inside; ``note`` gets lines for the operator."""
        closing = threading.Event()
        thread = threading.Thread(
            target=self._work, args=(admission, note, closing), name="descriptors", daemon=True
        )
        thread.start()
        try:
            yield
        finally:
            closing.set()
            thread.join()

    @property
    def helpless(self) -> str:
        """Why no client can connect any more, in words; "" while this may still change."""
        since_s = self._full_since_s
        if since_s is None or time.monotonic() - since_s < HELPLESS_S:
            return ""
        return f"all {self.limit} descriptors have been in use for {HELPLESS_S:g} s"

    def _work(
        self, admission: Admission, note: Callable[[str, Level], None], closing: threading.Event
    ) -> None:
        while not closing.wait(LOOK_S):
            try:
                self._look(admission, note)
            except Exception:  # noqa: BLE001 - a watch that ends watches nothing
                _LOG.exception("the descriptors cannot be counted")

    def _look(self, admission: Admission, note: Callable[[str, Level], None]) -> None:
        if admission.pauses > self.accept_pauses:
            self.accept_pauses = admission.pauses
            note(
                "too many unauthenticated connections: for a while no other is accepted", "warning"
            )
        self.unauthenticated_ended = self._ended + admission.waiting_ended
        self.used = self._count()
        full = self.used >= self.limit
        if not full:
            self._full_since_s = None
        elif self._full_since_s is None:
            self._full_since_s = time.monotonic()
        if self.used < BUSY * self.limit:
            self._crowded = False
            return
        with self._all():
            ended = admission.end_unauthenticated()
            self._ended += ended
            if full:
                ended += admission.refuse_waiting()
                # zenoh needs free descriptors to see that these connections have ended.
                time.sleep(LOOK_S)
        self.unauthenticated_ended = self._ended + admission.waiting_ended
        if (ended or full) and not self._crowded:
            self._crowded = True
            note(
                f"{self.used} of {self.limit} descriptors are in use: unauthenticated connections "
                "are ended",
                "warning",
            )

    def _count(self) -> int:
        size = Path("/proc/self/fd").stat().st_size  # their number, since Linux 6.2; before it, 0
        if size:
            return size
        try:
            return len(list(Path("/proc/self/fd").iterdir())) - 1
        except OSError as error:
            if error.errno not in NO_DESCRIPTOR:
                raise
            return self.limit

    @contextmanager
    def _all(self) -> Iterator[None]:
        """Give the reserved descriptors to the process while inside."""
        self._set(self._most)
        try:
            yield
        finally:
            self._set(self.limit)

    def _set(self, limit: int) -> None:
        resource.setrlimit(resource.RLIMIT_NOFILE, (limit, self._hard))
