"""Checks slow drivers (coroutines) against the rules that the daemon's event loop depends on.

Sequences of calls are played with a healthy device: what a row shows, the device has measured, when
it came, once; and what a driver with setpoints drives is the last one that it was given, while it
is armed, and otherwise nothing.
"""

from __future__ import annotations

import asyncio
import contextlib
import random
import sys
import time
from collections.abc import Awaitable, Callable, Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from typing import Any, Final

from rigd.sdk.check.caller import CLOSES_S, OPEN_S, TAIL_S, Caller, CallOutcome
from rigd.sdk.check.cyclic.bench import clipped, rest
from rigd.sdk.check.cyclic.sequences import Setpoints, near, stays_put
from rigd.sdk.check.drawn_options import counted_s, intervals, too_often
from rigd.sdk.check.leaks import OpenedItem, nothing_left, opens
from rigd.sdk.check.peer import Peer
from rigd.sdk.check.rows import Matching, drawn_values, row_problems
from rigd.sdk.check.sequences import (
    DrawnTrial,
    KindOfStep,
    RandomWalk,
    SequenceDrawing,
    StepFailed,
    Unjudged,
    check_identity,
    expect,
    first_failure,
    in_turn,
    made,
    surely,
)
from rigd.sdk.check.subject import FAILURES, Rule, Subject, UnfitSubject, described
from rigd.sdk.check.watching import Watcher
from rigd.sdk.driver import SlowDriver

#: Time limit of a whole scene, in s, opening and a fault included.
SCENE_S: Final = 120.0
#: A connection that is closed has ended after this time, in s.
SCENE_ENDS_S: Final = 1.0
#: A driver that is cancelled must end within this time, in s.
CANCEL_S: Final = 3.0
#: So often two rows are awaited while the loop is watched.
WATCHED: Final = 6
#: More than the declared silence, or the usual time, until rows are there, in s.
ROOM_S: Final = 0.25
#: So often, or so long in s, the loop stands still before it counts.
STALLS: Final = 3
STANDS_S: Final = 0.5
#: Time between two ticks of the loop, in s; one that does not tick for so long, beside the time for
#: which threads wait for a processor, stands still.
TICK_S: Final = 0.005
STUCK_S: Final = 0.03
#: Most rows per second of a slow device; a driver that ignores its interval gives many more.
MOST_HZ: Final = 100.0
RATE_S: Final = 0.5
#: So many devices refuse an action, each in its own words.
REFUSALS: Final = 6
#: Faults in which no answer says that an action was done.
UNANSWERED: Final = ("silent", "garbled")
#: How long after a row run() has asked for the next one and waits for it, in s.
WAITS_S: Final = 0.3
#: Steps of the loop after which open() and run() are cancelled: any await may be the last.
CANCEL_STEPS: Final = (1, 2, 3, 5, 8, 13, 21, 34, 55)

#: Sequences of one examination, and the steps of each.
TRIALS: Final = 5
STEPS: Final = 16
#: What a row shows was measured at most so long before it was emitted, in s.
AGE_S: Final = 0.12
#: Faults that a device has for a while, and after which time an answer that is late has come, in s.
FAULTS_THAT_END: Final = ("late", "cut", "silent", "garbled", "dead")
LATE_S: Final = 1.3
#: So often the device is made to measure something else after a fault.
AGAIN: Final = 3
#: What was sent has arrived after this time, in s.
ARRIVES_S: Final = 0.06
#: For so long what is closed is looked at, twice, in s.
ENDS_S: Final = 0.15


async def _whole(main: Callable[[Sequence[OpenedItem]], Awaitable[None]]) -> None:
    """Await what opens and closes drivers, and check that they have left nothing to the loop.

    ``main`` is given what they open.

    Raises:
        StepFailed: a task or a connection is left; the loop would close it, the daemon's never.
    """
    with opens() as opened:
        await main(opened)
        if left := asyncio.all_tasks() - {asyncio.current_task()}:
            names = ", ".join(sorted(task.get_name() for task in left))
            raise StepFailed(f"tasks go on after close(): {names}")
        end = time.monotonic() + SCENE_ENDS_S
        while left_open := sum(
            each.connected is not None and each.connected.fileno() >= 0 for each in opened
        ):
            if time.monotonic() > end:
                raise StepFailed(f"{left_open} connections are left open after close()")
            await asyncio.sleep(0.01)


