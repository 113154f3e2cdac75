"""Checks fast drivers against the rules on which the control cycle depends.

A fast driver is called by the cycle itself (one turn of the control loop: read, check, play, limit,
write). So it must, for example, never wait for an answer and never invent a row. ``RULES`` lists
every rule: sequences of calls with a healthy device (:mod:`rigd.sdk.check.cyclic.sequences`), and
here what shows itself with a device that has a fault.
"""

from __future__ import annotations

import random
import statistics
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Final

from rigd.sdk.check.caller import OPEN_S, RECEIVES, TAIL_S, hearing
from rigd.sdk.check.cyclic.bench import SAFE_S, Bench, bench, far_setpoints
from rigd.sdk.check.cyclic.sequences import any_order, near
from rigd.sdk.check.drawn_options import counted_s, intervals, too_often
from rigd.sdk.check.leaks import kept_for_good
from rigd.sdk.check.rows import row_problems
from rigd.sdk.check.sequences import StepFailed, expect
from rigd.sdk.check.subject import FAILURES, Rule, Subject, described
from rigd.sdk.check.watching import until

#: Half of the calls of a cycle must return within this, in s: a cycle at 100 Hz has 10 ms.
CALL_S: Final = 0.005
#: So many calls may wait for longer, as this machine may stall unseen.
WAITS: Final = 4
#: Cycles of the measurements.
CYCLES: Final = 100
#: Cycles of which memory is compared.
GROWS_CYCLES: Final = 120
#: Commands without a read, whose answers then wait, and after how long, in s; of so many frames one
#: read may take so many.
FLOOD: Final = 200
FLOOD_S: Final = 0.05
MOST_TAKEN: Final = 100
#: For so many cycles after the link is dead, as this machine may stall, and for TAIL_S, read() may
#: still return rows that arrived before.
TAIL_CYCLES: Final = 50
#: For so long, and 2 silent_s, a fault is looked at, in s.
FAULT_S: Final = 0.7
#: arm() only sends: it takes no longer, in s, if the machine goes on meanwhile.
ORDER_S: Final = 0.15
#: make_safe() and confirm_safe() end within this time, in s; the latter within 0.5 s and some more.
SAFE_ENDS_S: Final = {"make_safe": 0.58, "confirm_safe": 0.75}
#: For so long a device that does not enable its actuator is asked whether it is ready, in s.
LOCKED_S: Final = 0.5
#: So many devices refuse a setpoint.
REFUSALS: Final = 3

Check = Callable[[Subject], Iterator[str]]


def _bounded(subject: Subject) -> Iterator[str]:
    """Yield calls that wait, memory that grows, and a read() that takes too many frames."""
    with bench(subject) as found:
        found.run()
        for _ in range(CYCLES):
            found.cycle(far_setpoints(found.driver))
        yield from _waits(found)
        go_on = partial(found.cycle, far_setpoints(found.driver))
        yield from kept_for_good(found.driver, found.peer, GROWS_CYCLES, go_on)
    with bench(subject) as found:
        found.run()
        yield from _taken_at_once(found)


def _intervals(subject: Subject) -> Iterator[str]:
    """Yield that the driver asks its device more often than its options state."""
    for other, apart_s in intervals(subject):
        with bench(other) as found:
            if found.peer.readings is None:
                return
            found.run()
            before, began_s = found.readings.sent, time.monotonic()
            while time.monotonic() < began_s + counted_s(apart_s):
                found.cycle(far_setpoints(found.driver))
            sent, for_s = found.readings.sent - before, time.monotonic() - began_s
            yield from too_often(sent, for_s, apart_s)


def _waits(found: Bench) -> Iterator[str]:
    """Yield which calls since the last look waited."""
    for name, took in found.took.items():
        half_s = statistics.median(took)
        if half_s > CALL_S or found.waits[name] >= WAITS:
            yield (
                f"{name} takes {half_s * 1e3:.1f} ms, half of the time more; it waits "
                f"{found.waits[name]} times of {len(took)}, {max(took) * 1e3:.0f} ms at most"
            )


