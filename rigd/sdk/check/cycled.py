"""Rules for fast drivers: what the cycle relies on, with a device that works and one that fails."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Final

from rigd.sdk.check.caller import Caller, Outcome
from rigd.sdk.check.rows import row_problems
from rigd.sdk.check.subject import FAILURES, Rule, Subject, Unfit, described
from rigd.sdk.driver import Driver
from rigd.sdk.link import Link
from rigd.sdk.plant import Plant

#: open() may take seconds, and wait for a device that does not answer.
OPEN_S: Final = 30.0
#: Longest call of a cycle that is put down to the machine, in s.
STALL_S: Final = 1.0
#: Half of the calls of a cycle must return within this, in s: a cycle at 100 Hz has 10 ms.
CALL_S: Final = 0.005
#: Enabling a drive passes through states, a cycle or more each, in s.
READY_S: Final = 10.0
#: Cycles of the measurements, and the time from one to the next, in s.
CYCLES: Final = 100
PERIOD_S: Final = 0.002
#: What read() may still give after the link is dead, in s: what had arrived before.
TAIL_S: Final = 0.5
#: Room that a proven watchdog is given above watchdog_s, in s: this machine may stall.
WATCHDOG_ROOM_S: Final = 0.25


class Bench:
    """One driver before one simulated device, called as the cycle calls it."""

    def __init__(self, driver: Driver, link: Any, caller: Caller) -> None:
        self.driver = driver
        self.link = link
        self._caller = caller
        self.reads: list[float] = []  # how long each took, in s
        self.writes: list[float] = []

    def call(self, function: Callable[[], Any], within_s: float = STALL_S * 2) -> Outcome:
        """Make one call; see :meth:`Caller.call`."""
        return self._caller.call(function, within_s)

    def must(self, what: str, function: Callable[[], Any], within_s: float = STALL_S * 2) -> Any:
        """Return the value of a call that a rule presupposes."""
        outcome = self.call(function, within_s)
        if outcome.error is not None:
            raise Unfit(f"{what} raises {described(outcome.error)}")
        return outcome.value

    def open(self) -> Outcome:
        """Open the link, where there is one, then the driver."""
        if isinstance(self.link, Link):
            opened = self.call(self.link.open, OPEN_S)
            if opened.error is not None:
                return opened
        return self.call(self.driver.open, OPEN_S)

    def close(self) -> Outcome:
        """Close the driver, then the link; return how the driver's ended."""
        closed = self.call(self.driver.close)
        if isinstance(self.link, Link):
            self.call(self.link.close)
        return closed

    def cycle(self, setpoints: Sequence[float] | None = None) -> Outcome:
        """Go through one cycle and return how its read ended; the first error ends it."""
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
        if row.error is None and driver.setpoints:
            wanted = rest(driver) if setpoints is None else setpoints
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

    def cycles(self, for_s: float) -> Iterator[Outcome]:
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
                raise Unfit(f"before it was ready, a cycle raises {described(outcome.error)}")
            if time.monotonic() > end:
                raise Unfit(f"it is not ready {READY_S:g} s after arm()")


def rest(driver: Driver) -> tuple[float, ...]:
    """Return zero for every setpoint, or what is nearest to it in its range."""
    return tuple(min(max(0.0, one.low), one.high) for one in driver.setpoints)


@contextmanager
def bench(subject: Subject, *, opened: bool = True, fault: str = "") -> Iterator[Bench]:
    """Put a new driver before a new device; ``fault`` is shown from before it is opened."""
    with subject.fresh_peer() as peer, Caller() as caller:
        link = peer.link()
        one = Bench(subject.make(peer, link), link, caller)
        if fault:
            peer.faults[fault]()
        if opened:
            outcome = one.open()
            if outcome.error is not None:
                raise Unfit(f"open raises {described(outcome.error)}")
        try:
            yield one
        finally:
            one.call(one.driver.make_safe)  # whatever they raise: rules of their own look at it
            one.close()


@contextmanager
def failing(subject: Subject, fault: str) -> Iterator[tuple[Bench, Callable[[], object]]]:
    """Put a driver before a device, arm it, and yield what begins the fault."""
    with subject.fresh_peer() as peer, Caller() as caller:
        link = peer.link()
        one = Bench(subject.make(peer, link), link, caller)
        outcome = one.open()
        if outcome.error is not None:
            raise Unfit(f"open raises {described(outcome.error)}")
        one.arm()
        try:
            yield one, peer.faults[fault]
        finally:
            one.call(one.driver.make_safe)
            one.close()