#: What comes before a fault.
RUNS: Final = (("open",), ("run",))
#: Those that are given the steps of the loop after which they cancel.
CANCELS: Final = ("open and cancel", "run and cancel", "cancel")
#: States: closed, open, running, armed (and running).
CALLS: Final[Mapping[str, KindOfStep]] = {
    "open": KindOfStep("closed", 3, "open"),
    "open and cancel": KindOfStep("closed", 1, "closed", 2),
    "run": KindOfStep("open", 4, "running"),
    "run and cancel": KindOfStep("open", 1.5, "open", 3),
    "run and at once act": KindOfStep("open", 1, "running", needs="actions"),
    "wait for rows": KindOfStep("running armed", 2, needs="channels"),
    "measure": KindOfStep("running armed", 4, needs="channels"),
    "act": KindOfStep("running armed", 1, needs="actions"),
    "open another": KindOfStep("running", 0.5, most=1),
    "fail": KindOfStep("running", 1, "running", 1, "faults"),
    "cancel": KindOfStep("running", 1.5, "open"),
    "close": KindOfStep("open", 1, "closed"),
    "kill and open": KindOfStep("open", 1.5, "open", 2),
    "new driver": KindOfStep("closed", 0.5),
    "arm": KindOfStep("running", 3, "armed", needs="setpoints"),
    "write": KindOfStep("armed", 8, needs="setpoints"),
    "make safe": KindOfStep("running armed", 2, "running", needs="setpoints"),
    "close and open": KindOfStep("armed", 0.7, "running", 1, "setpoints"),
    "kill and rescue": KindOfStep("armed", 0.5, "closed", 1, "rescue"),
    # Those that are not drawn.
    "watch the loop": KindOfStep("closed", 0.0),
    "count rows": KindOfStep("running", 0.0),
    "fail for long": KindOfStep("running", 0.0, "open"),
    "lose answers, early and late": KindOfStep("running", 0.0),
    "refuse": KindOfStep("running", 0.0),
}


def any_order(subject: Subject) -> Iterator[str]:
    """Play sequences of calls until one shows a fault; see :data:`CALLS`."""
    setpoints = Setpoints()

    def written(subject: Subject, rng: random.Random) -> tuple[float, ...]:  # as the cycle limits
        declared = subject.declare()
        return clipped(declared.setpoints, setpoints.draw(declared, rng))

    values = {
        "write": written,
        "close and open": written,
        "run and at once act": lambda subject, rng: rng.choice([*subject.declare().actions]),
        **dict.fromkeys(CANCELS, lambda _, rng: rng.choice(CANCEL_STEPS)),
    }
    trials = SequenceDrawing(subject, CALLS, values, FAULTS_THAT_END).trials(TRIALS, STEPS)
    yield from first_failure(partial(_play, subject), trials, subject.notes)


def _play(subject: Subject, trial: DrawnTrial) -> None:
    drawn = replace(subject, more={**subject.more, **trial.options}, varied=trial.seed)
    kept: list[_Session] = []  # what its drivers leave open stays to be seen

    async def main(peer: Peer, opened: Sequence[OpenedItem]) -> None:
        kept.append(_Session(drawn, peer, opened))
        other = replace(drawn, varied=f"{trial.seed} beside")
        with other.fresh_peer() if trial.beside else nullcontext() as beside:
            if beside is not None:
                kept.append(_Session(other, beside, opened))
            await kept[0].play(trial, *kept[1:])

    with nothing_left():
        with drawn.fresh_peer() as peer, Caller() as caller:
            error = caller.call(lambda: asyncio.run(_whole(partial(main, peer))), SCENE_S).error
        if isinstance(error, StepFailed | Unjudged | UnfitSubject):
            raise error
        if error is not None:
            raise StepFailed(described(error)) from error


