"""Watches what a simulated device does, while a driver is called.

The peer shows it (:class:`~rigd.sdk.check.Observed`); nothing here goes over the driver's link.
"""

from __future__ import annotations

import contextlib
import os
import threading
import time
from bisect import bisect_right
from collections import deque
from collections.abc import Callable, Sequence
from io import FileIO
from pathlib import Path
from typing import Final, Self

from rigd.sdk.check.peer import Observed, Peer

#: Time between two looks at the device, in s.
LOOK_S: Final = 0.001
#: Time between two looks at what this machine holds back, in s, and how many are kept.
HELD_LOOK_S: Final = 0.01
HELD_LOOKS: Final = 6000
#: This machine holds a sequence back if nothing looks at the device for so long, in s, or if
#: threads of this process wait for a processor for more than this part of the time.
STALL_S: Final = 0.025
HELD_PART: Final = 0.05


class HeldTime:
    """For how long threads of this process have waited for a processor, in all.

    What passes between two events, one of which causes the other in another thread, is at most so
    much longer than on a machine that is free. 0 on a system that does not tell; ``threads`` is
    the folder in which it does.
    """

    def __init__(self, threads: Path = Path("/proc/self/task")) -> None:
        self._folder = threads
        self.without = ""  # the number of a thread for which nothing waits that is judged
        self._lock = threading.RLock()
        self._threads: dict[str, int] = {}  # in ns
        self._s = 0.0
        self._looks: deque[tuple[float, float]] = deque(maxlen=HELD_LOOKS)
        self.look()

    def look(self) -> float:
        """Return it, in s, and note it with the time."""
        with self._lock:
            now_s, threads = time.monotonic(), {}
            for task in self._tasks():  # as text: a Path for each takes twice as long in all
                with contextlib.suppress(OSError), FileIO(f"{task.path}/schedstat") as file:
                    threads[task.name] = int(file.read().split()[1])  # else it has ended
            threads.pop(self.without, None)
            if self._looks:
                self._s += 1e-9 * sum(
                    max(0, waited - self._threads.get(name, 0)) for name, waited in threads.items()
                )
            self._threads = threads
            self._looks.append((now_s, self._s))
            return self._s

    def _tasks(self) -> list[os.DirEntry[str]]:
        return list(os.scandir(self._folder)) if self._folder.exists() else []

    def since(self, time_s: float) -> float:
        """Return how much of it was since a time of CLOCK_MONOTONIC, or some more, in s."""
        with self._lock:
            now_s = self.look()
            return now_s - next((s for at_s, s in reversed(self._looks) if at_s <= time_s), 0.0)

    def exceeds(self, took_s: float, most_s: float, since_s: float) -> bool:
        """Return whether what was done since a time took longer than it may, this machine apart."""
        return took_s > most_s and took_s > most_s + self.since(since_s)


class Watcher:
    """Looks at a device all the time, and keeps each look that differs from the one before."""

    def __init__(self, peer: Peer) -> None:
        self._peer = peer
        self._ended = threading.Event()
        self._failed: list[Exception] = []
        self._lock = threading.Lock()
        #: Time and look.
        self.seen: list[tuple[float, Observed]] = [(time.monotonic(), peer.look())]
        #: The longest time between two looks, in s: this machine may stall; and of all.
        self.gap_s = self.longest_gap_s = 0.0
        self.held = HeldTime()
        self._thread = threading.Thread(target=self._watch, name="watcher of the device")
        self._thread.daemon = True

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
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
        first = bisect_right([at_s for at_s, _ in self.seen], began_s) - 1
        return [look for _, look in self.seen[max(0, first) :]]

    def when(self, holds: Callable[[Observed], bool]) -> float:
        """Return the first time since when something holds up to now."""
        at_s = time.monotonic()
        for time_s, look in reversed(self.seen):
            if not holds(look):
                break
            at_s = time_s
        return at_s

    def stalls(self, gap_s: float = STALL_S) -> bool:
        """Return whether this machine held back what was done since the first look.

        Nothing looked at the device for ``gap_s``, or threads waited for a processor.
        """
        began_s = self.seen[0][0]
        most_s = gap_s + HELD_PART * (time.monotonic() - began_s)
        return self.longest_gap_s > gap_s or self.held.since(began_s) > most_s

    def _watch(self) -> None:
        self.held.without = str(threading.get_native_id())
        last = held_s = time.monotonic()
        while not self._ended.wait(LOOK_S):
            try:
                self.look()
            except Exception as error:  # noqa: BLE001  # of the peer: raised by the next look
                self._failed.append(error)
                return
            now = time.monotonic()
            self.gap_s = max(self.gap_s, now - last)
            self.longest_gap_s = max(self.longest_gap_s, now - last)
            last = now
            if now > held_s + HELD_LOOK_S:
                self.held.look()
                held_s = now


def until(holds: Callable[[], bool], within_s: float) -> bool:
    """Wait until something holds; return whether it did in time."""
    end = time.monotonic() + within_s
    while not holds():
        if time.monotonic() > end:
            return False
        time.sleep(LOOK_S)
    return True
