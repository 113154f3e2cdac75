"""A witness of how late this machine is: what a bound on wall time must allow besides itself."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest

#: How often the witness asks to be woken, in s.
PERIOD_S = 2e-3
#: How long this computer stands still for a test, in s.
STALL_S = 60.0


def standing_still(monkeypatch: pytest.MonkeyPatch) -> Callable[[], None]:
    """Return what lets this computer stand still for a minute, by the clocks that drivers read."""
    now, now_ns, ahead = time.monotonic, time.monotonic_ns, [0.0]
    monkeypatch.setattr(time, "monotonic", lambda: now() + ahead[0])
    monkeypatch.setattr(time, "monotonic_ns", lambda: now_ns() + round(ahead[0] * 1e9))
    return lambda: ahead.append(ahead.pop() + STALL_S)


@contextmanager
def longest_stall() -> Iterator[Callable[[], float]]:
    """Yield what returns the longest that this process was kept waiting since the beginning, in s.

    Beside it stands what a single stall may do: a device that is silent for it is taken for lost.
    """
    longest_s, ended = 0.0, threading.Event()

    def watch() -> None:
        nonlocal longest_s
        while not ended.is_set():
            asleep = time.monotonic()
            time.sleep(PERIOD_S)
            longest_s = max(longest_s, time.monotonic() - asleep - PERIOD_S)

    witness = threading.Thread(target=watch, name="witness of stalls", daemon=True)
    witness.start()
    try:
        yield lambda: longest_s
    finally:
        ended.set()
        witness.join()


@contextmanager
def witnessed() -> Iterator[Callable[[], float]]:
    """Yield what returns the seconds that were withheld from this process since the beginning.

    A thread that only sleeps is woken late by what the machine, or another thread of this process,
    takes from it. Any other process that waits meanwhile is served as late.
    """
    began, periods, ended = time.monotonic(), 0, threading.Event()

    def watch() -> None:
        nonlocal periods
        while not ended.is_set():
            time.sleep(PERIOD_S)
            periods += 1

    witness = threading.Thread(target=watch, name="witness of stalls", daemon=True)
    witness.start()
    try:
        yield lambda: max(time.monotonic() - began - periods * PERIOD_S, 0.0)
    finally:
        ended.set()
        witness.join()
