"""Checks fast drivers against the rules on which the control cycle depends.

A fast driver is called by the cycle itself (one turn of the control loop: read, check, play, limit,
write). So it must, for example, never wait for an answer and never invent a row. ``RULES`` lists
every rule: sequences of calls with a healthy device (:mod:`rigd.sdk.check.fast`), and here what
shows itself with a device that has a fault.
"""

from __future__ import annotations

import gc
import inspect
import random
import statistics
import time
import tracemalloc
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

from rigd.sdk.check.cycle_bench import OPEN_S, Bench, bench, far
from rigd.sdk.check.fast import any_order
from rigd.sdk.check.rows import row_problems
from rigd.sdk.check.subject import FAILURES, Rule, Subject, UnfitSubject, described
from rigd.sdk.check.watching import until

#: Half of the calls of a cycle must return within this, in s: a cycle at 100 Hz has 10 ms.
CALL_S: Final = 0.005
#: So many calls may wait for longer, as this machine may stall unseen.
WAITS: Final = 4
#: Cycles of the measurements.
CYCLES: Final = 100
#: Cycles of which memory is compared, and the bytes that each may keep.
GROWS_CYCLES: Final = 120
GROWS_BYTES: Final = 24
#: For so long after the link is dead, in s, and for so many cycles, as this machine may stall,
#: read() may still return rows that arrived before.
TAIL_S: Final = 0.5
TAIL_CYCLES: Final = 50
#: For so long, and 2 silent_s, a fault is looked at, in s.
FAULT_S: Final = 0.7
#: What a device may take until it is safe, in s.
SAFE_S: Final = 1.0
#: Rows of the measurement come within so many silent_s, and 2 s.
ROWS_SILENT: Final = 3
#: arm() only sends: it takes no longer, in s, if the machine goes on meanwhile.
ORDER_S: Final = 0.15
#: For so long a device that does not enable its actuator is asked whether it is ready, in s.
LOCKED_S: Final = 0.5
#: Relative room for a time that a device keeps in its own unit.
NUDGE: Final = 1e-3

Check = Callable[[Subject], Iterator[str]]


def _opens(subject: Subject) -> Iterator[str]:
    with bench(subject) as found:
        outcome = found.open()
        if outcome.error is not None:
            yield f"open raises {described(outcome.error)}"
            return
        began_s = time.monotonic()
        reasons = found.must("preflight", found.driver.preflight)
        if any(look.energised for look in found.watcher.since(began_s)):
            yield "preflight() energises the device"
        if not all(isinstance(reason, str) for reason in reasons):
            yield f"preflight() returns {reasons!r}, expected sentences"
        elif reasons:
            yield f"preflight() finds fault with a healthy device: {'; '.join(reasons)}"
        else:
            found.arm()
            end = time.monotonic() + 2.0 + ROWS_SILENT * found.driver.declaration.silent_s
            while not found.rows and found.driver.declaration.channels:
                outcome = found.cycle()
                if outcome.error is not None:
                    yield f"a cycle raises {described(outcome.error)}"
                    return
                found.check_row(outcome.value)
                if time.monotonic() > end:
                    yield "it has channels, and read() gave no row"
                    return


def _bounded(subject: Subject) -> Iterator[str]:
    with bench(subject) as found:
        found.run()
        for _ in range(CYCLES):
            found.cycle(far(found.driver))
        yield from _waits(found)
        yield from _grown(found, Path(inspect.getfile(subject.driver_class)).parent)


def _waits(found: Bench) -> Iterator[str]:
    """Yield which calls since the last look waited."""
    for name, took in found.took.items():
        half_s = statistics.median(took)
        if half_s > CALL_S or found.waits[name] >= WAITS:
            yield (
                f"{name} takes {half_s * 1e3:.1f} ms, half of the time more; it waits "
                f"{found.waits[name]} times of {len(took)}, {max(took) * 1e3:.0f} ms at most"
            )


def _grown(found: Bench, package: Path) -> Iterator[str]:
    """Yield how many bytes each cycle leaves in memory that code of the driver has allocated."""
    found.watcher.stop()  # it keeps what it sees
    files = [tracemalloc.Filter(True, f"{package}/*")]
    tracemalloc.start()
    try:
        sizes = []
        for _ in range(2):
            for _ in range(GROWS_CYCLES):
                found.cycle(far(found.driver))
            gc.collect()
            taken = tracemalloc.take_snapshot().filter_traces(files)
            sizes.append(sum(trace.size for trace in taken.traces))
    finally:
        tracemalloc.stop()
    if sizes[1] - sizes[0] > GROWS_BYTES * GROWS_CYCLES:
        yield f"each cycle keeps {(sizes[1] - sizes[0]) / GROWS_CYCLES:.0f} bytes for good"