class _Session:
    """Makes the calls of a sequence, and knows what the device is to do."""

    def __init__(self, subject: Subject, peer: Peer, opened: Sequence[OpenedItem]) -> None:
        self._subject = subject
        self._peer = peer
        self._all_opened = opened
        self._connections = 0  # of all drivers as it began to run
        self._fails = False  # the device has a fault, or an answer that is late is under way
        self._all: list[SlowDriver] = []
        self._new()
        self._setpoints = self._driver.declaration.setpoints
        self._watcher = Watcher(peer)
        self.readings = Matching(peer, self._driver.declaration, self._watcher.held)
        self._task: asyncio.Task[None] | None = None
        self._rows = 0  # since it was opened
        self._opened = False
        self._emitted_s = 0.0  # when the last row came, or it began to run
        self._gap_s = 0.0  # the longest time between rows, of runs without a fault
        self._kept = self._kept_before = 0  # how many readings gave no row, by two waits for rows
        self._wrong: list[StepFailed] = []  # what emit() saw
        self._came = asyncio.Event()
        self._safe = self._wanted = self._watcher.look().driven
        self._observed = bool(self._safe)  # the peer shows its actuators

    async def play(self, trial: DrawnTrial, *beside: _Session) -> None:
        """Make the calls; ``beside`` run meanwhile, each with a device of its own.

        Raises:
            StepFailed: the driver breaks a promise.
            Unjudged: it may be the machine, or the options.
        """
        walk = RandomWalk(trial, CALLS)
        with self._watcher:
            try:
                with walk.judged(self._watcher.stalls):
                    for other in beside:
                        await other.begin()
                    for step in walk:
                        await made(self, step)
                        for other in beside:
                            other.go_on()
                        if self._wrong:
                            raise self._wrong[0]
            finally:
                for session in (*beside, self):
                    await session.end()

    async def begin(self) -> None:
        """Open it and have it run, beside another."""
        await self._open()
        await self._run()

    def go_on(self) -> None:
        """Check that a driver which runs beside another goes on."""
        if self._wrong or (self._task is not None and self._task.done()):
            why = self._wrong[0] if self._wrong else repr(self._task)
            raise StepFailed(f"a driver beside it: {why}")

    async def end(self) -> None:
        """Cancel, make safe and close it."""
        if self._task is not None:
            self._task.cancel()
            await asyncio.wait({self._task}, timeout=CANCEL_S)
        if self._driver.declaration.setpoints and self._opened:
            with contextlib.suppress(*FAILURES):
                await self._driver.make_safe()
        await self._driver.close()

    # The calls of each step.

    async def _open(self) -> None:
        self._rows = 0
        self.readings.begin()
        await self._must("open", self._driver.open())
        self._opened = True
        check_identity(self._driver, self._watcher.look())
        await self._still("after open()")
        if reasons := list(self._driver.preflight()):
            raise StepFailed(f"preflight() finds fault with a healthy device: {reasons}")

    async def _open_and_cancel(self, steps: int) -> None:
        task = asyncio.create_task(self._driver.open())
        for _ in range(steps):
            await asyncio.sleep(0)
        await self._ended(task)
        for call in (*("close", "open") * 2, "close"):  # it opens again
            await self._must(call, getattr(self._driver, call)())

    async def _run_and_cancel(self, steps: int) -> None:
        """Cancel it twice while it asks; then what the device has answered is old, and no row."""
        for _ in range(2):
            self._begin()
            for _ in range(steps):
                await asyncio.sleep(0)
            await self._cancel(0)
        if self._driver.declaration.channels:
            if self._peer.measure is not None:
                await asyncio.to_thread(self._peer.measure, self._others(f"cancel {steps}"))
            await asyncio.sleep(1.5 * AGE_S)
            await self._run()
            await self._cancel()

    def _begin(self) -> None:
        self._came.clear()
        self._emitted_s = time.monotonic()
        self._connections = self._count_connections()
        self.readings.begin_run()
        self._task = asyncio.create_task(self._driver.run(self._emit))

    async def _run(self) -> None:
        self._begin()
        await self._wait_for_rows()

    async def _run_and_at_once_act(self, action: str) -> None:
        self._begin()
        await asyncio.sleep(0)  # it has asked, and waits for the answer
        await self._act(action)
        await self._wait_for_rows()

    async def _wait_for_rows(self, count: int = 2) -> None:
        task = self._running()
        self._kept_before, self._kept = self._kept, sys.maxsize
        for _ in range(count if self._driver.declaration.channels else 0):
            self._came.clear()
            came = asyncio.ensure_future(self._came.wait())
            within_s = self._driver.declaration.silent_s + ROOM_S
            await asyncio.wait({came, task}, timeout=within_s, return_when=asyncio.FIRST_COMPLETED)
            came.cancel()
            if task.done():
                raise StepFailed(_end_of(task))
            if not self._came.is_set():
                raise StepFailed(f"run() gives no row for {within_s:.3g} s")

    async def _measure(self, values: Mapping[str, float]) -> None:
        """Have the device measure something else: that gives rows as what is steady does."""
        await self._wait_for_rows(1)
        steady = self._kept == self._kept_before
        if self._peer.measure is not None:
            await asyncio.to_thread(self._peer.measure, values)
        await self._wait_for_rows()
        if steady and self._kept > self._kept_before:
            raise StepFailed("the device measures something else, and a reading gives no row")

    def _others(self, drawn_from: str) -> Mapping[str, float]:
        rng = random.Random(f"{self._subject.seed} {drawn_from}")
        return drawn_values(self._driver.declaration, rng)

    async def _act(self, action: str) -> None:
        if action not in self._driver.declaration.actions:
            (end,) = await asyncio.gather(self._driver.act(action), return_exceptions=True)
            if not isinstance(end, ValueError):
                is_error = isinstance(end, Exception)
                how = f"raises {type(end).__name__}: {end}" if is_error else f"returns {end!r}"
                raise StepFailed(f"it is none of its actions, and {how}")
            return
        before, began_s = self._watcher.look().acted, time.monotonic()
        usual_s, self._gap_s = self._gap_s, 0.0
        reply = await self._must("act", self._acts(action))
        if not isinstance(reply, str) or not reply:
            raise StepFailed(f"it returns {reply!r}, expected the reply of the device")
        if before is None:
            return
        after = self._watcher.look().acted
        if list(after or ()) != [*before, action]:
            raise StepFailed("the device has not done it")
        done_s = self._watcher.when(lambda look: look.acted == after)
        await self._wait_for_rows(1)
        gap_s, self._gap_s = self._gap_s - (done_s - began_s), usual_s
        if usual_s and self._watcher.held.exceeds(gap_s, 2 * usual_s + ROOM_S, began_s):
            raise StepFailed(f"once the device has done it no row comes for {gap_s:.2g} s")

    async def _acts(self, action: str) -> str:
        """Call for an action, which the device does once at most, whatever comes of it."""
        before = self._watcher.look().acted or ()
        try:
            return await self._driver.act(action)
        finally:
            done = (self._watcher.look().acted or ())[len(before) :]
            if len(done) > 1:
                raise surely(f"act({action!r}) has the device do {', '.join(done)}")

    async def _act_in_vain(self, fault: str) -> None:
        """Call for actions that the device does not do, or nobody knows: none returns."""
        actions = [*self._driver.declaration.actions][: 1 if fault in UNANSWERED else None]
        for action in actions if fault in {*UNANSWERED, "refusing"} else ():
            before = self._watcher.look().acted
            with contextlib.suppress(*FAILURES):
                reply = await asyncio.wait_for(self._acts(action), OPEN_S)
                if fault in UNANSWERED or self._watcher.look().acted == before:
                    raise surely(f"the device is {fault}, and act({action!r}) returns {reply!r}")

    async def _fail(self, fault: str) -> None:
        """Have the device fail for a while; then rows are what it measures, as before."""
        task, self._fails, opened = self._running(), True, self._count_connections()
        usual_s = self._gap_s
        await asyncio.to_thread(self._peer.faults[fault])
        await self._act_in_vain(fault)
        await asyncio.wait({task}, timeout=LATE_S)
        await asyncio.to_thread(self._peer.mended, fault)
        await asyncio.wait({task}, timeout=LATE_S)
        self._fails, self._gap_s = False, usual_s
        if not task.done() and self._count_connections() > opened == self._connections:
            raise StepFailed("run() makes a lost connection anew: what was set may be lost with it")
        if task.done():
            self._check_end()
            await self._begin_anew()
        if self._driver.declaration.channels:
            for number in range(AGAIN):
                await self._measure(self._others(f"{fault} {number}"))

    def _count_connections(self) -> int:
        """Return how many were made until now, by all drivers."""
        return sum(not each.words.startswith("_thread") for each in self._all_opened)

    async def _fail_for_long(self, fault: str) -> None:
        """Have the device fail, and no row come of it, nor an action be done."""
        task, declared = self._running(), self._driver.declaration
        self._fails = True
        self._peer.faults[fault]()
        began_s = time.monotonic()
        await self._act_in_vain(fault)
        within_s = TAIL_S + 2 * declared.silent_s
        await asyncio.wait({task}, timeout=began_s + within_s - time.monotonic())
        if self._wrong:
            raise surely(str(self._wrong[0]))
        if fault != "late" and self._emitted_s > began_s + TAIL_S:
            raise surely(f"run() still gives rows {TAIL_S:g} s after the device is {fault}")
        if not task.done():
            if fault == "dead":
                raise surely(f"{within_s:g} s after the device is dead run() has not raised")
            await self._cancel()
            return
        self._check_end()
        for action in [*declared.actions] * AGAIN:  # the operator tries
            with contextlib.suppress(*FAILURES):
                await self._driver.act(action)

    async def _lose_answers_early_and_late(self) -> None:
        """Have the device be silent, for a moment: a run that outlasts it at first does so later.

        Later is when a time since the begin of the run would be too long a silence.
        """
        if self._peer.mend is None:
            return
        for lasts_s in (self._driver.declaration.silent_s, 0.0):
            self._peer.faults["silent"]()
            await asyncio.wait({self._running()}, timeout=WAITS_S)
            self._peer.mend()
            await asyncio.wait({self._running()}, timeout=LATE_S)  # the question has its answer
            if self._running().done():
                self._check_end()
                if not lasts_s:
                    raise surely("it outlasts such a silence at its begin, and not later")
                return
            await asyncio.wait({self._running()}, timeout=lasts_s)

    async def _refuse(self) -> None:
        self._peer.faults["refusing"]()
        await self._act_in_vain("refusing")

    async def _count_rows(self, apart_s: float) -> None:
        """Count rows, which are to come ``apart_s`` from each other; 0: not too often."""
        before, began_s = self._rows, time.monotonic()
        await asyncio.wait({self._running()}, timeout=counted_s(apart_s) if apart_s else RATE_S)
        came, for_s = self._rows - before, time.monotonic() - began_s
        if apart_s:
            for problem in too_often(came, for_s, apart_s):
                raise StepFailed(problem)
        elif came > MOST_HZ * (1 + ROOM_S) * for_s:
            raise StepFailed(
                f"run() gives {came / for_s:.0f} rows per second, at most {MOST_HZ:g} are meant"
            )

    async def _watch_the_loop(self) -> None:
        stalls: list[float] = []

        async def tick() -> None:
            while True:
                began_s = time.monotonic()
                await asyncio.sleep(TICK_S)
                took_s = time.monotonic() - began_s
                if took_s > STUCK_S < (own_s := took_s - self._watcher.held.since(began_s)):
                    stalls.append(own_s)

        ticking = asyncio.create_task(tick())
        try:
            await self._open()
            await self._run()
            for _ in range(WATCHED):
                await self._wait_for_rows()
                for action in self._driver.declaration.actions:
                    await self._act(action)
        finally:
            ticking.cancel()
            await asyncio.wait({ticking})
            if len(stalls) >= STALLS or sum(stalls) >= STANDS_S:
                raise StepFailed(
                    f"the event loop stood still {len(stalls)} times, {max(stalls):.2f} s at most"
                )
        await self._cancel()
        await self._close()

    async def _cancel(self, steps: int = 1) -> None:
        for _ in range(steps):
            await asyncio.sleep(0.002)
        task = self._running()
        await self._ended(task)
        if not task.cancelled():
            raise StepFailed(f"{_end_of(task)} when it is cancelled")
        self._task = None

    async def _kill_and_open(self) -> None:
        """Ask, and end as if killed; another driver opens the device while it answers."""
        self._begin()
        await self._cancel()
        await self._driver.close()
        self._new()
        await self._open()

    async def _open_another(self) -> None:
        """Have another driver open the same device: if it may not, nothing has changed."""
        other = self._subject.make(self._peer, self._peer.link())
        self._all.append(other)
        ends: list[object] = await asyncio.gather(other.open(), return_exceptions=True)
        await self._must("close", other.close())
        if ends == [None]:  # in the place of this one, perhaps
            await self._ended(self._running())
            await self._begin_anew()
        await self._wait_for_rows()

    async def _begin_anew(self) -> None:
        await self._must("close", self._driver.close())
        await self._open()
        await self._run()

    async def _close(self) -> None:
        rows = self._rows
        for turn in ("close", "close again"):
            await self._must(turn, self._driver.close(), CLOSES_S)
        await asyncio.sleep(ENDS_S)  # what is under way arrives
        before = self.readings.sent
        await asyncio.sleep(ENDS_S)
        if self._rows > rows:
            raise StepFailed("run() still gives rows after it was cancelled")
        self._opened = False
        if self.readings.sent != before:
            raise StepFailed("the device goes on sending after close()")

    async def _new_driver(self) -> None:
        self._new()

    async def _arm(self) -> None:
        at_rest = rest(self._driver)
        await self._must("write", self._driver.write(at_rest))
        await self._still("without arm()")
        await self._must("arm", self._driver.arm())
        if self._observed:
            driven = await self._settled([self._safe, at_rest])
            if driven is None:
                raise StepFailed(f"the device is driven at {self._watcher.look().driven}")
            self._wanted = driven

    async def _write(self, setpoints: tuple[float, ...]) -> None:
        await self._must("write", self._driver.write(setpoints))
        self._wanted = setpoints
        if self._observed and await self._settled([setpoints]) is None:
            raise StepFailed(f"the device is driven at {self._watcher.look().driven}")

    async def _close_and_open(self, setpoints: tuple[float, ...]) -> None:
        """Close it while it is armed, as after an error, and open it again: it is not armed."""
        await self._cancel()
        await self._must("close", self._driver.close())
        await self._must("open", self._driver.open())
        stays, began_s = self._watcher.look().driven, time.monotonic()
        await self._run()
        await self._must("write", self._driver.write(setpoints))
        await self._wait_for_rows()
        stays_put(self._setpoints, self._watcher.since(began_s), stays, self._safe)
        await self._make_safe()

    async def _make_safe(self) -> None:
        for turn in ("make_safe", "make_safe again"):
            await self._must(turn, self._driver.make_safe())
            self._wanted = self._safe
            await self._still("after make_safe()")

    async def _kill_and_rescue(self) -> None:
        await self._cancel()
        await self._driver.close()  # as when its process is killed: nothing makes it safe
        self._new()
        await self._must("rescue", self._driver.rescue())
        self._wanted = self._safe
        await self._still("after rescue()")
        self._new()

    # What must hold.

    def _new(self) -> None:
        self._driver: SlowDriver = self._subject.make(self._peer, self._peer.link())
        self._all.append(self._driver)

    def _running(self) -> asyncio.Task[None]:
        assert self._task is not None  # noqa: S101
        return self._task

    def _emit(self, row: Sequence[float]) -> None:
        self._rows += 1
        now_s = time.monotonic()
        self._gap_s, self._emitted_s = max(self._gap_s, now_s - self._emitted_s), now_s
        self._kept = min(self._kept, self.readings.sent - self._rows)
        self._came.set()
        problems = list(row_problems(self._driver.declaration, row, in_range=not self._fails))
        if not problems and not self._fails:
            problems += self.readings.newest_first(row, AGE_S)
        self._wrong += map(StepFailed, problems)

    def _check_end(self) -> None:
        """Check that run() has ended as it does if the device fails."""
        task, self._task = self._running(), None
        if not isinstance(task.exception(), FAILURES):
            raise surely(_end_of(task))

    async def _ended(self, task: asyncio.Task[None]) -> None:
        """Cancel a call, and wait until it has ended."""
        task.cancel()
        await asyncio.wait({task}, timeout=CANCEL_S)
        if not task.done():
            raise StepFailed(f"it goes on {CANCEL_S:g} s after it was cancelled")

    async def _must(self, what: str, call: Awaitable[Any], within_s: float = OPEN_S) -> Any:
        try:
            return await asyncio.wait_for(call, within_s)
        except StepFailed:
            raise
        except Exception as error:  # noqa: BLE001  # whatever a driver raises is a finding
            expect(what, CallOutcome(error=error))

    async def _settled(self, wanted: Sequence[Sequence[float]]) -> Sequence[float] | None:
        """Return which of ``wanted`` the device is driven with, each value one of them."""
        end = time.monotonic() + 1.0
        while True:
            driven = self._watcher.look().driven
            if all(
                any(near(channel, value, item[index]) for item in wanted)
                for index, (channel, value) in enumerate(zip(self._setpoints, driven, strict=True))
            ):
                return driven
            if time.monotonic() > end:
                return None
            await asyncio.sleep(0.005)

    async def _still(self, when: str) -> None:
        """Check that the device is safe, and stays so for as long as what was sent needs."""
        if not self._observed:
            return
        began_s = time.monotonic()
        await asyncio.sleep(ARRIVES_S)
        for look in self._watcher.since(began_s):
            if look.energised or not all(map(near, self._setpoints, look.driven, self._safe)):
                raise StepFailed(f"{when} the device is driven at {look.driven}")


