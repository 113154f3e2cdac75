"""Checks fast drivers against the rules on which the control cycle depends.

A fast driver is a driver that the cycle (one turn of the control loop: read, check, play, limit,
write) calls itself. So such a driver must, for example, never wait for an answer and never invent a
row (a sample). ``RULES`` lists every rule with its check. A check calls the driver of a device that
is healthy or has one fault (dead, silent, late, garbled), and yields a sentence for each problem.
"""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Final

from rigd.sdk.check.caller import Caller
from rigd.sdk.check.cycle_bench import OPEN_S, PERIOD_S, STALL_S, Bench, bench
from rigd.sdk.check.rows import row_problems
from rigd.sdk.check.subject import FAILURES, Rule, Subject, described

#: Half of the calls of a cycle must return within this, in s: a cycle at 100 Hz has 10 ms.
CALL_S: Final = 0.005
#: Cycles of the measurements.
CYCLES: Final = 100
#: For so long after the link is dead, in s, and for so many cycles, as this machine may stall,
#: read() may still return rows that arrived before.
TAIL_S: Final = 0.5
TAIL_CYCLES: Final = 50
#: How much longer than watchdog_s a proven watchdog may take, in s: this machine may stall.
WATCHDOG_ROOM_S: Final = 0.25


def _opens(subject: Subject) -> Iterator[str]:
    with bench(subject) as found:
        reasons = found.must("preflight", found.driver.preflight)
        if not all(isinstance(reason, str) for reason in reasons):
            yield f"preflight() returns {reasons!r}, expected sentences"
        elif reasons:
            yield f"preflight() finds fault with a healthy device: {'; '.join(reasons)}"
        else:
            found.arm()


def _rows(subject: Subject) -> Iterator[str]:
    with bench(subject) as found:
        found.arm()
        problems: set[str] = set()
        rows, last_ns = 0, None
        for outcome in found.cycles(
            max(CYCLES * PERIOD_S, 3 * found.driver.declaration.silent_s, 2.0)
        ):
            if outcome.error is not None:
                problems.add(f"read or write raises {described(outcome.error)}")
            elif outcome.value is not None:
                rows += 1
                problems.update(row_problems(found.driver.declaration, outcome.value))
                taken_ns = found.driver.taken_ns
                if taken_ns is not None and taken_ns > time.monotonic_ns():
                    problems.add("taken_ns of a row is after the cycle that read it")
                if taken_ns is not None and last_ns is not None and taken_ns <= last_ns:
                    problems.add("taken_ns of a row is not after that of the row before")
                last_ns = taken_ns
            if problems or rows >= CYCLES:
                break
        yield from sorted(problems)
        if found.driver.declaration.channels and not rows:
            yield "it has channels, and read() gave no row"


def _bounded(subject: Subject) -> Iterator[str]:
    with bench(subject) as found:
        found.arm()
        found.reads.clear()
        found.writes.clear()
        for _ in range(CYCLES):
            found.cycle()
        for name, took in (("read", found.reads), ("write", found.writes)):
            if took and statistics.median(took) > CALL_S:
                yield f"{name} takes {statistics.median(took) * 1e3:.1f} ms, half of the time more"


def _nan(subject: Subject) -> Iterator[str]:
    with bench(subject) as found:
        if not found.driver.declaration.setpoints:
            return
        found.arm()
        nothing = (math.nan,) * len(found.driver.declaration.setpoints)
        outcome = found.call(lambda: found.driver.write(nothing))
        if outcome.error is None:
            yield "write() takes NaN as if it were a setpoint"
        elif not isinstance(outcome.error, (*FAILURES, ValueError)):
            yield f"write() of NaN raises {described(outcome.error)}"
        after = found.cycle()
        if after.error is not None:
            yield f"after a NaN was refused, a cycle raises {described(after.error)}"


def _beyond(subject: Subject) -> Iterator[str]:
    with bench(subject) as found:
        found.arm()
        for pick in ("low", "high"):
            far = tuple(
                10 * getattr(channel, pick) for channel in found.driver.declaration.setpoints
            )
            outcome = found.call(partial(found.driver.write, far))
            if outcome.error is not None and not isinstance(outcome.error, (*FAILURES, ValueError)):
                yield f"write({far}) raises {described(outcome.error)}"


def _safe_twice(subject: Subject) -> Iterator[str]:
    with bench(subject) as found:
        found.arm()
        found.cycle()
        for name in ("make_safe", "make_safe again"):
            outcome = found.call(found.driver.make_safe)
            if outcome.error is not None:
                yield f"{name} raises {described(outcome.error)}"
        after = found.cycle()
        if after.error is not None:
            yield f"after make_safe, a cycle raises {described(after.error)}"
        for name in ("close", "close again"):
            outcome = found.call(found.driver.close)
            if outcome.error is not None:
                yield f"{name} raises {described(outcome.error)}"


def _opened_twice(subject: Subject) -> Iterator[str]:
    with bench(subject) as found:
        again = found.call(found.driver.open, OPEN_S)
        if again.error is not None and not isinstance(again.error, FAILURES):
            yield f"open() of an open driver raises {described(again.error)}"


def _reopens(subject: Subject) -> Iterator[str]:
    with subject.fresh_peer() as peer, Caller() as caller:
        for turn in ("first", "second"):
            link = peer.link()
            found = Bench(subject.make(peer, link), link, peer, caller)
            outcome = found.open()
            if outcome.error is not None:
                yield f"the {turn} of two drivers, one after the other: {described(outcome.error)}"
            found.call(found.driver.make_safe)
            found.close()