def _watchdog_declared(subject: Subject) -> Iterator[str]:
    with bench(subject) as found:
        outcome = found.open()
        if outcome.error is not None or not found.driver.declaration.setpoints:
            return
        declared, there = found.driver.watchdog_s, found.look().watchdog_s
        if declared is None and there is not None:
            yield f"the device has a watchdog of {there:g} s, and the driver declares none"
        elif declared is not None and there is None:
            yield f"watchdog_s is {declared:g} s, and the device has no watchdog"
        elif declared is not None and there is not None and there > declared * (1 + NUDGE):
            yield f"watchdog_s is {declared:g} s, and the watchdog acts after {there:g} s"


def _fault(fault: str, *, rows: bool = False) -> Check:
    """Return the check of a fault in mid-run: bounded calls, no rows, errors in words, honesty."""

    def check(subject: Subject) -> Iterator[str]:
        if fault == "stuck" and not subject.declare().setpoints:
            return
        for at_once in (False, True):
            with bench(subject) as found:
                rng = random.Random(f"{subject.seed} {fault} {at_once}")
                found.run()
                for _ in range(rng.randrange(20)):
                    found.cycle(far(found.driver))
                trips = found.look().trips
                found.peer.faults[fault]()
                if not at_once:
                    yield from _cycled(found, fault, rows=rows)
                yield from _made_safe(found, trips, at_once=at_once)
                for turn in ("close", "close again"):
                    outcome = found.close()
                    if outcome.error is not None:
                        yield f"{turn} raises {described(outcome.error)}"
                if found.peer.mend is not None:
                    found.peer.mend()
                    yield from _works_again(found, fault)

    return check


def _cycled(found: Bench, fault: str, *, rows: bool) -> Iterator[str]:
    problems: dict[str, None] = {}
    found.took.clear()
    found.waits.clear()
    began_s, number = time.monotonic(), 0
    while time.monotonic() < began_s + FAULT_S + 2 * found.driver.declaration.silent_s:
        outcome = found.cycle(far(found.driver))
        number += 1
        if outcome.error is not None and not isinstance(outcome.error, FAILURES):
            problems[f"a cycle raises {described(outcome.error)}"] = None
        elif outcome.error is None and outcome.value is not None:
            declared = found.driver.declaration
            problems |= dict.fromkeys(row_problems(declared, outcome.value, in_range=False))
            if not rows and number > TAIL_CYCLES and time.monotonic() > began_s + TAIL_S:
                problems[f"read() still gives rows {TAIL_S:g} s after the device is {fault}"] = None
    problems |= dict.fromkeys(_waits(found))
    yield from problems


def _made_safe(found: Bench, trips: int | None, *, at_once: bool) -> Iterator[str]:
    """Yield what is wrong with make_safe() and confirm_safe(): a device is safe, or they raise."""
    raised = False
    for step in (found.driver.make_safe, found.driver.confirm_safe, found.driver.make_safe):
        outcome = found.call(step)
        raised |= outcome.error is not None
        if outcome.error is not None and not isinstance(outcome.error, FAILURES):
            yield f"{step.__name__}() raises {described(outcome.error)}"
    if raised or not at_once or not found.driver.declaration.setpoints:
        return
    if found.look().trips is not None or found.driver.watchdog_s is None:
        until(lambda: not found.look().energised, SAFE_S)
    else:
        until(lambda: not found.look().energised, found.driver.watchdog_s / 2)
    after = found.look()
    if after.trips != trips:
        yield (
            "make_safe() and confirm_safe() return, and only the watchdog of the device has made "
            "it safe"
        )
    elif after.energised:
        yield f"make_safe() and confirm_safe() return, and the device drives {after.driven}"


def _works_again(found: Bench, fault: str) -> Iterator[str]:
    """Yield what does not work once the device has no fault any more, with the same driver."""
    try:
        found.run()
    except UnfitSubject as unfit:
        yield f"once the device is no longer {fault}, {unfit}"


def _locked(subject: Subject) -> Iterator[str]:
    with bench(subject) as found:
        if not found.driver.declaration.setpoints:
            return
        found.run()  # what it was told before is of no account
        found.must("make_safe", found.driver.make_safe)
        found.peer.faults["locked"]()
        armed = found.call(found.driver.arm)
        end = time.monotonic() + LOCKED_S
        while armed.error is None and time.monotonic() < end:
            if found.must("ready", found.driver.ready):
                yield "ready() returns True, and the device is not energised"
                return
            if found.cycle().error is not None:
                return


