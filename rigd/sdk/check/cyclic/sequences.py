"""Plays sequences of calls with a fast driver, as a run of the rig makes them and as none should.

What must hold after each call is one sentence: the device is driven with the last setpoint that was
written, clipped to its range, while it is armed; otherwise it is not driven at all. And what a row
shows, the device has measured. The peer shows the device (:class:`Observed`); without an observer
only what calls return is checked.
"""

from __future__ import annotations

import itertools
import math
import random
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from typing import Final

from rigd.model.channels import Channel
from rigd.model.errors import DeviceError
from rigd.sdk.check.caller import OPEN_S, Caller, CallOutcome
from rigd.sdk.check.cyclic.bench import (
    AGE_S,
    PERIOD_S,
    Bench,
    clipped,
    far_setpoints,
    is_switch,
    mounted,
    rest,
)
from rigd.sdk.check.leaks import nothing_left
from rigd.sdk.check.peer import Observed
from rigd.sdk.check.rows import LEAST, ROUNDED
from rigd.sdk.check.sequences import (
    DrawnStep,
    DrawnTrial,
    DrawValue,
    KindOfStep,
    RandomWalk,
    SequenceDrawing,
    StepFailed,
    check_identity,
    expect,
    first_failure,
    made,
    surely,
)
from rigd.sdk.check.subject import FAILURES, Subject, described
from rigd.sdk.check.watching import STALL_S, until
from rigd.sdk.declaration import Declaration

#: Sequences of one examination, and the steps of each behind those that open and before the last.
TRIALS: Final = 6
STEPS: Final = 32
#: An actuator that is driven with a value within this part of its range of another has that value:
#: frames and cards carry whole numbers.
NEAR: Final = 0.004
#: What was sent has arrived after this time, in s; no command of a cycle follows in it.
ARRIVES_S: Final = 0.05
#: What a device may take until it follows, or is safe, in s: some look at commands every 20 ms.
FOLLOWS_S: Final = 1.0
#: How much longer than watchdog_s a device may drive after the last call, in s: machines stall.
ROOM_S: Final = 1.0
#: A fault of the device in mid-run is reported within this time, in s.
REPORTED_S: Final = 1.5
#: Room for a time that a device keeps in its own unit, in s.
NUDGE: Final = 1e-3
#: An action ends within this time, in s.
ACTS_S: Final = 10.0
#: A proof returns the time of the device's watchdog, less at most this part of it.
PROOF_PART: Final = 0.2
#: It returns at most so much more than the time that was seen, in s.
PROOF_S: Final = 0.03
#: A setpoint is held for this part of the time of the watchdog, which must not act; if there is
#: none, for so long, in s.
HELD_PART: Final = 1.4
HELD_S: Final = 0.3
#: Cycles for which it is held at least: counters of 8 bits begin again. An answer has come after
#: this time, in s, and another that long later.
HELD_CYCLES: Final = 270
ANSWERED_S: Final = 0.02
COMES_S: Final = 0.003
#: Cycles after the device measures something else.
MEASURED: Final = 5
#: Cycles in each of which the setpoint is another, and the time from one to the next, in s.
RAMP_CYCLES: Final = 400
RAMP_S: Final = 0.001
#: Faults that end, and for how many cycles; until an answer that is late has come, and one that is
#: cut was asked for, in s.
FAULTS_THAT_END: Final = ("garbled", "cut", "dead", "late", "silent", "flooding")
FAULT_CYCLES: Final = 40
LASTS_S: Final = {"late": 1.2, "cut": 0.5}
#: Of the cycles in which all is damaged the device is asked in so many as before, at least.
ASKED_PART: Final = 0.75

