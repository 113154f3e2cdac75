"""Watches what a simulated device does, while a driver is called.

The peer shows it (:class:`~rigd.sdk.check.Observed`); nothing here goes over the driver's link.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final, Self

from rigd.sdk.check.peer import Observed, Peer

#: Time between two looks at the device, in s.
LOOK_S: Final = 0.001


class Watcher:
    """Looks at a device all the time, and keeps each look that differs from the one before."""

    def __init__(self, peer: Peer) -> None:
        self._peer = peer
        self._ended = threading.Event()
        self._failed: list[Exception] = []
        self._lock = threading.Lock()
        #: Time and look.
        self.seen: list[tuple[float, Observed]] = [(time.monotonic(), peer.look())]
        #: The longest time between two looks, in s: this machine may stall.
        self.gap_s = 0.0
        self._thread = threading.Thread(target=self._watch, name="watcher of the device")
        self._thread.daemon = True

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def stop(self) -> None:
        """Look no more, unless asked."""
        self._ended.set()
        self._thread.join()

    def look(self) -> Observed:
        """Return what the device does now."""
        if self._failed:
            raise self._failed[0]
        with self._lock:  # the looks are in the order of their times
            now = self._peer.look()
            if now != self.seen[-1][1]:
                self.seen.append((time.monotonic(), now))
        return now

    def since(self, began_s: float) -> Sequence[Observed]:
        """Return all that the device did since a time, beginning with what it did then."""
        return [look for _, look in self.seen[self._index(began_s) :]]

    def when(self, holds: Callable[[Observed], bool]) -> float:
        """Return the first time since when something holds up to now."""
        at_s = time.monotonic()
        for time_s, look in reversed(self.seen):
            if not holds(look):
                break
            at_s = time_s
        return at_s

    def _index(self, time_s: float) -> int:
        index = len(self.seen) - 1
        while index > 0 and self.seen[index][0] > time_s:
            index -= 1
        return index

    def _watch(self) -> None:
        last = time.monotonic()
        while not self._ended.wait(LOOK_S):
            try:
                self.look()
            except Exception as error:  # noqa: BLE001  # of the peer: raised by the next look
                self._failed.append(error)
                return
            now = time.monotonic()
            self.gap_s = max(self.gap_s, now - last)
            last = now


def queued_s() -> float:
    """Return for how long this thread has waited for a processor, in s; 0 if nobody knows."""
    with contextlib.suppress(OSError):  # another system
        return int(Path("/proc/thread-self/schedstat").read_text("ascii").split()[1]) * 1e-9
    return 0.0


def all_queued_s() -> float:
    """Return for how long all threads of this process have waited for a processor, in s.

    0 if nobody knows.
    """
    waited_ns = 0
    for task in Path("/proc/self/task").glob("*/schedstat"):
        with contextlib.suppress(OSError):  # it has ended
            waited_ns += int(task.read_text("ascii").split()[1])
    return waited_ns * 1e-9


def until(holds: Callable[[], bool], within_s: float) -> bool:
    """Wait until something holds; return whether it did in time."""
    end = time.monotonic() + within_s
    while not holds():
        if time.monotonic() > end:
            return False
        time.sleep(LOOK_S)
    return True
