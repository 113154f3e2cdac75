"""Checks slow drivers (coroutines) against the rules that the daemon's event loop depends on."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import Awaitable, Callable, Iterator, Sequence
from typing import Final

from rigd.sdk.check.caller import Caller
from rigd.sdk.check.peer import Peer
from rigd.sdk.check.rows import row_problems
from rigd.sdk.check.subject import FAILURES, Rule, Subject, UnfitSubject, described
from rigd.sdk.driver import SlowDriver

#: Time limit of a whole scene, in s, opening and a fault included.
SCENE_S: Final = 120.0
#: Time limit of open(), in s: it may wait for a device that does not answer.
OPEN_S: Final = 30.0
#: A driver that is cancelled must end within this time, in s.
CANCEL_S: Final = 3.0
#: Rows of the measurements.
ROWS: Final = 3
#: The loop stands still if nothing else ran for so long, in s; a machine may stall for 0.1 s.
STUCK_S: Final = 0.25
#: So many pauses of that length count as stalls of the machine.
STALLS: Final = 2
#: For so long after the device is dead, run() may still emit rows that arrived before, in s.
TAIL_S: Final = 0.5
#: Steps of the loop after which open() and run() are cancelled: any await may be the last.
CANCEL_STEPS: Final = (1, 2, 3, 5, 8, 13, 21, 34, 55)

Problems = set[str]
Scene = Callable[[SlowDriver, Peer, Problems], Awaitable[None]]


def _scene(play: Scene, *, opened: bool = True) -> Callable[[Subject], Iterator[str]]:
    """Return a check that plays a scene on a loop of its own, the driver open and closed after."""

    def check(subject: Subject) -> Iterator[str]:
        problems: Problems = set()
        with subject.fresh_peer() as peer, Caller() as caller:

            async def main() -> None:
                driver = subject.make(peer, peer.link())
                try:
                    if opened:
                        await _opened(driver)
                    await play(driver, peer, problems)
                finally:
                    await driver.close()
                if left := asyncio.all_tasks() - {asyncio.current_task()}:
                    names = ", ".join(sorted(task.get_name() for task in left))
                    problems.add(f"tasks go on after close(): {names}")

            outcome = caller.call(lambda: asyncio.run(main()), SCENE_S)
        if outcome.error is not None:
            if isinstance(outcome.error, UnfitSubject):
                raise outcome.error
            problems.add(described(outcome.error))
        yield from sorted(problems)

    return check


async def _opened(driver: SlowDriver) -> None:
    try:
        await driver.open()
    except FAILURES as error:
        raise UnfitSubject(f"open raises {described(error)}") from error


class _Rows:
    """Receives the rows of a driver and stores the time of the last row."""

    def __init__(self) -> None:
        self.rows: list[Sequence[float]] = []
        self.last_s = time.monotonic()
        self._enough = asyncio.Event()

    def __call__(self, row: Sequence[float]) -> None:
        self.rows.append(row)
        self.last_s = time.monotonic()
        if len(self.rows) >= ROWS:
            self._enough.set()

    async def enough(self, driver: SlowDriver, task: asyncio.Task[None]) -> None:
        """Wait for some rows.

        Raises:
            UnfitSubject: they do not come.

        """
        waiting = asyncio.ensure_future(self._enough.wait())
        try:
            await asyncio.wait(
                {waiting, task}, timeout=ROWS * driver.declaration.silent_s + STUCK_S,
                return_when=asyncio.FIRST_COMPLETED,
            )  # fmt: skip
        finally:
            waiting.cancel()
        if task.done():
            error = task.exception()
            raise UnfitSubject(
                "run() returned" if error is None else f"run raises {described(error)}"
            )
        if not self._enough.is_set():
            raise UnfitSubject(f"{len(self.rows)} rows in {ROWS} times silent_s")


async def _stop(task: asyncio.Task[None], problems: Problems) -> None:
    """Cancel ``run`` and check that this ends it."""
    task.cancel()
    done, _ = await asyncio.wait({task}, timeout=CANCEL_S)
    if not done:
        problems.add(f"run() goes on {CANCEL_S:g} s after it was cancelled")
    elif not task.cancelled():
        error = task.exception()
        how = "returns" if error is None else f"raises {described(error)}"
        problems.add(f"run() {how} when it is cancelled")


async def _opens(driver: SlowDriver, peer: Peer, problems: Problems) -> None:
    reasons = driver.preflight()
    if list(reasons):
        problems.add(f"preflight() finds fault with a healthy device: {'; '.join(reasons)}")


async def _rows(driver: SlowDriver, peer: Peer, problems: Problems) -> None:
    rows = _Rows()
    task = asyncio.create_task(driver.run(rows))
    try:
        await rows.enough(driver, task)
        for row in rows.rows:
            problems.update(row_problems(driver.declaration, row))
    finally:
        if not task.done():
            await _stop(task, problems)


async def _never_blocks(driver: SlowDriver, peer: Peer, problems: Problems) -> None:
    pauses: list[float] = []

    async def tick() -> None:
        while True:
            before = time.monotonic()
            await asyncio.sleep(0.01)
            pauses.append(time.monotonic() - before)

    ticking = asyncio.create_task(tick())
    await driver.close()
    await _opened(driver)
    rows = _Rows()
    task = asyncio.create_task(driver.run(rows))
    await rows.enough(driver, task)
    await _stop(task, problems)
    ticking.cancel()
    await asyncio.wait({ticking})
    stuck = [pause for pause in pauses if pause > STUCK_S]
    if len(stuck) > STALLS or sum(stuck) > 1.0:
        problems.add(f"the event loop stood still {len(stuck)} times, {max(stuck):.2f} s at most")


async def _cancelled(driver: SlowDriver, peer: Peer, problems: Problems) -> None:
    for steps in CANCEL_STEPS:

        async def whole() -> None:
            await driver.open()
            await driver.run(lambda row: None)

        task = asyncio.create_task(whole())
        for _ in range(steps):
            await asyncio.sleep(0.002)
        await _stop(task, problems)
        try:
            await driver.close()
        except FAILURES as error:
            problems.add(f"close() after a cancelled open() raises {described(error)}")
    try:
        await driver.open()
    except FAILURES as error:
        problems.add(f"after cancelled ones, open() raises {described(error)}")


async def _actions(driver: SlowDriver, peer: Peer, problems: Problems) -> None:
    try:
        unknown = await driver.act("no such action")
        problems.add(f"act() of an unknown action returns {unknown!r}")
    except ValueError:
        pass
    except FAILURES as error:
        problems.add(f"act() of an unknown action raises {described(error)}")
    rows = _Rows()
    task = asyncio.create_task(driver.run(rows))
    await rows.enough(driver, task)
    for action in driver.declaration.actions:
        try:
            reply: object = await asyncio.wait_for(driver.act(action), SCENE_S / 4)
        except (*FAILURES, TimeoutError) as error:
            problems.add(f"{action} at a healthy device raises {described(error)}")
            continue
        if not isinstance(reply, str) or not reply:
            problems.add(f"{action} returns {reply!r}, expected the reply of the device")
    await _stop(task, problems)


async def _closed_twice(driver: SlowDriver, peer: Peer, problems: Problems) -> None:
    with contextlib.suppress(*FAILURES):
        await driver.open()
    for turn in ("close", "close again"):
        try:
            await driver.close()
        except FAILURES as error:
            problems.add(f"{turn} raises {described(error)}")
    await _opened(driver)


def _lost(fault: str) -> Scene:
    async def play(driver: SlowDriver, peer: Peer, problems: Problems) -> None:
        rows = _Rows()
        task = asyncio.create_task(driver.run(rows))
        await rows.enough(driver, task)
        peer.faults[fault]()
        began = time.monotonic()
        await asyncio.wait({task}, timeout=TAIL_S + 2 * driver.declaration.silent_s)
        if rows.last_s > began + TAIL_S:
            problems.add(f"run() still gives rows {TAIL_S:g} s after the device is {fault}")
        await _ended(task, problems)

    return play


def _bad_answers(fault: str) -> Scene:
    async def play(driver: SlowDriver, peer: Peer, problems: Problems) -> None:
        rows = _Rows()
        task = asyncio.create_task(driver.run(rows))
        await rows.enough(driver, task)
        peer.faults[fault]()
        await asyncio.wait({task}, timeout=1.0 + driver.declaration.silent_s)
        for row in rows.rows:
            problems.update(row_problems(driver.declaration, row, in_range=False))
        await _ended(task, problems)

    return play


async def _ended(task: asyncio.Task[None], problems: Problems) -> None:
    """Check that a run that has ended raised an error with a message; cancel a run that goes on."""
    if not task.done():
        await _stop(task, problems)
        return
    error = task.exception()
    if error is None:
        problems.add("run() returns; it runs until it is cancelled")
    elif not isinstance(error, FAILURES):
        problems.add(f"run() raises {described(error)}")


async def _not_there(driver: SlowDriver, peer: Peer, problems: Problems) -> None:
    peer.faults["dead"]()
    try:
        await driver.open()
        problems.add("open() succeeds although nothing is connected")
    except FAILURES as error:
        if error.hint is None:
            problems.add(f"open() raises {error.message!r} without a hint")


def _opens_in_words(fault: str) -> Scene:
    async def play(driver: SlowDriver, peer: Peer, problems: Problems) -> None:
        peer.faults[fault]()
        with contextlib.suppress(*FAILURES):  # the scene reports any other error
            await asyncio.wait_for(driver.open(), OPEN_S)

    return play


#: If the first rule is broken, the others are not checked.
RULES: Final = (
    Rule(
        "opens", "open() opens a healthy device; preflight() returns () for it", _scene(_opens), ""
    ),
    Rule(
        "rows",
        "run() emits rows as declared: a finite number per channel, within its range, an int last "
        "if it has a status, at least every silent_s; and goes on until it is cancelled",
        _scene(_rows),
        "",
    ),
    Rule(
        "never blocks",
        "await whatever waits: one blocking call stops every other device of the daemon",
        _scene(_never_blocks),
        "",
    ),
    Rule(
        "cancelled anywhere",
        "let CancelledError pass, clean up in finally, and let go of the port: it opens again",
        _scene(_cancelled, opened=False),
        "",
    ),
    Rule(
        "actions",
        "act() does each of actions while run() goes on, returns the reply of the device, and "
        "raises ValueError for another name",
        _scene(_actions),
        "",
    ),
    Rule(
        "closed twice",
        "close() may come twice, leaves no task behind, and lets go: open() works again",
        _scene(_closed_twice),
        "",
    ),
    Rule(
        "dead",
        "with the link dead run() raises a LinkError or DeviceError, or emits nothing",
        _scene(_lost("dead")),
        "dead",
    ),
    Rule(
        "silent",
        "with the device silent run() raises a DeviceError, or emits nothing: no row is made up",
        _scene(_lost("silent")),
        "silent",
    ),
    Rule(
        "late",
        "an answer that is late is waited for within a bound, or raises a DeviceError",
        _scene(_bad_answers("late")),
        "late",
    ),
    Rule(
        "garbled",
        "damaged answers are thrown away or raise a ProtocolError; they never become rows",
        _scene(_bad_answers("garbled")),
        "garbled",
    ),
    Rule(
        "not there",
        "open() without a device raises a LinkError with a hint: what to check",
        _scene(_not_there, opened=False),
        "dead",
    ),
    Rule(
        "silent at open",
        "open() of a device that sends nothing ends within 30 s, with a LinkError",
        _scene(_opens_in_words("silent"), opened=False),
        "silent",
    ),
    Rule(
        "garbled at open",
        "open() of a device that sends damaged answers raises a ProtocolError or LinkError",
        _scene(_opens_in_words("garbled"), opened=False),
        "garbled",
    ),
)