#: States: closed, open (not armed), armed, tripped (by the watchdog).
CALLS: Final[Mapping[str, KindOfStep]] = {
    "open": KindOfStep("closed", 1, "open"),
    "open again": KindOfStep("open armed", 0.4, "open", 1, marks="silent"),
    "close and open": KindOfStep("armed", 0.7, "open", 2, "setpoints", "drives silent"),
    "prove watchdog": KindOfStep("open", 0.3, "open", 1, "watchdog", "drives"),
    "arm": KindOfStep("open", 4, "armed", marks="drives"),
    "arm and at once make safe": KindOfStep("open", 1.5, "open", 3, "setpoints", "drives"),
    "ramp and at once make safe": KindOfStep("armed", 1.2, "open", 2, "setpoints", "drives"),
    "arm anew": KindOfStep("armed", 0.8, "", 2, "setpoints"),
    "write": KindOfStep("armed", 16, needs="setpoints"),
    "write unarmed": KindOfStep("open", 1.5, "", 2, "setpoints"),
    "write without a read": KindOfStep("armed", 1, needs="setpoints"),
    "go on": KindOfStep("armed open", 2.5),
    "measure": KindOfStep("armed open", 1.5),
    "fail": KindOfStep("armed open", 1.0, "open", 2, "faults", "drives silent"),
    "hold": KindOfStep("armed", 0.6, "", 1),
    "cycle without a write": KindOfStep("armed open", 1),
    "be silent": KindOfStep("open", 0.5, "open", 1, "watchdog"),
    "act": KindOfStep("open armed", 0.6, "", 3, "actions", "drives"),
    "wait for the watchdog": KindOfStep("armed", 0.4, "tripped", 1, "watchdog", "silent"),
    "make safe": KindOfStep("open armed tripped", 2.5, "open"),
    "close": KindOfStep("open", 0.6, "closed"),
    "new driver": KindOfStep("closed", 0.1),
    "kill": KindOfStep("armed", 0.5, "closed", 1, "watchdog", "silent"),
    "kill and rescue": KindOfStep("armed", 0.8, "closed", 2, "rescue"),
}
#: Those that are given setpoints: they count, or do not.
WRITES: Final = (
    ("write",),  # what is no number counts here alone
    ("write without a read", "ramp and at once make safe"),
    ("write unarmed", "close and open"),
)
#: Kinds of setpoints: in the range, at its ends, beyond them, close to the last, none at all.
KINDS: Final = (
    *("zero", "zero", "again", "step", "step", "low", "high", "below", "above", "endless", "nan"),
    *("any", "any", "any", "small", "small"),
)


class Setpoints:
    """Draws setpoints, of each kind equally often."""

    def __init__(self) -> None:
        self._deck: list[str] = []
        self._last: Sequence[float] = ()

    def draw(self, declared: Declaration, rng: random.Random) -> tuple[float, ...]:
        """Return a setpoint for each that is declared."""
        before = self._last or [0.0] * len(declared.setpoints)
        drawn = tuple(
            self._setpoint(channel, last, rng)
            for channel, last in zip(declared.setpoints, before, strict=True)
        )
        self._last = drawn
        return drawn

    def _setpoint(self, channel: Channel, last: float, rng: random.Random) -> float:
        """Return a setpoint of one of the kinds, each of which comes equally often."""
        if not self._deck:
            self._deck += KINDS
            rng.shuffle(self._deck)
        low, high = channel.low, channel.high
        span = high - low
        last = low if math.isnan(last) else min(max(last, low), high)
        kind = self._deck.pop()
        if is_switch(channel):
            kind = {"step": "zero", "below": "zero"}.get(kind, kind)
            kind = "high" if kind in {"any", "small", "above"} else kind
        beyond = span * rng.choice((0.05, rng.random(), 10.0))
        return {
            "zero": 0.0, "again": last, "low": low, "high": high, "nan": math.nan,
            "step": last + span * rng.choice((-0.05, -0.02, -0.01, 0.01, 0.02, 0.05)),
            "small": math.pow(10.0, -rng.uniform(1.0, 5.0)) * rng.choice((low, high)),
            "below": low - beyond, "above": high + beyond,
            "endless": rng.choice((math.inf, -math.inf)), "any": low + span * rng.random(),
        }[kind]  # fmt: skip


