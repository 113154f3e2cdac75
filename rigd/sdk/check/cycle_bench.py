"""Calls one fast driver, with one simulated device, as the control cycle calls it."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Final

from rigd.sdk.check.caller import Caller, CallOutcome
from rigd.sdk.check.peer import Observed, Peer
from rigd.sdk.check.subject import Subject, UnfitSubject, described
from rigd.sdk.driver import Driver
from rigd.sdk.link import Link
from rigd.sdk.plant import Plant

#: Time limit of open(), in s: it may wait for a device that does not answer.
OPEN_S: Final = 30.0
#: A call of a cycle that takes no longer is no error of the driver: the machine may stall, in s.
STALL_S: Final = 1.0
#: Time limit for enabling a drive, in s: it passes through states, a cycle or more each.
READY_S: Final = 10.0
#: Time from one cycle to the next, in s.
PERIOD_S: Final = 0.002


class Bench:
    """One driver with one simulated device, called as the cycle calls it."""

    def __init__(self, driver: Driver, link: Any, peer: Peer, caller: Caller) -> None:
        self.driver = driver
        self.link = link
        self.peer = peer
        self._caller = caller
        self.reads: list[float] = []  # how long each took, in s
        self.writes: list[float] = []
        #: What the device did before it was opened.
        self.fresh = self.look()

    def look(self) -> Observed:
        """Return what the device does now; nothing, if the peer does not show it.

        Raises:
            UnfitSubject: the peer does not show an actuator for each setpoint.

        """
        seen = self.peer.look()
        expected = len(self.driver.declaration.setpoints)
        if self.peer.observed is not None and len(seen.driven) != expected:
            raise UnfitSubject(
                f"the peer shows {len(seen.driven)} driven values for {expected} setpoints"
            )
        return seen

    def begin(self, fault: str) -> None:
        """Have the device show ``fault`` from now on."""
        self.peer.faults[fault]()

    def call(self, function: Callable[[], Any], within_s: float = STALL_S * 2) -> CallOutcome:
        """Make one call; see :meth:`Caller.call`."""
        return self._caller.call(function, within_s)

    def must(self, what: str, function: Callable[[], Any], within_s: float = STALL_S * 2) -> Any:
        """Return the value of a call that a rule presupposes."""
        outcome = self.call(function, within_s)
        if outcome.error is not None:
            raise UnfitSubject(f"{what} raises {described(outcome.error)}")
        return outcome.value

    def open(self) -> CallOutcome:
        """Open the link, if there is one, then the driver."""
        if isinstance(self.link, Link):
            opened = self.call(self.link.open, OPEN_S)
            if opened.error is not None:
                return opened
        return self.call(self.driver.open, OPEN_S)

    def close(self) -> CallOutcome:
        """Close the driver, then the link; return how the driver's ended."""
        closed = self.call(self.driver.close)
        if isinstance(self.link, Link):
            self.call(self.link.close)
        return closed

    def cycle(self, setpoints: Sequence[float] | None = None) -> CallOutcome:
        """Go through one cycle and return how its read ended; the first error ends it.

        The setpoints are at rest by default; with () there is no write.
        """
        t_ns = time.monotonic_ns()
        link, driver = self.link, self.driver
        if isinstance(link, Plant):
            link.advance(t_ns)
        if isinstance(link, Link):
            begun = self.call(lambda: link.begin(t_ns))
            if begun.error is not None:
                return begun
        row = self.call(lambda: driver.read(t_ns))
        self.reads.append(row.took_s)
        wanted = rest(driver) if setpoints is None else setpoints
        if row.error is None and wanted:
            written = self.call(lambda: driver.write(wanted))
            self.writes.append(written.took_s)
            if written.error is not None:
                return written
        if isinstance(link, Link):
            ended = self.call(lambda: link.end(t_ns))
            if ended.error is not None:
                return ended
        time.sleep(PERIOD_S)
        return row

    def cycles(self, for_s: float) -> Iterator[CallOutcome]:
        """Go through cycles for a while, until one fails."""
        end = time.monotonic() + for_s
        while time.monotonic() < end:
            outcome = self.cycle()
            yield outcome
            if outcome.error is not None:
                return

    def arm(self) -> None:
        """Arm the device and go through cycles until it is ready."""
        self.must("arm", self.driver.arm)
        end = time.monotonic() + READY_S
        while not self.must("ready", self.driver.ready):
            outcome = self.cycle()
            if outcome.error is not None:
                raise UnfitSubject(
                    f"before it was ready, a cycle raises {described(outcome.error)}"
                )
            if time.monotonic() > end:
                raise UnfitSubject(f"it is not ready {READY_S:g} s after arm()")


def rest(driver: Driver) -> tuple[float, ...]:
    """Return zero for every setpoint, or what is nearest to it in its range."""
    setpoints = driver.declaration.setpoints
    return tuple(min(max(0.0, setpoint.low), setpoint.high) for setpoint in setpoints)


@contextmanager
def bench(subject: Subject, *, opened: bool = True) -> Iterator[Bench]:
    """Put a new driver before a new device, open it, and leave it safe and closed."""
    with subject.fresh_peer() as peer, Caller() as caller:
        link = peer.link()
        found = Bench(subject.make(peer, link), link, peer, caller)
        try:
            if opened:
                outcome = found.open()
                if outcome.error is not None:
                    raise UnfitSubject(f"open raises {described(outcome.error)}")
            yield found
        finally:
            found.call(found.driver.make_safe)  # other rules check what they raise
            found.close()