def _end_of(task: asyncio.Task[None]) -> str:
    error = task.exception()
    return "run() returns" if error is None else f"run() raises {described(error)}"


def _often(subject: Subject) -> Iterator[str]:
    """Count the rows of a while, with each interval and with that of the author."""
    for other, apart_s in ((subject, 0.0), *intervals(subject)):
        yield from in_turn(_play, (("open",), ("run",), ("count rows", apart_s)))(other)


#: If the first rule is broken, the others are not checked.
RULES: Final = (
    Rule(
        "any order of calls",
        "run() emits rows as declared at least every silent_s, what the device measures, as it "
        "comes, each reading once, until it is cancelled, anywhere; preflight() returns () for a "
        "healthy device; act() does each of actions; a device with setpoints is driven with the "
        "last one while it is armed, otherwise not at all; close() may come twice, leaves nothing",
        any_order,
        "",
    ),
    Rule(
        "never blocks",
        "await whatever waits: one blocking call stops every other device of the daemon",
        in_turn(_play, (("watch the loop",),)),
        "",
    ),
    Rule(
        "not too often",
        "wait from one reading to the next, as long as an option `period` or `interval` gives: 100 "
        "rows per second at most",
        _often,
        "",
    ),
    Rule(
        "silent",
        "with the device silent run() raises a DeviceError, or emits nothing: no row is made up; "
        "act() raises a DeviceError if none comes within a bound",
        in_turn(
            _play,
            (*RUNS, ("fail for long", "silent")),
            (*RUNS, ("lose answers, early and late",)),
        ),
        "silent",
    ),
    *(
        Rule(fault, demand, in_turn(_play, (*RUNS, ("fail for long", fault))), fault)
        for fault, demand in {
            "dead": "with the link dead run() raises a LinkError or DeviceError, within 2 silent_s",
            "late": "an answer that is late is waited for within a bound, or raises a DeviceError",
            "garbled": "damaged answers are thrown away or raise a ProtocolError; they never "
            "become rows, and act() returns only what the device answers if it did it",
        }.items()
    ),
    Rule(
        "action refused",
        "act() returns if the device says that it has done the action; else it raises a "
        "DeviceError, whatever the words of the refusal are",
        in_turn(_play, *[(*RUNS, ("refuse",))] * REFUSALS),
        "refusing",
    ),
)