def near(channel: Channel, value: float, wanted: float, step: float | None = None) -> bool:
    """Return whether an actuator that is driven with ``value`` has the setpoint ``wanted``.

    ``step`` is the smallest of the device, if it is known: it may round or cut off.
    """
    room = NEAR * (channel.high - channel.low)
    if step is not None:
        room = step * (1 + ROUNDED) + ROUNDED * abs(wanted) + LEAST
    return abs(value - wanted) <= room


def stays_put(
    channels: Sequence[Channel],
    looks: Sequence[Observed],
    stays: Sequence[float],
    safe: Sequence[float],
) -> None:
    """Raise StepFailed if a device moves that was opened again, and is not armed."""
    for look in looks:
        for channel, value, *at in zip(channels, look.driven, stays, safe, strict=False):
            if not any(near(channel, value, item) for item in at):
                raise StepFailed(
                    f"opened again, and not armed, it drives the device at {value:.4g} "
                    f"{channel.unit}"
                )


def any_order(subject: Subject) -> Iterator[str]:
    """Play sequences of calls until one shows a fault; see :data:`CALLS`."""

    def written(drawing: Setpoints, subject: Subject, rng: random.Random) -> tuple[float, ...]:
        return drawing.draw(subject.declare(), rng)

    decks = [(Setpoints(), names) for names in WRITES]  # of each the kinds come equally often
    values: dict[str, DrawValue] = {
        "go on": lambda _, rng: rng.choice((0.0, PERIOD_S)),
        **{name: partial(written, item) for item, names in decks for name in names},
    }

    def play(trial: DrawnTrial) -> None:
        drawn = replace(subject, more=trial.options, varied=trial.seed)
        other = replace(drawn, varied=f"{trial.seed} beside")
        with (
            nothing_left(),
            drawn.fresh_peer() as peer,
            Caller() as caller,
            mounted(other) if trial.beside else nullcontext() as beside,
        ):
            played = _Played(drawn, Bench(drawn, peer, caller), beside)  # what it leaves is seen
            played.play(trial)

    trials = SequenceDrawing(subject, CALLS, values, FAULTS_THAT_END).trials(TRIALS, STEPS)
    yield from first_failure(play, trials, subject.notes)