def _opens(subject: Subject) -> Iterator[str]:
    with bench(subject) as one:
        reasons = one.must("preflight", one.driver.preflight)
        if not all(isinstance(reason, str) for reason in reasons):
            yield f"preflight() returns {reasons!r}, expected sentences"
        elif reasons:
            yield f"preflight() finds fault with a healthy device: {'; '.join(reasons)}"
        else:
            one.arm()


def _rows(subject: Subject) -> Iterator[str]:
    with bench(subject) as one:
        one.arm()
        problems: set[str] = set()
        rows = 0
        for outcome in one.cycles(max(CYCLES * PERIOD_S, 3 * one.driver.silent_s, 2.0)):
            if outcome.error is not None:
                problems.add(f"read or write raises {described(outcome.error)}")
            elif outcome.value is not None:
                rows += 1
                problems.update(row_problems(one.driver, outcome.value))
            if problems or rows >= CYCLES:
                break
        yield from sorted(problems)
        if one.driver.channels and not rows:
            yield "it has channels, and read() gave no row"


def _bounded(subject: Subject) -> Iterator[str]:
    with bench(subject) as one:
        one.arm()
        one.reads.clear()
        one.writes.clear()
        for _ in range(CYCLES):
            one.cycle()
        for name, took in (("read", one.reads), ("write", one.writes)):
            if took and statistics.median(took) > CALL_S:
                yield f"{name} takes {statistics.median(took) * 1e3:.1f} ms, half of the time more"


def _nan(subject: Subject) -> Iterator[str]:
    with bench(subject) as one:
        if not one.driver.setpoints:
            return
        one.arm()
        nothing = (math.nan,) * len(one.driver.setpoints)
        outcome = one.call(lambda: one.driver.write(nothing))
        if outcome.error is None:
            yield "write() takes NaN as if it were a setpoint"
        elif not isinstance(outcome.error, (*FAILURES, ValueError)):
            yield f"write() of NaN raises {described(outcome.error)}"
        after = one.cycle()
        if after.error is not None:
            yield f"after a NaN was refused, a cycle raises {described(after.error)}"


def _beyond(subject: Subject) -> Iterator[str]:
    with bench(subject) as one:
        one.arm()
        for pick in ("low", "high"):
            far = tuple(10 * getattr(channel, pick) for channel in one.driver.setpoints)
            outcome = one.call(lambda far=far: one.driver.write(far))  # type: ignore[misc]
            if outcome.error is not None and not isinstance(outcome.error, (*FAILURES, ValueError)):
                yield f"write({far}) raises {described(outcome.error)}"


def _safe_twice(subject: Subject) -> Iterator[str]:
    with bench(subject) as one:
        one.arm()
        one.cycle()
        for name in ("make_safe", "make_safe again"):
            outcome = one.call(one.driver.make_safe)
            if outcome.error is not None:
                yield f"{name} raises {described(outcome.error)}"
        after = one.cycle()
        if after.error is not None:
            yield f"after make_safe, a cycle raises {described(after.error)}"
        for name in ("close", "close again"):
            outcome = one.call(one.driver.close)
            if outcome.error is not None:
                yield f"{name} raises {described(outcome.error)}"


def _opened_twice(subject: Subject) -> Iterator[str]:
    with bench(subject) as one:
        again = one.call(one.driver.open, OPEN_S)
        if again.error is not None and not isinstance(again.error, FAILURES):
            yield f"open() of an open driver raises {described(again.error)}"


def _reopens(subject: Subject) -> Iterator[str]:
    with subject.fresh_peer() as peer, Caller() as caller:
        for turn in ("first", "second"):
            link = peer.link()
            one = Bench(subject.make(peer, link), link, caller)
            outcome = one.open()
            if outcome.error is not None:
                yield f"the {turn} of two drivers, one after the other: {described(outcome.error)}"
            one.call(one.driver.make_safe)
            one.close()


def _watchdog(subject: Subject) -> Iterator[str]:
    with bench(subject) as one:
        promised = one.driver.watchdog_s
        if promised is None:
            return
        proven = one.must("prove_watchdog", one.driver.prove_watchdog, OPEN_S)
        if not 0 < proven <= promised + WATCHDOG_ROOM_S:
            yield f"prove_watchdog() returns {proven!r} s, watchdog_s is {promised:g} s"


def _rescue(subject: Subject) -> Iterator[str]:
    if not subject.driver_class.second_link:  # type: ignore[attr-defined]
        return
    with bench(subject, opened=False) as one:
        rescued = one.call(one.driver.rescue, OPEN_S)
        if rescued.error is not None:
            yield f"rescue() over a fresh link raises {described(rescued.error)}"
        elif rescued.took_s > STALL_S * 2:
            yield f"rescue() takes {rescued.took_s:.1f} s"


