"""Checks slow drivers (coroutines) against the rules that the daemon's event loop depends on."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import Awaitable, Callable, Iterator, Sequence
from typing import Final

from rigd.sdk.check.caller import Caller
from rigd.sdk.check.peer import Peer
from rigd.sdk.check.rows import row_problems, untrue
from rigd.sdk.check.stalls import Stalls
from rigd.sdk.check.subject import FAILURES, Rule, Subject, UnfitSubject, described
from rigd.sdk.driver import SlowDriver

#: Time limit of a whole scene, in s, opening and a fault included.
SCENE_S: Final = 120.0
#: Time limit of open(), in s: it may wait for a device that does not answer.
OPEN_S: Final = 30.0
#: A driver that is cancelled must end within this time, in s.
CANCEL_S: Final = 3.0
#: Rows of the measurements, and of the one for which the loop is watched.
ROWS: Final = 3
MORE_ROWS: Final = 8
#: More than the declared silence until the rows of a measurement are there, in s.
ROOM_S: Final = 0.25
#: So often, or so long in s, the loop alone stands still before it counts.
STALLS: Final = 3
STANDS_S: Final = 0.5
#: Most rows per second of a slow device; a driver that ignores its interval gives many more.
MOST_HZ: Final = 100.0
RATE_S: Final = 0.5
#: For so long after the device is dead, run() may still emit rows that arrived before, in s.
TAIL_S: Final = 0.5
#: How long after a row run() has asked for the next one and waits for it, in s.
WAITS_S: Final = 0.3
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

    def __init__(self, wanted: int = ROWS) -> None:
        self._wanted = wanted
        self.rows: list[Sequence[float]] = []
        self.last_s = time.monotonic()
        self._enough = asyncio.Event()

    def __call__(self, row: Sequence[float]) -> None:
        self.rows.append(row)
        self.last_s = time.monotonic()
        if len(self.rows) >= self._wanted:
            self._enough.set()

    async def enough(self, driver: SlowDriver, task: asyncio.Task[None]) -> None:
        """Wait for some rows.

        Raises:
            UnfitSubject: they do not come.

        """
        waiting = asyncio.ensure_future(self._enough.wait())
        try:
            await asyncio.wait(
                {waiting, task}, timeout=self._wanted * driver.declaration.silent_s + ROOM_S,
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
            raise UnfitSubject(f"{len(self.rows)} rows in {self._wanted} times silent_s")


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
    await driver.close()
    with Stalls() as stalls:
        await _opened(driver)
        rows = _Rows(MORE_ROWS)
        task = asyncio.create_task(driver.run(rows))
        try:
            await rows.enough(driver, task)
        except UnfitSubject:
            if not _stands(stalls):  # else that is why they are too few
                raise
        if not task.done():
            await _stop(task, problems)
        await stalls.stop()
    if _stands(stalls):
        problems.add(
            f"the event loop stood still {len(stalls.found)} times, {max(stalls.found):.2f} s at "
            "most, while a thread beside it went on"
        )


def _stands(stalls: Stalls) -> bool:
    return len(stalls.found) >= STALLS or sum(stalls.found) >= STANDS_S


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


async def _cancelled_waiting(driver: SlowDriver, peer: Peer, problems: Problems) -> None:
    rows = _Rows()
    task = asyncio.create_task(driver.run(rows))
    await rows.enough(driver, task)
    peer.faults["silent"]()
    while not task.done() and time.monotonic() < rows.last_s + driver.declaration.silent_s:
        await asyncio.sleep(0.02)
        if time.monotonic() > rows.last_s + WAITS_S:  # it has asked, and waits for the answer
            break
    if not task.done():
        await _stop(task, problems)


async def _rate(driver: SlowDriver, peer: Peer, problems: Problems) -> None:
    rows = _Rows()
    task = asyncio.create_task(driver.run(rows))
    await rows.enough(driver, task)
    before, began = len(rows.rows), time.monotonic()
    await asyncio.wait({task}, timeout=RATE_S)
    hz = (len(rows.rows) - before) / (time.monotonic() - began)
    if hz > MOST_HZ * (1 + ROOM_S):
        problems.add(f"run() gives {hz:.0f} rows per second, at most {MOST_HZ:g} are meant")
    await _stop(task, problems)


async def _true_rows(driver: SlowDriver, peer: Peer, problems: Problems) -> None:
    before = peer.look()
    if not before.measured:
        return
    rows = _Rows()
    task = asyncio.create_task(driver.run(rows))
    await rows.enough(driver, task)
    await _stop(task, problems)
    after = peer.look()
    still = {k: v for k, v in after.measured.items() if before.measured[k] == v}
    problems.update(untrue(driver.declaration, rows.rows[-1], [still]))


async def _repeated(driver: SlowDriver, peer: Peer, problems: Problems) -> None:
    before = peer.look().sent
    if before is None:
        return
    rows = _Rows(MORE_ROWS)
    task = asyncio.create_task(driver.run(rows))
    await rows.enough(driver, task)
    await _stop(task, problems)
    sent = (peer.look().sent or 0) - before
    if len(rows.rows) > sent:
        problems.add(f"run() gives {len(rows.rows)} rows, and the device sent {sent} readings")


async def _acted(driver: SlowDriver, peer: Peer, problems: Problems) -> None:
    for action in driver.declaration.actions:
        before = peer.look().acted
        if before is None:
            return
        await asyncio.wait_for(driver.act(action), SCENE_S / 4)
        if list(peer.look().acted or ()) != [*before, action]:
            problems.add(f"act({action!r}) returns, and the device has not done it")


async def _quiet(driver: SlowDriver, peer: Peer, problems: Problems) -> None:
    rows = _Rows()
    task = asyncio.create_task(driver.run(rows))
    await rows.enough(driver, task)
    await _stop(task, problems)
    given = len(rows.rows)
    await driver.close()
    await asyncio.sleep(TAIL_S / 2)  # what is under way arrives
    before = peer.look().sent
    await asyncio.sleep(TAIL_S / 2)
    if len(rows.rows) > given:
        problems.add("run() still gives rows after it was cancelled")
    if peer.look().sent != before:
        problems.add("the device goes on sending after close()")


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
        if fault == "dead" and not task.done():
            waited = TAIL_S + 2 * driver.declaration.silent_s
            problems.add(f"{waited:g} s after the device is dead run() has not raised")
        await _ended(task, problems)

    return play


def _bad_answers(fault: str, *, may_emit: bool) -> Scene:
    async def play(driver: SlowDriver, peer: Peer, problems: Problems) -> None:
        rows = _Rows()
        task = asyncio.create_task(driver.run(rows))
        await rows.enough(driver, task)
        peer.faults[fault]()
        began = time.monotonic()
        await asyncio.wait({task}, timeout=1.0 + driver.declaration.silent_s)
        if not may_emit and rows.last_s > began + TAIL_S:
            problems.add(f"run() gives rows though what the device sends is {fault}")
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
        "actions are done",
        "act() returns when the device has done the action",
        _scene(_acted),
        "",
        observes=True,
    ),
    Rule(
        "rows are true",
        "a row has what the device measures, in the unit of its channel: check factor and sign",
        _scene(_true_rows),
        "",
        observes=True,
    ),
    Rule(
        "no row twice",
        "emit a row only when the device has sent a new reading; never the last one again",
        _scene(_repeated),
        "",
        observes=True,
    ),
    Rule(
        "quiet after close",
        "close() ends every task and stream of run(): the device sends nothing more",
        _scene(_quiet),
        "",
    ),
    Rule(
        "not too often",
        "wait from one reading to the next, as long as the options give: 100 rows per second at "
        "most",
        _scene(_rate),
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
        "with the link dead run() raises a LinkError or DeviceError, within 2 silent_s",
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
        "cancelled while it waits",
        "let CancelledError pass out of run() while it waits for an answer, each time",
        _scene(_cancelled_waiting),
        "silent",
    ),
    Rule(
        "late",
        "an answer that is late is waited for within a bound, or raises a DeviceError",
        _scene(_bad_answers("late", may_emit=True)),
        "late",
    ),
    Rule(
        "garbled",
        "damaged answers are thrown away or raise a ProtocolError; they never become rows",
        _scene(_bad_answers("garbled", may_emit=False)),
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
        "open() of a device that sends damaged answers raises at most a ProtocolError or LinkError",
        _scene(_opens_in_words("garbled"), opened=False),
        "garbled",
    ),
)