class _Played:
    """Makes the calls of a sequence, and knows what the device is to do."""

    def __init__(self, subject: Subject, found: Bench, beside: Bench | None) -> None:
        self._subject = subject
        self._found = found
        self._beside = beside  # another of its class, before a device of its own
        self._channels = found.driver.declaration.setpoints
        self._safe: Sequence[float] = found.fresh.driven
        #: What the device is to be driven with, and what was written last.
        self._wanted: Sequence[float] = self._safe
        self._last: Sequence[float] = ()
        self._observed = found.peer.observed is not None
        self._enables: bool | None = None  # whether an armed device at rest is energised
        self._called_s = 0.0  # when the last command was sent
        self._stalled = False  # for so long that the watchdog may have acted

    def play(self, trial: DrawnTrial) -> None:
        """Make the calls.

        Raises:
            StepFailed: the driver breaks a promise.
            Unjudged: it may be the machine, or the options.
        """
        found, self._walk = self._found, RandomWalk(trial, CALLS)
        with found.watcher:
            try:
                with self._walk.judged(self._stands):
                    if self._beside is not None:
                        expect("open", self._beside.open())
                    for step in self._walk:
                        self._step(step)
            finally:
                found.call(found.driver.make_safe)
                found.close()

    def _step(self, step: DrawnStep) -> None:
        """Make the calls of one step, and check the device while and after they are made."""
        self._passed: list[Sequence[float]] = []  # other setpoints of this step
        self._called_s = time.monotonic()
        began_s, before, trips = self._called_s, self._wanted, self._found.look().trips
        made(self, step)
        if self._beside is not None:
            self._look_beside(self._beside)
        if not self._observed or not self._channels:
            return
        acted = self._walk.state == "armed" and self._found.look().trips != trips
        if acted and "silent" not in CALLS[step.name].marks:
            raise StepFailed(
                "the watchdog of the device acts, though the driver is called all the time"
            )
        calm = not {self._walk.state, CALLS[step.name].after} - {"closed", "open", ""}
        for look in self._found.watcher.since(began_s):
            if calm and look.energised and "drives" not in CALLS[step.name].marks:
                raise StepFailed("meanwhile the device is energised")
            for index, channel in enumerate(self._channels):
                ends = [each[index] for each in (before, self._wanted, *self._passed)]
                room = NEAR * (channel.high - channel.low)
                if not min(ends) - room <= look.driven[index] <= max(ends) + room:
                    raise StepFailed(
                        f"meanwhile the device is driven at {look.driven[index]:g} {channel.unit}"
                    )

    def _stands(self) -> bool:
        """Return whether the machine stood still for so long that the watchdog may have acted."""
        watchdog_s = self._found.driver.watchdog_s or 1.0
        return self._stalled or self._found.watcher.stalls(min(watchdog_s / 3, STALL_S))

    def _look_beside(self, beside: Bench) -> None:
        """Check that the driver beside this one, which is open and not armed, is as it was."""
        outcome = beside.cycle(())
        if outcome.error is None:
            beside.check_row(outcome.value)
        elif not isinstance(outcome.error, FAILURES):
            raise StepFailed(f"a driver beside it raises {described(outcome.error)}")
        look = beside.look()
        check_identity(beside.driver, look)
        if look.energised:
            raise StepFailed("the device of a driver beside it is energised")

    # The calls of each step.

    def _open(self) -> None:
        before = self._found.look().ordered
        expect("open", self._found.open())
        check_identity(self._found.driver, self._found.look())
        self._safe_now("after open()")
        if (after := self._found.look().ordered) != before:
            raise StepFailed(f"open() changes what the device is told, from {before} to {after}")
        outcome = self._found.call_slowly(self._found.driver.preflight)
        expect("preflight", outcome)
        if reasons := list(outcome.value):
            raise StepFailed(f"preflight() finds fault with a healthy device: {reasons}")
        declared_s, there_s = self._found.driver.watchdog_s, self._found.look().watchdog_s
        kept = (
            there_s is None if declared_s is None else 0.0 < (there_s or 0.0) < declared_s + NUDGE
        )
        if self._observed and self._channels and not kept:
            raise StepFailed(f"watchdog_s is {declared_s} s, and that of the device is {there_s} s")

    def _open_again(self) -> None:
        """Open what is open: it is as before, or it is open anew and not armed."""
        outcome = self._found.call(self._found.driver.open, OPEN_S)
        if outcome.error is not None and not isinstance(outcome.error, FAILURES):
            raise StepFailed(f"open() of an open driver raises {described(outcome.error)}")
        if self._observed and not self._driven():
            self._wanted = self._safe
            self._safe_now("opened anew")
        self._make_safe()

    def _close_and_open(self, setpoints: Sequence[float]) -> None:
        """Close it while it is armed, as after an error, and open it again: it is not armed."""
        self._wanted = self._safe
        expect("close", self._found.close())
        expect("open", self._found.open())
        self._opened_anew(setpoints)

    def _opened_anew(self, setpoints: Sequence[float]) -> None:
        """Write to what was opened again: the device stays as it was, or is safe; make it safe."""
        stays, began_s = self._found.look().driven, time.monotonic()
        self._write_for_nothing(setpoints)
        stays_put(self._channels, self._found.watcher.since(began_s), stays, self._safe)
        self._make_safe()

    def _prove_watchdog(self) -> None:
        for _ in range(2):
            self._prove()

    def _prove(self) -> None:
        found, began_s = self._found, time.monotonic()
        before, promised = found.look(), found.driver.watchdog_s or 0.0
        found.sent_s.clear()
        outcome = found.call_slowly(found.driver.prove_watchdog)
        quiet = before.trips is None or found.look().trips != before.trips
        if isinstance(outcome.error, DeviceError) and not quiet:
            raise surely(f"prove_watchdog raises {described(outcome.error)}: it was not silent")
        expect("prove_watchdog", outcome)
        least_s, most_s = (1 - PROOF_PART) * (before.watchdog_s or 0.0), promised + ROOM_S / 4
        if before.trips is not None:
            # It took at most the time since the proof began, unless the driver has noticed it only
            # when it asked again.
            acted_s = found.watcher.when(lambda look: look.trips != before.trips)
            asked_s = next((each for each in found.sent_s if each > acted_s), math.inf)
            noticed = (asked_s - each for each in (began_s, *found.sent_s) if each < acted_s)
            if not any(abs(outcome.value - each) < PROOF_S for each in noticed):
                most_s = min(most_s, acted_s - began_s + PROOF_S)
        if not least_s < outcome.value <= most_s:
            of = f", and the device acts after {before.watchdog_s:g} s" if before.watchdog_s else ""
            raise StepFailed(
                f"it returns {outcome.value!r} s, and watchdog_s is {promised:g} s{of}"
            )
        if before.trips is not None and self._found.look().trips == before.trips:
            raise StepFailed(f"it returns {outcome.value:g} s, and the watchdog did not act")
        self._safe_now("after prove_watchdog()")

    def _arm(self) -> None:
        found = self._found
        self._last = rest(found.driver)
        self._cycle(self._last, refused=True)  # as before a run: its watchdog may have acted
        self._wanted = self._last
        self._passed.append(self._last)
        expect("arm", found.call_slowly(found.driver.arm))
        self._listen(ARRIVES_S)  # no setpoint of write() hides what arm() sent
        self._become_ready()
        energised = found.look().energised
        if self._enables is None:
            self._enables = energised
        elif self._enables and not energised:
            raise StepFailed("ready() returns True, and the device is not energised")
        if self._observed:  # it is at rest as before, or as the setpoint zero has it
            driven = found.look().driven
            nearer = [
                min((self._safe[index], self._wanted[index]), key=lambda item: abs(item - value))
                for index, value in enumerate(driven)
            ]
            self._wanted = tuple(nearer)
        self._settle()

    def _become_ready(self) -> None:
        self._found.become_ready(lambda: self._cycle(self._last), rows=True)

    def _arm_anew(self) -> None:
        """Make it safe, arm it and write, in one cycle: what was sent before is of no account."""
        found = self._found
        self._write(far_setpoints(found.driver))
        self._passed += [self._safe, rest(found.driver)]
        expect("make_safe", found.call(found.driver.make_safe))
        expect("arm", found.call(found.driver.arm))
        expect("write", found.cycle(self._last, 0.0, reads=False))
        self._become_ready()
        self._settle()

    def _arm_and_at_once_make_safe(self) -> None:
        self._passed.append(rest(self._found.driver))
        expect("arm", self._found.call(self._found.driver.arm))
        self._make_safe()

    def _ramp_and_at_once_make_safe(self, setpoints: Sequence[float]) -> None:
        """Write another setpoint in each cycle, as a run does, and stop in the middle of it."""
        begin, end = clipped(self._channels, self._wanted), clipped(self._channels, setpoints)
        self._passed += begin, end
        due_s = time.monotonic()
        for number in range(1, RAMP_CYCLES + 1):
            due_s += RAMP_S
            between = tuple(
                b if is_switch(channel) else a + (b - a) * number / RAMP_CYCLES
                for channel, a, b in zip(self._channels, begin, end, strict=True)
            )
            self._cycle(between, pause_s=max(0.0, due_s - time.monotonic()))
        expect("make_safe", self._found.call(self._found.driver.make_safe))
        expect("confirm_safe", self._found.call(self._found.driver.confirm_safe))
        self._make_safe()

    def _write(self, setpoints: Sequence[float]) -> None:
        if any(map(math.isnan, setpoints)) and self._wanted == self._safe:
            self._write([each.high or each.low for each in self._channels])  # which NaN must leave
        bounds = zip(self._channels, setpoints, strict=True)
        beyond = not all(channel.low <= value <= channel.high for channel, value in bounds)
        outcome = self._cycle(setpoints, refused=beyond)
        if outcome.error is None:
            if any(map(math.isnan, setpoints)):
                raise StepFailed("write() takes NaN as if it were a setpoint")
            self._last, self._wanted = setpoints, clipped(self._channels, setpoints)
        self._settle()

    def _write_unarmed(self, setpoints: Sequence[float]) -> None:
        self._write_for_nothing(setpoints)
        self._safe_now("without arm()")

    def _write_for_nothing(self, setpoints: Sequence[float]) -> None:
        """Write until the device would have it."""
        known, watchdog_s = self._found.readings, self._found.driver.watchdog_s
        end = time.monotonic() + (FOLLOWS_S if watchdog_s is None else watchdog_s / 2)
        asked = known.sent + 2 * (self._found.peer.readings is not None)
        for number in itertools.count():
            self._cycle(setpoints, refused=True)
            if (number >= 3 and known.sent >= asked) or time.monotonic() > end:
                break

    def _write_without_a_read(self, setpoints: Sequence[float]) -> None:
        self._last = self._wanted = clipped(self._channels, setpoints)
        end = time.monotonic() + 8 * AGE_S
        while time.monotonic() < end:  # what is read then is the newest, and not the oldest
            expect("write", self._found.cycle(self._last, 0.0, reads=False))
            self._called_s = time.monotonic()
            time.sleep(AGE_S / 4)
        self._cycle(self._last)
        self._settle()

    def _go_on(self, pause_s: float) -> None:
        """Go through cycles; without a pause most come before an answer."""
        end, setpoints = time.monotonic() + 3 * AGE_S, self._present()
        while time.monotonic() < end:
            self._cycle(setpoints, pause_s=pause_s)
        self._still()

    def _hold(self) -> None:
        declared, watchdog_s = self._found.driver.declaration, self._found.driver.watchdog_s
        for_s = HELD_S if watchdog_s is None else HELD_PART * watchdog_s
        rows, began_s = self._found.rows, time.monotonic()
        cycles = self._read_each(self._present(), max(for_s, 4 * declared.silent_s), HELD_CYCLES)
        if cycles > 50 and declared.channels and self._found.rows == rows:
            raise StepFailed(f"read() gives no row in {time.monotonic() - began_s:.1f} s")
        self._settle()

    def _read_each(self, setpoints: Sequence[float], for_s: float, least: int) -> int:
        """Go through cycles, each with an answer that has come; return how many they were."""
        known, end = self._found.readings, time.monotonic() + for_s
        came, cycles, lost = 0, 0, 0
        while time.monotonic() < end or cycles < least:
            fresh, sent = came > known.marked, known.sent
            row = self._cycle(setpoints).value
            lost += fresh and row is None and self._found.driver.declaration.every_cycle
            came = self._await_answer(sent)
            cycles += 1
        if lost:
            raise StepFailed(f"{lost} answers of {cycles} that have come give no row")
        return cycles

    def _await_answer(self, before: int) -> int:
        """Wait until the device has sent more than so many readings; return how many have come."""
        known = self._found.readings
        if not known.sent:
            return 0
        until(lambda: known.sent > before, ANSWERED_S)
        sent = known.sent
        time.sleep(COMES_S)
        return sent

    def _measure(self, values: Mapping[str, float]) -> None:
        if self._found.peer.measure is not None:
            self._found.peer.measure(values)
        self._read_each(self._present(), 0.0, MEASURED)

    def _fail(self, fault: str) -> None:
        """Have the device fail for a while; then it is as before, with the same driver."""
        found, peer = self._found, self._found.peer
        setpoints = self._last if self._walk.state == "armed" else ()
        self._passed.append(clipped(self._channels, setpoints) if setpoints else self._safe)
        self._wanted = self._safe
        sent = [found.readings.sent]
        for _ in range(FAULT_CYCLES):
            self._cycle(setpoints)
        error: BaseException | None = None
        for change in (peer.faults[fault], partial(peer.mended, fault)):
            sent.append(found.readings.sent)
            change()
            end, cycles = time.monotonic() + LASTS_S.get(fault, 0.0), 0
            while (error is None and cycles < FAULT_CYCLES) or time.monotonic() < end:
                cycles += 1
                if error is None:
                    error = found.cycle(setpoints).error
                else:
                    time.sleep(COMES_S)  # what is late comes meanwhile
        before, meanwhile = sent[1] - sent[0], sent[2] - sent[1]
        asks = found.driver.declaration.every_cycle and before > ASKED_PART * FAULT_CYCLES
        if error is None and fault == "garbled" and asks and meanwhile < ASKED_PART * before:
            raise StepFailed(
                f"in {FAULT_CYCLES} cycles the device is asked {before} times, and {meanwhile} "
                "times while its answers are damaged"
            )
        if error is None:
            self._found.check_row(found.cycle(setpoints).value)  # whatever was late
            error = found.call(found.driver.make_safe).error  # it may raise, once
        if error is not None and not isinstance(error, FAILURES):
            raise StepFailed(f"while the device is {fault}, it raises {described(error)}")
        expect("close", found.close())
        expect("open once the fault is over", found.open())
        self._opened_anew(setpoints)

    def _cycle_without_a_write(self) -> None:
        self._listen(2 * ARRIVES_S)
        self._still()

    def _be_silent(self) -> None:
        """Make no call for so long that the watchdog acts, not armed, as others are opened."""
        time.sleep((self._found.driver.watchdog_s or 0.0) + ROOM_S / 10)
        self._called_s = time.monotonic()
        self._read_each(rest(self._found.driver), 0.0, MEASURED)

    def _act(self, action: str) -> None:
        found = self._found
        before, error = found.look().acted, found.call(lambda: found.driver.act(action)).error
        if action not in found.driver.declaration.actions:
            if not isinstance(error, ValueError):
                raise StepFailed("it is none of its actions, and raises no ValueError")
            return
        end = time.monotonic() + ACTS_S
        reply: object = None
        while error is None and not reply and time.monotonic() < end:
            self._cycle(self._present())
            outcome = found.call(found.driver.acted)
            reply, error = outcome.value, outcome.error
        if not isinstance(reply, str):
            words = "no reply" if error is None else described(error)
            raise StepFailed(f"a healthy device gives {words}")
        if before is not None and list(found.look().acted or ()) != [*before, action]:
            raise StepFailed("the device has not done it")

    def _wait_for_the_watchdog(self) -> None:
        if not self._observed:
            return
        self._let_it_act()
        self._wanted = self._safe
        trips = self._found.look().trips
        if not trips:
            return  # it does not count them
        end = time.monotonic() + REPORTED_S + self._found.driver.declaration.silent_s
        while time.monotonic() < end:
            outcome = self._found.cycle(self._last)
            if self._found.look().energised:
                raise StepFailed("the next setpoint drives the device again")
            if outcome.error is not None:
                if not isinstance(outcome.error, FAILURES):
                    raise StepFailed(f"a cycle raises {described(outcome.error)}")
                return
        raise StepFailed("the watchdog has switched the device off, and read() does not report it")

    def _make_safe(self) -> None:
        found = self._found
        trips = found.look().trips
        self._wanted = self._safe
        expect("make_safe", found.call(found.driver.make_safe))
        self._await_safe("after make_safe()", trips)
        expect("confirm_safe", found.call_slowly(found.driver.confirm_safe))
        expect("make_safe again", found.call(found.driver.make_safe))
        if found.readings.sent:  # what is read then is not what was read before
            time.sleep(1.5 * AGE_S)
        self._cycle(())
        self._safe_now("after make_safe()")

    def _close(self) -> None:
        found = self._found
        expect("close", found.close())
        expect("close again", found.close())
        self._safe_now("after close()")

    def _new_driver(self) -> None:
        self._found.replace()

    def _kill(self) -> None:
        self._found.close()  # as when its process is killed: nothing makes it safe
        if self._observed:
            self._let_it_act()
        self._wanted = self._safe
        self._found.replace()

    def _kill_and_rescue(self) -> None:
        found, trips = self._found, self._found.look().trips
        found.close()
        found.replace()
        self._wanted = self._safe
        expect("rescue", found.call_slowly(found.driver.rescue))
        self._await_safe("after rescue() over a new connection", trips)
        found.replace()  # it has closed what it opened

    # What must hold.

    def _cycle(
        self, setpoints: Sequence[float], *, refused: bool = False, pause_s: float = PERIOD_S
    ) -> CallOutcome:
        """Go through a cycle, check its row, and return how it ended; it may refuse setpoints."""
        outcome = self._found.cycle(setpoints, pause_s)
        if outcome.error is None:
            self._found.check_row(outcome.value)
        elif not refused or not isinstance(outcome.error, (*FAILURES, ValueError)):
            raise StepFailed(f"a cycle raises {described(outcome.error)}")
        now_s = time.monotonic()
        if setpoints:
            self._stalled |= now_s - self._called_s > (self._found.driver.watchdog_s or 9.0) / 2
            self._called_s = now_s
        return outcome

    def _present(self) -> Sequence[float]:
        """Return what a cycle goes on to write: the last setpoint, if it is armed."""
        if self._walk.state != "armed":
            return ()
        self._wanted = clipped(self._channels, self._last)
        return self._last

    def _listen(self, for_s: float) -> None:
        """Go through cycles without a setpoint, not for so long that the watchdog may act."""
        end = time.monotonic() + for_s
        if self._found.driver.watchdog_s is not None:
            end = min(end, self._called_s + 0.5 * self._found.driver.watchdog_s)
        while time.monotonic() < end:
            self._cycle(())

    def _settle(self) -> None:
        """Go through cycles without a setpoint until the device is driven as it is to be."""
        end = time.monotonic() + FOLLOWS_S
        if self._found.driver.watchdog_s is not None:
            end = min(end, self._called_s + 0.5 * self._found.driver.watchdog_s)
        self._cycle(())
        while self._observed and not self._driven() and time.monotonic() < end:
            self._cycle(())
        self._still()

    def _still(self) -> None:
        """Check that the device is driven as it is to be."""
        if not self._observed or not self._channels:
            return
        look = self._found.look()
        if not self._driven(look):
            raise StepFailed(f"the device is driven at {self._shown(look.driven)}")
        if self._enables and self._walk.state == "armed" and not look.energised:
            raise StepFailed("it is armed, and the device is not energised")

    def _safe_now(self, when: str) -> None:
        """Check that the device is and stays safe, for as long as what was sent needs to arrive."""
        if not self._observed or not self._channels:
            return
        began_s = time.monotonic()
        time.sleep(ARRIVES_S)
        for look in self._found.watcher.since(began_s):
            if look.energised:
                raise StepFailed(f"{when} the device is energised")
            if not self._driven(look):
                raise StepFailed(f"{when} the device is driven at {self._shown(look.driven)}")
            told = replace(look, driven=look.ordered)
            if look.ordered not in ((), self._found.fresh.ordered) and not self._driven(told):
                raise StepFailed(f"{when} the device is told {self._shown(look.ordered)}")

    def _await_safe(self, when: str, trips: int | None) -> None:
        """Check that the device becomes safe, and not by its watchdog."""
        if problem := self._found.unsafe(trips):
            raise StepFailed(f"{when} {problem}")

    def _let_it_act(self) -> None:
        """Wait until the watchdog has switched the device off; nothing is called meanwhile."""
        within_s = (self._found.driver.watchdog_s or 0.0) + ROOM_S
        if not until(lambda: not self._found.look().energised, within_s):
            driven = self._shown(self._found.look().driven)
            raise StepFailed(f"{within_s:g} s after the last call the device is driven at {driven}")

    def _driven(self, look: Observed | None = None) -> bool:
        look = self._found.look() if look is None else look
        steps = look.resolution or itertools.repeat(None)
        return all(
            near(channel, value, want, step)
            for channel, value, want, step in zip(
                self._channels, look.driven, self._wanted, steps, strict=False
            )
        )

    def _shown(self, driven: Sequence[float]) -> str:
        return ", ".join(
            f"{value:.4g} {channel.unit}, not {want:.4g}"
            for channel, value, want in zip(self._channels, driven, self._wanted, strict=True)
        )