def _lost(fault: str) -> Callable[[Subject], Iterator[str]]:
    """Return the check of a device that falls silent: no rows, and words at the most."""

    def check(subject: Subject) -> Iterator[str]:
        with failing(subject, fault) as (one, begin):
            begin()
            began = time.monotonic()
            for outcome in one.cycles(TAIL_S + 1.0 + 2 * one.driver.silent_s):
                if outcome.error is not None and not isinstance(outcome.error, FAILURES):
                    yield f"a cycle raises {described(outcome.error)}"
                if outcome.value is not None and time.monotonic() > began + TAIL_S:
                    yield f"read() still gives rows {TAIL_S:g} s after the device is {fault}"
                    break
            for name in ("make_safe", "make_safe again", "close", "close again"):
                outcome = one.call(getattr(one.driver, name.removesuffix(" again")))
                known = FAILURES if name.startswith("make_safe") else ()
                if outcome.error is not None and not isinstance(outcome.error, known):
                    yield f"{name} raises {described(outcome.error)}"

    return check


def _bad_answers(fault: str) -> Callable[[Subject], Iterator[str]]:
    """Return the check of a device whose answers cannot be used: bounded, and words at the most."""

    def check(subject: Subject) -> Iterator[str]:
        with failing(subject, fault) as (one, begin):
            begin()
            one.reads.clear()
            one.writes.clear()
            problems: set[str] = set()
            for outcome in one.cycles(1.0 + 2 * one.driver.silent_s):
                if outcome.error is not None and not isinstance(outcome.error, FAILURES):
                    problems.add(f"a cycle raises {described(outcome.error)}")
                elif outcome.value is not None:
                    problems.update(row_problems(one.driver, outcome.value, in_range=False))
            for name, took in (("read", one.reads), ("write", one.writes)):
                if took and statistics.median(took) > CALL_S:
                    problems.add(f"{name} waits {statistics.median(took) * 1e3:.0f} ms")
            yield from sorted(problems)

    return check


def _not_there(subject: Subject) -> Iterator[str]:
    with bench(subject, opened=False, fault="dead") as one:
        outcome = one.open()
        if outcome.error is None:
            yield "open() succeeds although nothing is connected"
        elif not isinstance(outcome.error, FAILURES):
            yield f"open() raises {described(outcome.error)}"
        elif outcome.error.hint is None:
            yield f"open() says {outcome.error.message!r}, and not what to do about it"
        closed = one.close()
        if closed.error is not None:
            yield f"close() after that raises {described(closed.error)}"


#: The first decides whether there is anything to examine.
RULES: Final = (
    Rule(
        "opens and arms",
        "open() and arm() a healthy device; preflight() returns () for it, ready() becomes True",
        _opens,
        "",
    ),
    Rule(
        "rows",
        "read() returns one finite number per channel, within the channel's range, and an int "
        "last where has_status; None while there is nothing new",
        _rows,
        "",
    ),
    Rule(
        "bounded",
        "read() and write() never wait: take what has arrived, send without waiting",
        _bounded,
        "",
    ),
    Rule(
        "no NaN",
        "write() refuses NaN with a DeviceError and goes on: the setpoint before it holds",
        _nan,
        "",
    ),
    Rule(
        "setpoints beyond the range",
        "write() clips a setpoint beyond the range, or refuses it with a DeviceError",
        _beyond,
        "",
    ),
    Rule(
        "safe twice, closed twice",
        "make_safe() and close() may come twice, and read() goes on after make_safe()",
        _safe_twice,
        "",
    ),
    Rule(
        "opened twice",
        "open() of an open driver does nothing, or raises a LinkError",
        _opened_twice,
        "",
    ),
    Rule("lets go", "close() lets go of the connection: the next session opens it", _reopens, ""),
    Rule(
        "watchdog",
        "prove_watchdog() returns after how many s the device made itself safe, within watchdog_s",
        _watchdog,
        "",
    ),
    Rule(
        "rescue",
        "rescue() opens the link anew, makes the device safe and closes, in about 0.5 s",
        _rescue,
        "",
    ),
    Rule(
        "dead",
        "with the link dead read() returns None or raises a LinkError, make_safe() and close() end",
        _lost("dead"),
        "dead",
    ),
    Rule(
        "silent",
        "with the device silent read() returns None or raises a DeviceError: no row is made up",
        _lost("silent"),
        "silent",
    ),
    Rule(
        "late",
        "an answer that is late costs rows, not time: read() never waits for it",
        _bad_answers("late"),
        "late",
    ),
    Rule(
        "garbled",
        "damaged answers are thrown away or raise a ProtocolError; they never become rows",
        _bad_answers("garbled"),
        "garbled",
    ),
    Rule(
        "not there",
        "open() without a device raises a LinkError with a hint: what to check",
        _not_there,
        "dead",
    ),
)
