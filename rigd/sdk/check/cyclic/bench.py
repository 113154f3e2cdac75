"""Calls one fast driver, with one simulated device, as the control cycle calls it."""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, Final

from rigd.model.channels import Channel
from rigd.sdk.check.caller import OPEN_S, SENDS, Caller, CallOutcome, LinkedBench, hearing
from rigd.sdk.check.leaks import nothing_left
from rigd.sdk.check.peer import Observed, Peer
from rigd.sdk.check.rows import Matching, row_problems
from rigd.sdk.check.sequences import StepFailed, expect, surely
from rigd.sdk.check.subject import Subject, UnfitSubject
from rigd.sdk.check.watching import Watcher, until
from rigd.sdk.driver import Driver, SlowDriver
from rigd.sdk.link import Link
from rigd.sdk.plant import Plant

#: Time limit for enabling a drive, in s: it passes through states, a cycle or more each.
READY_S: Final = 10.0
#: The first row comes within this time after arm(), and 3 silent_s, in s.
ROWS_S: Final = 2.0
#: An actuator follows its setpoint within this time, in s.
FOLLOWS_S: Final = 0.3
#: What a device may take until it is safe, in s.
SAFE_S: Final = 1.0
#: Time from one cycle to the next, in s.
PERIOD_S: Final = 0.002
#: A call of a cycle that takes longer waits for something, in s, if the machine goes on meanwhile.
WAITS_S: Final = 0.015
#: What the peer has sent has arrived after this time, in s: a row is the newest that has arrived.
AGE_S: Final = 0.05
#: A row that shows what was measured so long before it is old, in s.
OLD_S: Final = 0.12
#: After each thing that is sent outside the cycle the driver is held for so long, in s: the device
#: obeys, and is looked at, before the driver can take it back.
HELD_S: Final = 0.004


class Bench(LinkedBench):
    """One driver with one simulated device, called as the cycle calls it."""

    def __init__(self, subject: Subject, peer: Peer, caller: Caller) -> None:
        super().__init__(caller)
        self._subject = subject
        self._all: list[Driver] = []  # what one of them leaves open stays to be seen
        self.peer = peer
        self.took: dict[str, list[float]] = {}  # how long each read and write took, in s
        self.waits: Counter[str] = Counter()  # how often one waited, while the machine went on
        #: When a cycle read, and the one before, on CLOCK_MONOTONIC in s.
        self._read_s = (time.monotonic(), 0.0)
        self.rows = 0  # that came since it was opened
        self._last_ns: int | None = None  # taken_ns of the last of them
        self.sent_s: list[float] = []  # when something was sent in calls that may wait
        self.replace()
        self.watcher = Watcher(peer)  # a plant is there once it has a link
        #: Compares rows with what the device has sent.
        self.readings = Matching(peer, self.driver.declaration, self.watcher.held)
        #: What the device did before it was opened.
        self.fresh = self.look()

    def replace(self) -> None:
        """Put a new driver, on a new link, in the place of the present one."""
        self.link = self.peer.link()
        self.driver: Driver = self._subject.make(self.peer, self.link)
        self._all.append(self.driver)

    def look(self) -> Observed:
        """Return what the device does now; nothing, if the peer does not show it.

        Raises:
            UnfitSubject: the peer does not show an actuator for each setpoint.

        """
        seen = self.watcher.look()
        expected = len(self.driver.declaration.setpoints)
        if self.peer.observed is not None and len(seen.driven) != expected:
            raise UnfitSubject(
                f"the peer shows {len(seen.driven)} driven values for {expected} setpoints"
            )
        return seen

    def call_slowly(self, function: Callable[[], Any]) -> CallOutcome:
        """Make a call that may wait, and look at the device after each thing that it sends."""

        def look() -> None:
            self.sent_s.append(time.monotonic())
            time.sleep(HELD_S)
            self.watcher.look()

        def watched() -> Any:
            with hearing(SENDS, look):
                return function()

        return self.call(watched if self.peer.observed is not None else function, OPEN_S)

    def run(self) -> None:
        """Open the device, arm it and drive it, as in the middle of a run.

        Raises:
            StepFailed: a call fails.
        """
        expect("open", self.open())
        expect("arm", self.call(self.driver.arm))
        self.become_ready(lambda: self.check_row(expect("a cycle", self.cycle())))
        wanted = far_setpoints(self.driver)
        until(
            lambda: bool(self.cycle(wanted).error) or self.look().driven in ((), wanted), FOLLOWS_S
        )

    def open(self) -> CallOutcome:
        """Open the link, if there is one, then the driver."""
        self.rows, self._last_ns = 0, None
        self.readings.begin()
        opened = self.open_link()
        return self.call_slowly(self.driver.open) if opened.error is None else opened

    def cycle(
        self,
        setpoints: Sequence[float] | None = None,
        pause_s: float = PERIOD_S,
        *,
        reads: bool = True,
    ) -> CallOutcome:
        """Go through one cycle and return how its read ended; the first error ends it.

        The setpoints are at rest by default; with () there is no write. The next one may follow
        after ``pause_s``. One that ``reads`` nothing gives no row.
        """
        t_ns = time.monotonic_ns()
        link, driver = self.link, self.driver
        if isinstance(link, Plant):
            link.advance(t_ns)
        if isinstance(link, Link):
            begun = self.call(lambda: link.begin(t_ns))
            if begun.error is not None:
                return begun
        row = CallOutcome()
        if reads:
            self._read_s = (time.monotonic(), self._read_s[0])
            row = self._timed("read", lambda: driver.read(t_ns))
            self.readings.mark()
        wanted = rest(driver) if setpoints is None else setpoints
        if row.error is None and wanted:
            written = self._timed("write", lambda: driver.write(wanted))
            if written.error is not None:
                return written
        if isinstance(link, Link):
            ended = self.call(lambda: link.end(t_ns))
            if ended.error is not None:
                return ended
        time.sleep(pause_s)
        return row

    def timed(self, function: Callable[[], Any]) -> CallOutcome:
        """Make one call; it took no time if this machine stalled meanwhile."""
        began_s, self.watcher.gap_s = time.monotonic(), 0.0
        outcome = self.call(function)
        stalled_s = self.watcher.gap_s
        if outcome.took_s > WAITS_S:  # to look at all threads takes a while itself
            stalled_s = max(stalled_s, self.watcher.held.since(began_s))
        return replace(outcome, took_s=0.0) if stalled_s >= outcome.took_s / 3 else outcome

    def _timed(self, name: str, function: Callable[[], Any]) -> CallOutcome:
        outcome = self.timed(function)
        self.took.setdefault(name, []).append(outcome.took_s)
        self.waits[name] += outcome.took_s > WAITS_S
        return outcome

    def unsafe(self, trips: int | None) -> str:
        """Return why the driver has not made the device safe; "" if it has, or nobody sees it.

        ``trips`` is how often its watchdog had acted before.
        """
        within_s, watchdog_s = SAFE_S, self.driver.watchdog_s
        if trips is None and watchdog_s is not None:
            within_s = watchdog_s / 2  # what its watchdog does cannot be told apart
        until(lambda: not self.look().energised, within_s)
        after = self.look()
        if after.trips != trips:
            return "only the watchdog of the device has made it safe"
        return f"the device is still driven at {after.driven}" if after.energised else ""

    def check_row(self, row: Any) -> None:
        """Check a row of a healthy device that was read just now; None is none.

        Raises:
            StepFailed: it is not as declared, not true, or no reading of the device is behind it.
        """
        if row is None:
            return
        now_s, declared = time.monotonic(), self.driver.declaration
        for problem in row_problems(declared, row):
            raise StepFailed(problem)
        self.rows += 1
        taken_ns = self.driver.taken_ns
        if taken_ns is not None:
            if taken_ns > now_s * 1e9:
                raise StepFailed("taken_ns of a row is after the cycle that read it")
            if self._last_ns is not None and taken_ns <= self._last_ns:
                raise StepFailed("taken_ns of a row is not after that of the row before")
            self._last_ns = taken_ns
        age_s = OLD_S + declared.oldest_s + self._read_s[0] - self._read_s[1]
        stamp_s = None if taken_ns is None else taken_ns * 1e-9
        for problem in self.readings.newest_first(row, age_s, stamp_s):
            raise StepFailed(problem)

    def become_ready(self, cycle: Callable[[], object], *, rows: bool = False) -> None:
        """Make cycles until the device is ready, and with ``rows`` gives rows, if it has any.

        Raises:
            StepFailed: it does not become so.
        """
        began_s, declared = time.monotonic(), self.driver.declaration
        while True:
            ready = expect("ready", self.call(self.driver.ready))
            if ready and (self.rows or not rows or not declared.channels):
                break
            took_s = time.monotonic() - began_s
            if took_s > READY_S and not ready:
                raise surely("it never becomes ready")
            if took_s > ROWS_S + 3 * declared.silent_s and ready:
                raise surely("it has channels, and read() gave no row")
            cycle()