def _armed_silent(subject: Subject) -> Iterator[str]:
    with bench(subject) as found:
        found.run()
        found.must("make_safe", found.driver.make_safe)
        found.peer.faults["silent"]()
        found.watcher.gap_s = 0.0
        armed = found.call(found.driver.arm)
        if armed.took_s > ORDER_S and found.watcher.gap_s < armed.took_s / 3:
            yield f"arm() takes {armed.took_s:.2g} s"
        if armed.error is not None and not isinstance(armed.error, FAILURES):
            yield f"arm() raises {described(armed.error)}"


def _unguarded(subject: Subject) -> Iterator[str]:
    with bench(subject) as found:
        if found.open().error is not None or found.driver.watchdog_s is None:
            return
        found.peer.faults["unguarded"]()
        proven = found.call(found.driver.prove_watchdog, OPEN_S)
        if proven.error is None:
            yield f"prove_watchdog() returns {proven.value!r} s, and the watchdog never acts"
        elif not isinstance(proven.error, FAILURES):
            yield f"prove_watchdog() raises {described(proven.error)}"


def _at_open(fault: str) -> Check:
    """Return the check of opening a device with a fault: it ends, perhaps with an error."""

    def check(subject: Subject) -> Iterator[str]:
        with bench(subject, fault) as found:
            error = found.open().error
            if error is None:
                if fault == "dead":
                    yield "open() succeeds although nothing is connected"
            elif not isinstance(error, FAILURES):
                yield f"open() raises {described(error)}"
            elif fault == "dead" and error.hint is None:
                yield f"open() raises {error.message!r} without a hint"
            closed = found.close()
            if closed.error is not None:
                yield f"close() after that raises {described(closed.error)}"

    return check


#: If the first rule is broken, the others are not checked.
RULES: Final = (
    Rule(
        "opens and arms",
        "open() and arm() a healthy device; preflight() returns () for it, ready() becomes True, "
        "and read() gives rows as declared",
        _opens,
        "",
    ),
    Rule(
        "any order of calls",
        "while it is armed the device is driven with the last setpoint, clipped to its range, and "
        "otherwise not at all; a row is as declared and shows what the device measures, once; "
        "close() leaves nothing",
        any_order,
        "",
    ),
    Rule(
        "bounded",
        "read() and write() never wait: take what has arrived, send without waiting",
        _bounded,
        "",
    ),
    Rule(
        "watchdog declared",
        "watchdog_s is the time after which the device is safe without this computer, at most; a "
        "device with a watchdog has one",
        _watchdog_declared,
        "",
        observes=True,
    ),
    Rule(
        "dead",
        "with the link dead read() returns None or raises a LinkError; make_safe() or "
        "confirm_safe() raises, unless the device is safe; close() ends",
        _fault("dead"),
        "dead",
    ),
    Rule(
        "silent",
        "with the device silent read() returns None or raises a DeviceError: no row is made up; "
        "make_safe() or confirm_safe() raises, unless the device is safe",
        _fault("silent"),
        "silent",
    ),
    Rule(
        "late",
        "an answer that is late costs rows, not time: read() never waits for it",
        _fault("late", rows=True),
        "late",
    ),
    Rule(
        "garbled",
        "damaged answers are thrown away or raise a ProtocolError; they never become rows",
        _fault("garbled"),
        "garbled",
    ),
    Rule(
        "frozen",
        "a frame that was seen before is no new row: compare the counter that it carries",
        _fault("frozen"),
        "frozen",
    ),
    Rule(
        "safe while stuck",
        "make_safe() or confirm_safe() raises a LinkError or DeviceError, unless the device is "
        "safe: wait for its answer in confirm_safe(), and check it",
        _fault("stuck", rows=True),
        "stuck",
        observes=True,
    ),
    Rule(
        "ready is true",
        "ready() returns what the device reports of its actuator, not what it was ordered to do",
        _locked,
        "locked",
    ),
    Rule(
        "arm never waits",
        "arm() sends and returns; what takes longer goes on in read() and write(), until ready()",
        _armed_silent,
        "silent",
    ),
    Rule(
        "watchdog that never acts",
        "prove_watchdog() asks the device whether its watchdog acted, and raises a DeviceError if "
        "it did not",
        _unguarded,
        "unguarded",
    ),
    Rule(
        "not there",
        "open() without a device raises a LinkError with a hint: what to check",
        _at_open("dead"),
        "dead",
    ),
    Rule(
        "silent at open",
        "open() of a device that sends nothing ends within 30 s, and raises at most a LinkError",
        _at_open("silent"),
        "silent",
    ),
    Rule(
        "garbled at open",
        "open() of a device that sends damaged answers raises at most a ProtocolError or LinkError",
        _at_open("garbled"),
        "garbled",
    ),
)