def _watchdog(subject: Subject) -> Iterator[str]:
    with bench(subject) as found:
        promised = found.driver.watchdog_s
        if promised is None:
            return
        proven = found.must("prove_watchdog", found.driver.prove_watchdog, OPEN_S)
        if not 0 < proven <= promised + WATCHDOG_ROOM_S:
            yield f"prove_watchdog() returns {proven!r} s, watchdog_s is {promised:g} s"


def _rescue(subject: Subject) -> Iterator[str]:
    with bench(subject, opened=False) as found:
        if not found.driver.second_link:
            return
        rescued = found.call(found.driver.rescue, OPEN_S)
        if rescued.error is not None:
            yield f"rescue() over a fresh link raises {described(rescued.error)}"
        elif rescued.took_s > STALL_S * 2:
            yield f"rescue() takes {rescued.took_s:.1f} s"


def _lost(fault: str) -> Callable[[Subject], Iterator[str]]:
    """Return the check of a device that falls silent: no rows, at most an error with a message."""

    def check(subject: Subject) -> Iterator[str]:
        with bench(subject) as found:
            found.arm()
            found.begin(fault)
            began = time.monotonic()
            for number, outcome in enumerate(
                found.cycles(TAIL_S + 1.0 + 2 * found.driver.declaration.silent_s)
            ):
                if outcome.error is not None and not isinstance(outcome.error, FAILURES):
                    yield f"a cycle raises {described(outcome.error)}"
                if outcome.value is not None and _is_past(began, number):
                    yield f"read() still gives rows {TAIL_S:g} s after the device is {fault}"
                    break
            for name in ("make_safe", "make_safe again", "close", "close again"):
                outcome = found.call(getattr(found.driver, name.removesuffix(" again")))
                known = FAILURES if name.startswith("make_safe") else ()
                if outcome.error is not None and not isinstance(outcome.error, known):
                    yield f"{name} raises {described(outcome.error)}"

    return check


def _bad_answers(fault: str, *, rows: bool) -> Callable[[Subject], Iterator[str]]:
    """Return the check of a device with bad answers: bounded time, a plain error, maybe no rows."""

    def check(subject: Subject) -> Iterator[str]:
        with bench(subject) as found:
            found.arm()
            found.begin(fault)
            began = time.monotonic()
            found.reads.clear()
            found.writes.clear()
            problems: set[str] = set()
            for number, outcome in enumerate(
                found.cycles(1.0 + 2 * found.driver.declaration.silent_s)
            ):
                if outcome.error is not None and not isinstance(outcome.error, FAILURES):
                    problems.add(f"a cycle raises {described(outcome.error)}")
                elif outcome.value is not None:
                    problems.update(
                        row_problems(found.driver.declaration, outcome.value, in_range=False)
                    )
                    if not rows and _is_past(began, number):
                        problems.add(f"read() gives rows though what the device sends is {fault}")
            for name, took in (("read", found.reads), ("write", found.writes)):
                if took and statistics.median(took) > CALL_S:
                    problems.add(f"{name} waits {statistics.median(took) * 1e3:.0f} ms")
            yield from sorted(problems)

    return check


def _is_past(began_s: float, cycles: int) -> bool:
    """Return whether rows that arrived before ``began_s`` have all been read since."""
    return cycles >= TAIL_CYCLES and time.monotonic() > began_s + TAIL_S


def _not_there(subject: Subject) -> Iterator[str]:
    with bench(subject, opened=False) as found:
        found.begin("dead")
        outcome = found.open()
        if outcome.error is None:
            yield "open() succeeds although nothing is connected"
        elif not isinstance(outcome.error, FAILURES):
            yield f"open() raises {described(outcome.error)}"
        elif outcome.error.hint is None:
            yield f"open() raises {outcome.error.message!r} without a hint"
        closed = found.close()
        if closed.error is not None:
            yield f"close() after that raises {described(closed.error)}"


def _opens_in_words(fault: str) -> Callable[[Subject], Iterator[str]]:
    """Return the check of opening a device with damaged answers: it ends, perhaps with an error."""

    def check(subject: Subject) -> Iterator[str]:
        with bench(subject, opened=False) as found:
            found.begin(fault)
            for name, step in (("open", found.open), ("close", found.close)):
                outcome = step()
                known = FAILURES if name == "open" else ()
                if outcome.error is not None and not isinstance(outcome.error, known):
                    yield f"{name}() raises {described(outcome.error)}"

    return check


#: If the first rule is broken, the others are not checked.
RULES: Final = (
    Rule(
        "opens and arms",
        "open() and arm() a healthy device; preflight() returns () for it, ready() becomes True",
        _opens,
        "",
    ),
    Rule(
        "rows",
        "read() returns a row as declared: a finite number per channel, within the channel's "
        "range, and an int last if it has a status; None while there is nothing new; taken_ns, if "
        "it is set, rises with each row and is not after the cycle",
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
        _bad_answers("late", rows=True),
        "late",
    ),
    Rule(
        "garbled",
        "damaged answers are thrown away or raise a ProtocolError; they never become rows",
        _bad_answers("garbled", rows=False),
        "garbled",
    ),
    Rule(
        "frozen",
        "a frame that was seen before is no new row: compare the counter that it carries",
        _lost("frozen"),
        "frozen",
    ),
    Rule(
        "not there",
        "open() without a device raises a LinkError with a hint: what to check",
        _not_there,
        "dead",
    ),
    Rule(
        "silent at open",
        "open() of a device that sends nothing ends within 30 s, and raises at most a LinkError",
        _opens_in_words("silent"),
        "silent",
    ),
    Rule(
        "garbled at open",
        "open() of a device that sends damaged answers raises at most a ProtocolError or LinkError",
        _opens_in_words("garbled"),
        "garbled",
    ),
)