def clipped(channels: Sequence[Channel], setpoints: Sequence[float]) -> tuple[float, ...]:
    """Return setpoints within their ranges, as the cycle limits them; of NaN what zero gives."""
    return tuple(
        min(max(0.0 if math.isnan(value) else value, channel.low), channel.high)
        for channel, value in zip(channels, setpoints, strict=True)
    )


def rest(driver: Driver | SlowDriver) -> tuple[float, ...]:
    """Return zero for every setpoint, or what is nearest to it in its range."""
    setpoints = driver.declaration.setpoints
    return clipped(setpoints, [0.0] * len(setpoints))


def is_switch(channel: Channel) -> bool:
    """Return whether a setpoint is off or on, and nothing between."""
    return channel.unit == "1" and (channel.low, channel.high) == (0.0, 1.0)


def far_setpoints(driver: Driver) -> tuple[float, ...]:
    """Return setpoints halfway from rest to the farther end of their ranges; switches at rest."""
    found = []
    for channel, at_rest in zip(driver.declaration.setpoints, rest(driver), strict=True):
        farther = max(channel.high, channel.low, key=lambda end: abs(end - at_rest))
        found.append(at_rest if is_switch(channel) else 0.5 * (at_rest + farther))
    return tuple(found)


@contextmanager
def bench(subject: Subject, fault: str = "") -> Iterator[Bench]:
    """Put a new driver before a new device, as :func:`mounted` does.

    Raises:
        StepFailed: the driver leaves something open.
    """
    with nothing_left(), mounted(subject, fault) as found:
        yield found


@contextmanager
def mounted(subject: Subject, fault: str = "") -> Iterator[Bench]:
    """Put a new driver before a new device, not opened; leave it safe and closed.

    ``fault`` is one that the device has from the beginning.
    """
    with subject.fresh_peer() as peer, Caller() as caller:
        found = Bench(subject, peer, caller)
        with found.watcher:
            try:
                if fault:
                    peer.faults[fault]()
                yield found
            finally:
                found.call(found.driver.make_safe)  # others check what they raise
                found.close()