def _taken_at_once(found: Bench) -> Iterator[str]:
    """Yield that one read() takes as many frames as there are, if it does."""
    if begin := found.peer.faults.get("flooding"):
        begin()
    for _ in range(FLOOD):
        found.cycle(far_setpoints(found.driver), 0.0, reads=False)
    found.cycle(far_setpoints(found.driver))  # it asks
    time.sleep(FLOOD_S)
    taken: list[None] = []

    def read() -> object:
        with hearing(RECEIVES, partial(taken.append, None)):
            return found.driver.read(time.monotonic_ns())

    if found.call(read).error is None and len(taken) > MOST_TAKEN:
        yield f"one read() takes {len(taken)} frames: a flood stops the cycle"


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
                    found.cycle(far_setpoints(found.driver))
                trips = found.look().trips
                found.peer.faults[fault]()
                if not at_once:
                    yield from _cycled(found, fault, rows=rows)
                yield from _made_safe(found, trips, at_once=at_once)
                if fault == "silent":
                    yield from _armed_silent(found)
                for turn in ("close", "close again"):
                    outcome = found.close()
                    if outcome.error is not None:
                        yield f"{turn} raises {described(outcome.error)}"
        if fault in {"silent", "stuck"}:
            yield from _rescued(subject, fault)

    return check


def _cycled(found: Bench, fault: str, *, rows: bool) -> Iterator[str]:
    """Yield what goes wrong in cycles while the device has ``fault``; ``rows`` may still come."""
    problems: dict[str, None] = {}
    found.took.clear()
    found.waits.clear()
    began_s, number, raised = time.monotonic(), 0, False
    end = began_s + FAULT_S + 2 * found.driver.declaration.silent_s
    while time.monotonic() < end or number <= TAIL_CYCLES:
        outcome = found.cycle(far_setpoints(found.driver))
        number += 1
        raised |= outcome.error is not None
        # It takes a late answer for that to another question if a row is not of the newest.
        if fault == "late" and not found.driver.declaration.every_cycle and outcome.error is None:
            try:
                found.check_row(outcome.value)
            except StepFailed as failed:
                problems[f"an answer that is late is taken: {failed}"] = None
                break
        if outcome.error is not None and not isinstance(outcome.error, FAILURES):
            problems[f"a cycle raises {described(outcome.error)}"] = None
        elif outcome.error is None and outcome.value is not None:
            declared = found.driver.declaration
            problems |= dict.fromkeys(row_problems(declared, outcome.value, in_range=False))
            if not rows and number > TAIL_CYCLES and time.monotonic() > began_s + TAIL_S:
                problems[f"read() still gives rows {TAIL_S:g} s after the device is {fault}"] = None
    if fault == "dead" and not raised:
        problems["the link is dead, and no cycle raises a LinkError or DeviceError"] = None
    problems |= dict.fromkeys(_waits(found))
    yield from problems


def _made_safe(found: Bench, trips: int | None, *, at_once: bool) -> Iterator[str]:
    """Yield what is wrong with make_safe() and confirm_safe(): a device is safe, or they raise."""
    raised = False
    for step in (found.driver.make_safe, found.driver.confirm_safe, found.driver.make_safe):
        outcome = found.timed(step)
        if outcome.took_s > SAFE_ENDS_S[step.__name__]:
            yield f"{step.__name__}() takes {outcome.took_s:.2g} s"
        raised |= outcome.error is not None
        if outcome.error is not None and not isinstance(outcome.error, FAILURES):
            yield f"{step.__name__}() raises {described(outcome.error)}"
    if raised or not at_once or not found.driver.declaration.setpoints:
        return
    if problem := found.unsafe(trips):
        yield f"make_safe() and confirm_safe() return, and {problem}"


def _locked(subject: Subject) -> Iterator[str]:
    """Yield that a device which cannot be energised counts as ready."""
    with bench(subject) as found:
        if not found.driver.declaration.setpoints:
            return
        found.run()  # what it was told before is of no account
        expect("make_safe", found.call(found.driver.make_safe))
        found.peer.faults["locked"]()
        armed = found.call(found.driver.arm)
        end = time.monotonic() + LOCKED_S
        while armed.error is None and time.monotonic() < end:
            if expect("ready", found.call(found.driver.ready)):
                yield "ready() returns True, and the device is not energised"
                return
            outcome = found.cycle()
            if outcome.error is not None:
                return
            found.check_row(outcome.value)


def _refused(subject: Subject) -> Iterator[str]:
    """Yield that no cycle raises while the device refuses its setpoints."""
    for number in range(REFUSALS if subject.declare().setpoints else 0):
        # Of devices whose errors are others.
        with bench(replace(subject, varied=f"refusal {number}")) as found:
            declared = found.driver.declaration
            found.run()
            found.peer.faults["refusing"]()
            wanted = tuple(value / 2 for value in far_setpoints(found.driver))
            end = time.monotonic() + FAULT_S + 2 * declared.silent_s
            error = None
            while error is None and time.monotonic() < end:
                error = found.cycle(wanted).error
            if error is not None and not isinstance(error, FAILURES):
                yield f"a cycle raises {described(error)}"
            driven = found.look().driven
            if error is None and not all(map(near, declared.setpoints, driven, wanted)):
                yield f"the device refuses {wanted}, is driven at {driven}, and no cycle raises"


