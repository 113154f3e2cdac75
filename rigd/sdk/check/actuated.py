"""Checks what fast drivers make their device do; the peer shows it (:class:`Observed`).

A driver may keep every promise of its calls and still move something when it is opened, or leave a
drive enabled when it is made safe. These rules look at the actuator itself.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from typing import Final

from rigd.sdk.check.cycle_bench import OPEN_S, STALL_S, Bench, bench, rest
from rigd.sdk.check.peer import Observed
from rigd.sdk.check.rows import untrue
from rigd.sdk.check.subject import FAILURES, Rule, Subject, UnfitSubject, described
from rigd.sdk.check.watching import (
    ARRIVES_S,
    far,
    follow,
    listen,
    moved,
    near,
    run,
    setpoints_of,
    shown,
    until,
    watched,
)

#: Cycles with setpoints that must have no effect.
CYCLES: Final = 20
#: What a device may take until it is safe, in s: some look at their commands every 20 ms.
SAFE_S: Final = 1.0
#: How much longer than watchdog_s a device may drive after the last call, in s: machines stall.
ROOM_S: Final = 1.0
#: For so long a device that does not enable its actuator is asked whether it is ready, in s.
LOCKED_S: Final = 0.5
#: A fault of the device in mid-run is reported within this time, in s.
REPORTED_S: Final = 1.5
#: A stalled machine lets the watchdog act before the driver can: so often is it tried again.
TRIES: Final = 3
#: Relative room for a time that a device keeps in its own unit.
NUDGE: Final = 1e-3
#: The last of so many rows is compared with the device: the first may be from before.
TRUE_ROWS: Final = 8


Check = Callable[[Subject], Iterator[str]]


def _of_actuators(check: Check) -> Check:
    """Return a check that finds nothing in a driver without setpoints, and opens nothing for it."""

    def checked(subject: Subject) -> Iterator[str]:
        if subject.declare().setpoints:
            yield from check(subject)

    return checked


@_of_actuators
def _open_moves_nothing(subject: Subject) -> Iterator[str]:
    with bench(subject, opened=False) as found:
        with watched(found) as seen:
            outcome = found.open()
            if outcome.error is not None:
                raise UnfitSubject(f"open raises {described(outcome.error)}")
            time.sleep(ARRIVES_S)
        if found.look().energised and not found.fresh.energised:
            yield "after open() the device is energised"
        if found_moved := moved(found, seen):
            yield f"open() drives {found_moved[0]} with {found_moved[1]:g}"
            return
        with watched(found) as seen:
            for _ in range(CYCLES):
                found.cycle(far(found))
            time.sleep(ARRIVES_S)
        if found_moved := moved(found, seen):
            yield f"a setpoint before arm() drives {found_moved[0]} with {found_moved[1]:g}"


@_of_actuators
def _arm_moves_nothing(subject: Subject) -> Iterator[str]:
    with bench(subject) as found:
        with watched(found) as seen:
            found.must("arm", found.driver.arm)
            listen(found, ARRIVES_S)  # nothing that write() sends hides what arm() sent
            found.arm()
        if found_moved := moved(found, seen, rested=True):
            yield f"arm() drives {found_moved[0]} with {found_moved[1]:g}"


@_of_actuators
def _locked(subject: Subject) -> Iterator[str]:
    with bench(subject) as found:
        found.begin("locked")
        armed = found.call(found.driver.arm)
        end = time.monotonic() + LOCKED_S
        while armed.error is None and time.monotonic() < end:
            if found.must("ready", found.driver.ready):
                yield "ready() returns True, and the device is not energised"
                return
            if found.cycle().error is not None:
                return


@_of_actuators
def _follows(subject: Subject) -> Iterator[str]:
    with bench(subject) as found:
        found.arm()
        lows = tuple(channel.low for channel in setpoints_of(found))
        highs = tuple(channel.high for channel in setpoints_of(found))
        for wanted in (highs, lows):
            if not follow(found, wanted):
                driven = shown(found, found.look().driven)
                yield f"write({wanted}) makes the device drive {driven}"


@_of_actuators
def _limits(subject: Subject) -> Iterator[str]:
    with bench(subject) as found:
        found.arm()
        setpoints = setpoints_of(found)
        for pick in ("low", "high"):
            beyond = tuple(10 * getattr(channel, pick) for channel in setpoints)
            with watched(found) as seen:
                for _ in range(CYCLES):
                    found.cycle(beyond)
                time.sleep(ARRIVES_S)
            for look in seen:
                clipped = [
                    min(max(value, channel.low), channel.high)
                    for channel, value in zip(setpoints, look.driven, strict=True)
                ]
                if not near(found, look.driven, clipped):
                    yield f"write({beyond}) makes the device drive {shown(found, look.driven)}"
                    break


@_of_actuators
def _nan_moves_nothing(subject: Subject) -> Iterator[str]:
    with bench(subject) as found:
        run(found)
        with watched(found) as seen:
            found.call(lambda: found.driver.write((float("nan"),) * len(setpoints_of(found))))
            listen(found, ARRIVES_S)
        for look in seen:
            if look.energised and not near(found, look.driven, far(found)):
                yield f"write() of NaN makes the device drive {shown(found, look.driven)}"
                return


@_of_actuators
def _made_safe(subject: Subject) -> Iterator[str]:
    with bench(subject) as found:
        problem = ""
        for _ in range(TRIES):
            run(found)
            trips = found.look().trips
            ordered = found.call(found.driver.make_safe)
            _await_safe(found)
            problem = _unsafe(found, found.look(), trips)
            confirmed = found.call(found.driver.confirm_safe)
            if not problem:
                break
        if problem:
            yield f"after make_safe() {problem}"
            return
        for name, outcome in (("make_safe", ordered), ("confirm_safe", confirmed)):
            if outcome.error is not None:
                yield f"{name}() of a healthy device raises {described(outcome.error)}"
        with watched(found) as seen:
            for _ in range(CYCLES):
                found.cycle(far(found))
            time.sleep(ARRIVES_S)
        if any(look.energised for look in seen) or moved(found, seen):
            yield "a setpoint after make_safe() moves the device again"
        with watched(found) as seen:
            found.close()
            time.sleep(ARRIVES_S)
        if any(look.energised for look in seen):
            yield "close() after make_safe() moves the device again"


def _await_safe(found: Bench) -> None:
    """Wait until the device is safe; not until its watchdog acts, if that cannot be told apart."""
    within_s = SAFE_S
    if found.look().trips is None and found.driver.watchdog_s is not None:
        within_s = found.driver.watchdog_s / 2
    until(lambda: not found.look().energised, within_s)


def _unsafe(found: Bench, after: Observed, trips: int | None) -> str:
    """Return why the device is not safe, or is not by what the driver did; "" if it is."""
    if after.trips != trips:
        return "only the watchdog of the device has made it safe"
    if after.energised:
        return f"the device still drives {shown(found, after.driven)}"
    return ""


def _safe_is_honest(fault: str) -> Check:
    """Return the check of make_safe() with a fault: safe, or an error that reports it is not."""

    @_of_actuators
    def check(subject: Subject) -> Iterator[str]:
        with bench(subject) as found:
            run(found)
            trips = found.look().trips
            found.begin(fault)
            for step in (found.driver.make_safe, found.driver.confirm_safe):
                outcome = found.call(step)
                if isinstance(outcome.error, FAILURES):
                    return
                if outcome.error is not None:
                    yield f"{step.__name__}() raises {described(outcome.error)}"
                    return
            _await_safe(found)
            if problem := _unsafe(found, found.look(), trips):
                yield f"make_safe() and confirm_safe() return, and {problem}"

    return check


@_of_actuators
def _watchdog_declared(subject: Subject) -> Iterator[str]:
    with bench(subject) as found:
        declared, there = found.driver.watchdog_s, found.look().watchdog_s
        if declared is None and there is not None:
            yield f"the device has a watchdog of {there:g} s, and the driver declares none"
        elif declared is not None and there is None:
            yield f"watchdog_s is {declared:g} s, and the device has no watchdog"
        elif declared is not None and there is not None and there > declared * (1 + NUDGE):
            yield f"watchdog_s is {declared:g} s, and the watchdog acts after {there:g} s"


@_of_actuators
def _watchdog_acts(subject: Subject) -> Iterator[str]:
    with bench(subject) as found:
        promised = found.driver.watchdog_s
        if promised is None:
            return
        run(found)
        if not until(lambda: not found.look().energised, promised + ROOM_S):
            yield (
                f"{promised + ROOM_S:g} s after the last call of the driver the device still "
                f"drives {shown(found, found.look().driven)}"
            )
            return
        if not found.look().trips:
            return  # it does not count them
        end = time.monotonic() + REPORTED_S + found.driver.declaration.silent_s
        while time.monotonic() < end:
            outcome = found.cycle(far(found))
            if outcome.error is not None:
                return
            if found.look().energised:
                yield "the watchdog switched the device off, and the next setpoint drives it again"
                return
        yield "the watchdog switched the device off in mid-run, and read() does not report it"


@_of_actuators
def _proof(subject: Subject) -> Iterator[str]:
    with bench(subject) as found:
        if found.driver.watchdog_s is None:
            return
        before = found.look().trips
        with watched(found) as seen:
            proven = found.must("prove_watchdog", found.driver.prove_watchdog, OPEN_S)
        if before is not None and found.look().trips == before:
            yield f"prove_watchdog() returns {proven:g} s, and the watchdog did not act"
        if found_moved := moved(found, seen):
            yield f"prove_watchdog() drives {found_moved[0]} with {found_moved[1]:g}"


@_of_actuators
def _unguarded(subject: Subject) -> Iterator[str]:
    with bench(subject) as found:
        if found.driver.watchdog_s is None:
            return
        found.begin("unguarded")
        proven = found.call(found.driver.prove_watchdog, OPEN_S)
        if proven.error is None:
            yield f"prove_watchdog() returns {proven.value!r} s, and the watchdog never acts"


@_of_actuators
def _rescued(subject: Subject) -> Iterator[str]:
    if not getattr(subject.driver_class, "second_link", False):
        return
    problem = ""
    for _ in range(TRIES):
        with bench(subject) as found:
            run(found)
            trips = found.look().trips
            found.close()  # as when its process is killed: nothing made it safe
            link = found.peer.link()
            other = subject.make(found.peer, link)
            outcome = found.call(other.rescue, OPEN_S)
            if outcome.error is not None:
                yield f"rescue() of a device that drives raises {described(outcome.error)}"
                return
            _await_safe(found)
            problem = _unsafe(found, found.look(), trips)
        if not problem:
            return
    yield f"after rescue() over a new connection, {problem}"


def _true_rows(subject: Subject) -> Iterator[str]:
    with bench(subject) as found:
        if not found.look().measured:
            return
        yield from _compared(found, rest(found.driver))
        if setpoints_of(found):
            run(found)
            yield from _compared(found, far(found))


def _compared(found: Bench, setpoints: Sequence[float]) -> Iterator[str]:
    """Yield how the last of some rows differs from what the device measured all the while."""
    rows: list[Sequence[float]] = []
    end = time.monotonic() + STALL_S + 3 * found.driver.declaration.silent_s
    with watched(found) as seen:
        while len(rows) < TRUE_ROWS and time.monotonic() < end:
            outcome = found.cycle(setpoints)
            if outcome.error is not None:
                raise UnfitSubject(f"a cycle raises {described(outcome.error)}")
            if outcome.value is not None:
                rows.append(outcome.value)
    if len(rows) < TRUE_ROWS:
        raise UnfitSubject(f"only {len(rows)} rows came")
    still = {
        name: value
        for name, value in seen[-1].measured.items()
        if all(look.measured[name] == value for look in seen)
    }
    yield from untrue(found.driver.declaration, rows[-1], still)


def _repeated(subject: Subject) -> Iterator[str]:
    with bench(subject) as found:
        if found.look().sent is None:
            return
        rows = 0
        for turn in range(CYCLES):
            outcome = found.cycle()
            rows += outcome.value is not None
            if turn % 4 == 0:  # the device has no cause to send more for these
                for _ in range(3):
                    rows += (
                        found.call(lambda: found.driver.read(time.monotonic_ns())).value is not None
                    )
        sent = found.look().sent or 0
        if rows > sent:
            yield f"read() gives {rows} rows, and the device has sent {sent} readings"


#: They follow those of :mod:`rigd.sdk.check.cycled`.
RULES: Final = (
    Rule(
        "open moves nothing",
        "open() leaves the actuator as it is, and until arm() no setpoint reaches it",
        _open_moves_nothing,
        "",
        observes=True,
    ),
    Rule(
        "arm moves nothing",
        "arm() enables the actuator at rest: the first setpoint that is not zero comes by write()",
        _arm_moves_nothing,
        "",
        observes=True,
    ),
    Rule(
        "ready is true",
        "ready() returns what the device reports of its actuator, not what it was ordered to do",
        _locked,
        "locked",
    ),
    Rule(
        "setpoints arrive",
        "after write() the actuator is driven with the setpoint: check its unit, sign and order",
        _follows,
        "",
        observes=True,
    ),
    Rule(
        "limits hold",
        "clip each setpoint to its declared range before it is sent, or refuse it",
        _limits,
        "",
        observes=True,
    ),
    Rule(
        "NaN changes nothing",
        "send nothing if a setpoint is NaN: the actuator keeps the setpoint before it",
        _nan_moves_nothing,
        "",
        observes=True,
    ),
    Rule(
        "made safe",
        "make_safe() orders the safe state itself, at once; after it no setpoint and no close() "
        "energises the device",
        _made_safe,
        "",
        observes=True,
    ),
    *(
        Rule(
            f"safe while {fault}",
            "make_safe() or confirm_safe() raises a LinkError or DeviceError, unless the device is "
            "safe: wait for its answer in confirm_safe(), and check it",
            _safe_is_honest(fault),
            fault,
            observes=True,
        )
        for fault in ("silent", "dead", "stuck")
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
        "watchdog acts",
        "only read(), write() and the cycle keep the device enabled, no thread; and read() raises "
        "a DeviceError once the watchdog has acted",
        _watchdog_acts,
        "",
        observes=True,
    ),
    Rule(
        "watchdog proven",
        "prove_watchdog() sends nothing until the watchdog acts, at rest, and returns when it did",
        _proof,
        "",
        observes=True,
    ),
    Rule(
        "watchdog that never acts",
        "prove_watchdog() asks the device whether its watchdog acted, and raises a DeviceError if "
        "it did not",
        _unguarded,
        "unguarded",
    ),
    Rule(
        "rescued",
        "rescue() orders the safe state over a link of its own, and waits until it is sent",
        _rescued,
        "",
        observes=True,
    ),
    Rule(
        "rows are true",
        "a row has what the device measures, in the unit of its channel: check factor and sign",
        _true_rows,
        "",
        observes=True,
    ),
    Rule(
        "no row twice",
        "read() returns None until the device has sent a new reading; it never repeats the last",
        _repeated,
        "",
        observes=True,
    ),
)
