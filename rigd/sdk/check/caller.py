"""Calls a driver in a thread, to detect a call that does not return."""

from __future__ import annotations

import queue
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Final, Self

from rigd.sdk.link import Link

#: Functions of C by which bytes leave this computer, and by which they come.
SENDS: Final = frozenset({"send", "sendto", "sendall", "sendmsg", "write", "writev"})
RECEIVES: Final = frozenset({"recv", "recvfrom", "recvmsg", "recv_into", "recvfrom_into", "read"})
#: Time limit of open(), in s: it may wait for a device that does not answer.
OPEN_S: Final = 30.0
#: Time limit of close(), in s.
CLOSES_S: Final = 3.0
#: For so long after the device is dead rows may come that arrived before, in s.
TAIL_S: Final = 0.5
#: A call of a cycle that takes longer does not return, in s: the machine may stall.
HANGS_S: Final = 2.0


@dataclass(frozen=True)
class CallOutcome:
    """How a call ended: its value or its error, and how long it took."""

    value: Any = None
    error: BaseException | None = None
    took_s: float = 0.0


class Hung(Exception):
    """A call did not return."""


class Caller:
    """Makes all calls of one examination from one thread, as the cycle would.

    A thread whose call hangs is left behind; it is a daemon and ends with the process.
    """

    def __init__(self) -> None:
        self._calls: queue.SimpleQueue[Callable[[], Any] | None] = queue.SimpleQueue()
        self._outcomes: queue.SimpleQueue[CallOutcome] = queue.SimpleQueue()
        threading.Thread(target=self._serve, name="driver under check", daemon=True).start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._calls.put(None)

    def call(self, function: Callable[[], Any], within_s: float) -> CallOutcome:
        """Return how ``function()`` ended.

        Raises:
            Hung: it did not return within ``within_s``.

        """
        self._calls.put(function)
        try:
            return self._outcomes.get(timeout=within_s)
        except queue.Empty:
            raise Hung(f"did not return within {within_s:g} s") from None

    def _serve(self) -> None:
        while (function := self._calls.get()) is not None:
            start = time.perf_counter()
            try:
                value, failure = function(), None
            except BaseException as error:  # noqa: BLE001  # whatever a driver raises is a finding
                value, failure = None, error
            self._outcomes.put(CallOutcome(value, failure, time.perf_counter() - start))


class LinkedBench:
    """A driver with its link, both called from one thread."""

    link: Any
    driver: Any

    def __init__(self, caller: Caller) -> None:
        self._caller = caller

    def call(self, function: Callable[[], Any], within_s: float = HANGS_S) -> CallOutcome:
        """Return how a call ended; see :meth:`Caller.call`."""
        return self._caller.call(function, within_s)

    def open_link(self) -> CallOutcome:
        """Open the link, if there is one."""
        opens = self.link.open if isinstance(self.link, Link) else lambda: None
        return self.call(opens, OPEN_S)

    def close(self) -> CallOutcome:
        """Close the driver, then the link; return how the driver's ended."""
        closed = self.call(self.driver.close)
        if isinstance(self.link, Link):
            self.call(self.link.close)
        return closed


@contextmanager
def hearing(names: frozenset[str], hear: Callable[[], object]) -> Iterator[None]:
    """Call ``hear`` each time a function of C of one of ``names`` returns to this thread."""

    def profile(_: object, event: str, called: Any) -> None:
        if event == "c_return" and called.__name__ in names:
            hear()

    before = sys.getprofile()
    sys.setprofile(profile)
    try:
        yield
    finally:
        sys.setprofile(before)