def _rescued(subject: Subject, fault: str) -> Iterator[str]:
    """Yield that rescue() leaves a device driven which obeys in silence, or does not obey.

    The watchdog of one that does not obey has acted before, or not.
    """
    for turn in (False, True):
        rescues = turn or fault == "stuck"
        with bench(subject) as found:
            if not found.driver.second_link or not subject.observes:
                return
            found.run()
            trips = found.look().trips
            found.peer.faults[fault]()
            if fault == "stuck" and turn and trips is not None:
                within_s = (found.driver.watchdog_s or 0.0) + SAFE_S
                until(lambda was=trips: found.look().trips != was, within_s)  # type: ignore[misc]
            if rescues:
                found.close()
                found.replace()
            error = found.call(
                found.driver.rescue if rescues else found.driver.make_safe, OPEN_S
            ).error
            if error is not None and not isinstance(error, FAILURES):
                yield f"{'rescue' if rescues else 'make_safe'}() raises {described(error)}"
            until(lambda: not found.look().energised, (found.driver.watchdog_s or SAFE_S) / 2)
            after = found.look()
            if not after.energised and after.trips == trips:
                continue
            if rescues and (fault == "silent" or error is None):
                yield f"after rescue() the device is driven at {after.driven}"
            if fault == "silent":
                return  # a device that does not obey while it is silent is not rescued either


def _armed_silent(found: Bench) -> Iterator[str]:
    """Yield that arm() takes too long, or raises a wrong error, while nothing answers."""
    armed = found.timed(found.driver.arm)
    if armed.took_s > ORDER_S:
        yield f"arm() takes {armed.took_s:.2g} s"
    if armed.error is not None and not isinstance(armed.error, FAILURES):
        yield f"arm() raises {described(armed.error)}"
    found.call(found.driver.make_safe)


def _unguarded(subject: Subject) -> Iterator[str]:
    """Yield that a watchdog which never acts counts as proven."""
    with bench(subject) as found:
        if found.open().error is not None or found.driver.watchdog_s is None:
            return
        found.peer.faults["unguarded"]()
        proven = found.call(found.driver.prove_watchdog, OPEN_S)
        if proven.error is None:
            yield f"prove_watchdog() returns {proven.value!r} s, and the watchdog never acts"
        elif not isinstance(proven.error, FAILURES):
            yield f"prove_watchdog() raises {described(proven.error)}"


#: If the first rule is broken, the others are not checked.
RULES: Final = (
    Rule(
        "any order of calls",
        "while it is armed the device is driven with the last setpoint, clipped to its range, and "
        "otherwise not at all, and without this computer at most for watchdog_s; a row is as "
        "declared and shows what the device measures, once; close() leaves nothing",
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
        "as often as asked",
        "an option `period` or `interval` is the time from one reading to the next",
        _intervals,
        "",
    ),
    *(
        Rule(fault, demand, _fault(fault, rows=fault == "late"), fault)
        for fault, demand in {
            "dead": "with the link dead read() or write() raises a LinkError or DeviceError; "
            "make_safe() or confirm_safe() raises, unless the device is safe; close() ends",
            "silent": "with the device silent read() returns None or raises a DeviceError: no row "
            "is made up; make_safe() or confirm_safe() raises, unless the device is safe; rescue() "
            "makes it safe before it asks anything: it may obey and not answer; arm() sends and "
            "returns",
            "late": "an answer that is late costs rows, not time: read() never waits for it",
            "garbled": "damaged answers are thrown away or raise a ProtocolError; they never "
            "become rows",
            "frozen": "a frame that was seen before is no new row: compare the counter that it "
            "carries",
        }.items()
    ),
    Rule(
        "safe while stuck",
        "make_safe() or confirm_safe(), and rescue(), raises a LinkError or DeviceError, unless "
        "the device is safe: wait for its answer in confirm_safe(), and check it",
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
        "refused",
        "ask the device whether it has refused a setpoint, and raise a DeviceError if it has",
        _refused,
        "refusing",
        observes=True,
    ),
    Rule(
        "watchdog that never acts",
        "prove_watchdog() asks the device whether its watchdog acted, and raises a DeviceError if "
        "it did not",
        _unguarded,
        "unguarded",
    ),
)
