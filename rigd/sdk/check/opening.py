"""Checks how drivers of any kind open a device that has a fault, and again once it has none."""

from __future__ import annotations

import asyncio
import inspect
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from typing import Any, Final

from rigd.sdk.check.caller import OPEN_S, Caller, CallOutcome, LinkedBench
from rigd.sdk.check.leaks import nothing_left, opens
from rigd.sdk.check.peer import Peer
from rigd.sdk.check.sequences import check_identity
from rigd.sdk.check.subject import FAILURES, Rule, Subject, described
from rigd.sdk.driver import DriverConfig
from rigd.sdk.link import Link

#: What opens successfully although it should not, for each fault with which that is a mistake.
SUCCEEDS: Final = {
    "dead": "open() succeeds although nothing is connected",
    "another": "open() succeeds although another device answers",
}


class AnyBench(LinkedBench):
    """One driver of any kind, with its link; coroutines run on a loop of its own."""

    def __init__(
        self, subject: Subject, peer: Peer, caller: Caller, config: DriverConfig | None = None
    ) -> None:
        super().__init__(caller)
        self.link = peer.link()
        self.driver = subject.driver_class(config or subject.config(peer.options), self.link)
        self._runner = asyncio.Runner()

    def call(self, function: Callable[[], Any], within_s: float = OPEN_S) -> CallOutcome:
        """Return how a call ended; see :meth:`Caller.call`."""

        def whole() -> Any:
            result = function()
            return self._runner.run(result) if inspect.iscoroutine(result) else result

        return self._caller.call(whole, within_s)

    def open(self) -> CallOutcome:
        """Open the link, if there is one, then the driver."""
        opened = self.open_link()
        if opened.error is not None:
            return opened
        opened = self.call(self.driver.open)
        if opened.error is not None and isinstance(self.link, Link):
            self.call(self.link.close)
        return opened

    def opened(self) -> list[str]:
        """Return what open() opens, whether it succeeds or not."""

        def listened() -> list[str]:
            with opens() as found, suppress(Exception):
                result = self.driver.open()
                if inspect.iscoroutine(result):
                    self._runner.run(result)
            return [each.words for each in found]

        return list(self._caller.call(listened, OPEN_S).value)

    def tasks(self) -> list[str]:
        """Return the names of the tasks that go on in the loop."""

        async def others() -> list[str]:
            left = asyncio.all_tasks() - {asyncio.current_task()}
            return sorted(task.get_name() for task in left)

        return list(self.call(others).value)

    def end(self) -> None:
        """Close everything."""
        self.close()
        self.call(self._runner.close)


@contextmanager
def any_bench(subject: Subject) -> Iterator[tuple[AnyBench, Peer, Caller]]:
    """Put a new driver before a new device, not opened; close it after.

    Raises:
        StepFailed: the driver leaves something open.
    """
    with nothing_left(), subject.fresh_peer() as peer, Caller() as caller:
        found = AnyBench(subject, peer, caller)
        try:
            yield found, peer, caller
        finally:
            found.end()


def _at_open(fault: str, subject: Subject) -> Iterator[str]:
    with any_bench(subject) as (found, peer, caller):
        peer.faults[fault]()
        error: BaseException | None = None
        for turn in ("open()", "open() again"):
            error = found.open().error
            if error is None and fault in SUCCEEDS:
                yield SUCCEEDS[fault]
            elif error is not None and not isinstance(error, FAILURES):
                yield f"{turn} raises {described(error)}"
            elif fault == "dead" and error is not None and error.hint is None:
                yield f"{turn} raises {error.message!r} without a hint"
            if error is None:
                check_identity(found.driver, peer.look())
                break
        if getattr(found.driver, "second_link", False) and fault in {"dead", "silent"}:
            yield from _rescues(AnyBench(subject, peer, caller), peer, fault)
        if error is not None and peer.mended(fault) and (error := found.open().error) is not None:
            yield f"once the device is no longer {fault} open() raises {described(error)}"
        for turn in ("close()", "close() again"):
            if (failed := found.close().error) is not None:
                yield f"{turn} after that raises {described(failed)}"
        if left := found.tasks():
            yield f"tasks go on after close(): {', '.join(left)}"


def _rescues(other: AnyBench, peer: Peer, fault: str) -> Iterator[str]:
    """Rescue a device that does not answer, and with the same driver once it does."""
    rescued = other.call(other.driver.rescue).error
    if rescued is None:
        yield f"rescue() returns, and nothing has answered: the device is {fault}"
    elif not isinstance(rescued, FAILURES):
        yield f"rescue() raises {described(rescued)}"
    if peer.mended(fault):
        again = other.call(other.driver.rescue).error
        if rescued is not None and again is not None:
            yield f"once the device is no longer {fault} rescue() raises {described(again)}"
    other.end()


#: For drivers of any kind.
RULES: Final = tuple(
    Rule(name, demand, partial(_at_open, fault), fault)
    for name, fault, demand in (
        (
            "not there", "dead",
            "open() without a device raises a LinkError with a hint: what to check; each time, "
            "until there is one; rescue() raises as well",
        ),
        (
            "silent at open", "silent",
            "open() of a device that sends nothing ends within 30 s, and raises at most a "
            "LinkError; rescue() raises: nobody knows that it has made the device safe",
        ),
        (
            "garbled at open", "garbled",
            "open() of a device that sends damaged answers raises at most a ProtocolError or "
            "LinkError",
        ),
        (
            "another at open", "another",
            "open() asks the device what it is, and raises a ProtocolError if it is another",
        ),
    )
)  # fmt: skip
