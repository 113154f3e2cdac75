"""Checks block drivers against the rules on which their helper process depends.

The library of a block device returns many rows at once; a helper process calls it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any, Final

import numpy as np

from rigd.sdk.check.caller import Caller
from rigd.sdk.check.peer import Peer
from rigd.sdk.check.rows import beyond_range, untrue
from rigd.sdk.check.subject import FAILURES, Rule, Subject, UnfitSubject, described
from rigd.sdk.driver import Block, BlockDriver

#: Time limit of open(), in s: it may wait for a device that does not answer.
OPEN_S: Final = 30.0
#: The time-out given to read_block, and how much longer it may take, in s.
TIMEOUT_S: Final = 0.2
ROOM_S: Final = 1.0
#: Blocks of the measurements, and how long they may take, in s.
BLOCKS: Final = 5
BLOCKS_S: Final = 5.0
#: For so long after the device is dead, read_block may still return buffered rows, in s.
TAIL_S: Final = 1.0
#: For so long the times of rows are compared with the times at which they come, in s.
GATHER_S: Final = 1.5
#: They may span so much more or less: blocks come late, machines stall.
GATHER_PART: Final = 0.3
#: Crystals are much better than this part of their rate.
TIMES_PART: Final = 0.01
#: A gap is longer than so many periods.
LOST_PERIODS: Final = 1.5


class BlockBench:
    """One block driver, called as its helper process calls it."""

    def __init__(self, driver: BlockDriver, caller: Caller, peer: Peer) -> None:
        self.driver = driver
        self.call = caller.call
        #: Returns what the device does now.
        self.look = peer.look

    def must(self, what: str, function: Callable[[], Any]) -> Any:
        """Return the value of a call that a rule presupposes."""
        outcome = self.call(function, OPEN_S)
        if outcome.error is not None:
            raise UnfitSubject(f"{what} raises {described(outcome.error)}")
        return outcome.value

    def read(self) -> Any:
        """Return how one read_block ended; it may take its time-out."""
        return self.call(lambda: self.driver.read_block(TIMEOUT_S), OPEN_S)

    def next(self) -> Any:
        """Return the block of one read_block; None if it has no rows.

        Raises:
            UnfitSubject: it raises, or returns something else.
        """
        block = self.must("read_block", lambda: self.driver.read_block(TIMEOUT_S))
        if block is None:
            return None
        shape = getattr(getattr(block, "values", None), "shape", ())
        if len(shape) != 2:  # n rows, k columns
            raise UnfitSubject(f"read_block returns {type(block).__name__} of {shape}")
        return block if len(block.values) else None


@contextmanager
def bench(subject: Subject, fault: str = "") -> Iterator[tuple[BlockBench, Callable[[], object]]]:
    """Put a new driver, open and started, before a new device; also yield what begins ``fault``."""
    with subject.fresh_peer() as peer, Caller() as caller:
        found = BlockBench(subject.make(peer, peer.link()), caller, peer)
        found.must("open", found.driver.open)
        found.must("start", found.driver.start)
        try:
            yield found, peer.faults.get(fault, lambda: None)
        finally:
            caller.call(found.driver.close, OPEN_S)


def _opens(subject: Subject) -> Iterator[str]:
    with bench(subject) as (found, _):
        rate = found.driver.rate_hz
        if not (np.isfinite(rate) and rate > 0):
            yield f"rate_hz is {rate} once it is open"


def _blocks(subject: Subject) -> Iterator[str]:
    with bench(subject) as (found, _):
        blocks: list[Block] = []
        end = time.monotonic() + BLOCKS_S
        while len(blocks) < BLOCKS and time.monotonic() < end:
            outcome = found.read()
            if outcome.error is not None:
                yield f"read_block raises {described(outcome.error)}"
                return
            if outcome.value is not None and _rows_of(outcome.value) != 0:
                blocks.append(outcome.value)
        if not blocks:
            yield f"no block with rows in {BLOCKS_S:g} s"
            return
        problems = [problem for block in blocks for problem in _block_problems(found.driver, block)]
        yield from sorted(set(problems))
        if not problems:
            times = np.concatenate([block.times_ns for block in blocks])
            if np.any(np.diff(times) <= 0):
                yield "the times of the rows do not increase from row to row, block to block"
            now_ns = time.monotonic_ns()
            if abs(now_ns - int(times[-1])) > 60e9:
                yield f"the last row is of {times[-1]} ns, CLOCK_MONOTONIC stands at {now_ns} ns"


def _rows_of(block: object) -> int | None:
    """Return the number of rows of a block; None if it is no block."""
    return len(block.times_ns) if isinstance(block, Block) else None


def _block_problems(driver: BlockDriver, block: object) -> Iterator[str]:
    channels = driver.declaration.channels
    columns = len(channels) + driver.declaration.has_status
    if not isinstance(block, Block):
        yield f"read_block returns {type(block).__name__}, expected a Block or None"
        return
    times, values = block.times_ns, block.values
    if times.dtype != np.int64 or times.ndim != 1:
        yield f"times_ns is {times.dtype} of shape {times.shape}, expected int64 of (n,)"
    if values.dtype != np.float64 or values.shape != (len(times), columns):
        yield (
            f"values is {values.dtype} of shape {values.shape}, expected float64 of "
            f"({len(times)}, {columns})"
        )
    elif not np.all(np.isfinite(values)):
        yield "a healthy device gives values that are not finite"
    else:
        for channel, column in zip(channels, values.T, strict=False):
            beyond = column[(column < channel.low) | (column > channel.high)]
            if len(beyond):
                yield beyond_range(channel, beyond[0])


def _gathered(found: BlockBench, for_s: float) -> tuple[list[Block], list[int]]:
    """Return the blocks of a while, and the CLOCK_MONOTONIC times at which they came, in ns.

    Raises:
        UnfitSubject: they do not come.

    """
    blocks: list[Block] = []
    came_ns: list[int] = []
    end = time.monotonic() + for_s
    latest = time.monotonic() + BLOCKS_S
    while time.monotonic() < (end if len(blocks) > 1 else latest):
        block = found.next()
        if block is not None:
            blocks.append(block)
            came_ns.append(time.monotonic_ns())
    if len(blocks) < 2:  # an interval has two ends
        raise UnfitSubject(f"{len(blocks)} blocks in {BLOCKS_S:g} s")
    return blocks, came_ns


def _times(subject: Subject) -> Iterator[str]:
    with bench(subject) as (found, _):
        blocks, came_ns = _gathered(found, GATHER_S)
        times = np.concatenate([block.times_ns for block in blocks])
        period_s = float(np.median(np.diff(times))) * 1e-9
        if not abs(period_s * found.driver.rate_hz - 1) <= TIMES_PART:
            yield (
                f"the rows are {period_s * 1e3:g} ms apart, and rate_hz is "
                f"{found.driver.rate_hz:g} Hz"
            )
        taken_s = float(times[-1] - blocks[0].times_ns[-1]) * 1e-9
        came_s = (came_ns[-1] - came_ns[0]) * 1e-9
        if not abs(taken_s - came_s) <= GATHER_PART * came_s:
            yield f"the rows of {came_s:.2f} s have times that span {taken_s:.2f} s"
        newest = [block.times_ns[-1] for block in blocks]
        ages = [(now - int(last)) * 1e-9 for now, last in zip(came_ns, newest, strict=True)]
        if min(ages) < 0:
            yield f"the times of rows are up to {-min(ages):.3g} s after they came"
        if min(ages) > found.driver.declaration.silent_s:
            yield f"rows are {min(ages):.3g} s old when they come"


def _true_rows(subject: Subject) -> Iterator[str]:
    with bench(subject) as (found, _):
        before = found.look()
        if not before.measured and before.sent is None:
            return
        blocks, _ = _gathered(found, 0.0)
        rows = sum(len(block.times_ns) for block in blocks)
        after = found.look()
        still = {k: v for k, v in after.measured.items() if before.measured[k] == v}
        yield from untrue(found.driver.declaration, blocks[-1].values[-1].tolist(), [still])
        if after.sent is not None and rows > after.sent:
            yield f"read_block() gives {rows} rows, and the device has sent {after.sent}"


def _lossy(subject: Subject) -> Iterator[str]:
    with bench(subject, "lossy") as (found, begin):
        blocks, _ = _gathered(found, 0.0)
        begin()
        end = time.monotonic() + TAIL_S + found.driver.declaration.silent_s
        while time.monotonic() < end:
            outcome = found.read()
            if isinstance(outcome.error, FAILURES):
                return
            if outcome.error is not None:
                yield f"read_block raises {described(outcome.error)}"
                return
            if outcome.value is not None:
                blocks.append(outcome.value)
        gaps = np.diff(np.concatenate([block.times_ns for block in blocks]))
        if np.max(gaps) < LOST_PERIODS * np.median(gaps):
            yield "samples were lost, read_block() raises nothing, and the times show no gap"


def _quiet(subject: Subject) -> Iterator[str]:
    with bench(subject) as (found, _):
        if found.look().sent is None:
            return
        _gathered(found, 0.0)
        found.call(found.driver.close, OPEN_S)
        time.sleep(TAIL_S / 4)  # what is under way arrives
        before = found.look().sent
        time.sleep(TAIL_S / 4)
        if found.look().sent != before:
            yield "the device goes on sending after close()"


def _garbled_at_open(subject: Subject) -> Iterator[str]:
    with subject.fresh_peer() as peer, Caller() as caller:
        peer.faults["garbled"]()
        driver = subject.make(peer, peer.link())
        for name, step in (("open", driver.open), ("close", driver.close)):
            outcome = caller.call(step, OPEN_S)
            known = FAILURES if name == "open" else ()
            if outcome.error is not None and not isinstance(outcome.error, known):
                yield f"{name}() raises {described(outcome.error)}"


def _newest_row(subject: Subject) -> Iterator[str]:
    with bench(subject) as (found, _):
        end = time.monotonic() + BLOCKS_S
        block: Any = None
        while block is None and time.monotonic() < end:
            block = found.next()
        if block is None:
            raise UnfitSubject(f"no block in {BLOCKS_S:g} s")
        declared = found.driver.declaration
        columns = len(declared.channels) + declared.has_status
        shortest = Block(block.times_ns[-1:], block.values[-1:])
        for given in (block, shortest):
            outcome = found.call(partial(found.driver.newest_row, given), OPEN_S)
            rows = len(given.times_ns)
            if outcome.error is not None:
                yield f"newest_row of a block of {rows} raises {described(outcome.error)}"
            elif np.shape(outcome.value) != (columns,):
                given_values = np.size(outcome.value)
                yield f"newest_row gives {given_values} values, expected {columns}"


def _timeout(subject: Subject) -> Iterator[str]:
    with bench(subject) as (found, _):
        for _ in range(BLOCKS):
            took_s = found.read().took_s
            if took_s > TIMEOUT_S + ROOM_S:
                yield f"read_block({TIMEOUT_S:g}) takes {took_s:.1f} s"
                return


def _opened_twice(subject: Subject) -> Iterator[str]:
    with bench(subject) as (found, _):
        again = found.call(found.driver.open, OPEN_S)
        if again.error is not None and not isinstance(again.error, FAILURES):
            yield f"open() of an open driver raises {described(again.error)}"


def _closed_twice(subject: Subject) -> Iterator[str]:
    with bench(subject) as (found, _):
        found.read()
        for turn in ("close", "close again"):
            outcome = found.call(found.driver.close, OPEN_S)
            if outcome.error is not None:
                yield f"{turn} raises {described(outcome.error)}"


def _reopens(subject: Subject) -> Iterator[str]:
    with subject.fresh_peer() as peer, Caller() as caller:
        for turn in ("first", "second"):
            driver = subject.make(peer, peer.link())
            outcome = caller.call(driver.open, OPEN_S)
            if outcome.error is not None:
                yield f"the {turn} of two drivers, one after the other: {described(outcome.error)}"
            caller.call(driver.close, OPEN_S)


def _lost(fault: str) -> Callable[[Subject], Iterator[str]]:
    def check(subject: Subject) -> Iterator[str]:
        with bench(subject, fault) as (found, begin):
            found.read()
            begin()
            began = time.monotonic()
            lost = False
            end = began + TAIL_S + 2 * found.driver.declaration.silent_s
            while time.monotonic() < end:
                outcome = found.read()
                if outcome.error is not None:
                    if not isinstance(outcome.error, FAILURES):
                        yield f"read_block raises {described(outcome.error)}"
                    lost = True
                    break
                if fault != "dead" and outcome.took_s > TIMEOUT_S + ROOM_S:
                    yield f"read_block({TIMEOUT_S:g}) takes {outcome.took_s:.1f} s"
                    break
                if _rows_of(outcome.value) and time.monotonic() > began + TAIL_S:
                    yield f"read_block still gives rows {TAIL_S:g} s after the device is {fault}"
                    break
            if fault == "dead" and not lost:
                yield f"{time.monotonic() - began:.1f} s after it read_block has not raised"
            for turn in ("close", "close again"):
                outcome = found.call(found.driver.close, OPEN_S)
                if outcome.error is not None:
                    yield f"{turn} raises {described(outcome.error)}"

    return check


def _not_there(subject: Subject) -> Iterator[str]:
    with subject.fresh_peer() as peer, Caller() as caller:
        peer.faults["dead"]()
        driver = subject.make(peer, peer.link())
        outcome = caller.call(driver.open, OPEN_S)
        if outcome.error is None:
            yield "open() succeeds although nothing is connected"
        elif not isinstance(outcome.error, FAILURES):
            yield f"open() raises {described(outcome.error)}"
        elif outcome.error.hint is None:
            yield f"open() raises {outcome.error.message!r} without a hint"
        closed = caller.call(driver.close, OPEN_S)
        if closed.error is not None:
            yield f"close() after that raises {described(closed.error)}"


#: If the first rule is broken, the others are not checked.
RULES: Final = (
    Rule(
        "opens and starts",
        "open() and start() a healthy device; rate_hz is known from then on",
        _opens,
        "",
    ),
    Rule(
        "blocks",
        "read_block() returns a Block: int64 times of CLOCK_MONOTONIC in ns, increasing, and "
        "float64 values with a column per channel, within its range, the status last if it has one",
        _blocks,
        "",
    ),
    Rule(
        "times are true",
        "times_ns are when the rows were taken: 1 / rate_hz apart, as long as they take to come, "
        "and never after they came",
        _times,
        "",
    ),
    Rule(
        "rows are true",
        "a row has what the device measures, in the unit of its channel: check factor and sign; "
        "and none comes twice",
        _true_rows,
        "",
        observes=True,
    ),
    Rule(
        "newest row",
        "newest_row(block) returns a value per column, also of a block of a single row",
        _newest_row,
        "",
    ),
    Rule("time-out", "read_block() waits no longer than its time-out", _timeout, ""),
    Rule(
        "opened twice",
        "open() of an open driver does nothing, or raises a LinkError",
        _opened_twice,
        "",
    ),
    Rule("quiet after close", "close() ends the stream of the device", _quiet, "", observes=True),
    Rule("closed twice", "close() may come twice, silently", _closed_twice, ""),
    Rule("lets go", "close() lets go of the device: the next session opens it", _reopens, ""),
    Rule(
        "dead",
        "with the device gone read_block() raises a LinkError or DeviceError within 2 silent_s",
        _lost("dead"),
        "dead",
    ),
    Rule(
        "silent",
        "with the device silent read_block() returns None at its time-out or raises a DeviceError",
        _lost("silent"),
        "silent",
    ),
    Rule(
        "garbled",
        "damaged packets are thrown away or raise a ProtocolError; they never become rows",
        _lost("garbled"),
        "garbled",
    ),
    Rule(
        "frozen",
        "a packet that was seen before gives no rows: compare the counter that it carries",
        _lost("frozen"),
        "frozen",
    ),
    Rule(
        "lossy",
        "raise a DeviceError if samples were lost, or leave a gap in the times",
        _lossy,
        "lossy",
    ),
    Rule(
        "garbled at open",
        "open() of a device that sends damaged answers raises at most a ProtocolError or LinkError",
        _garbled_at_open,
        "garbled",
    ),
    Rule(
        "not there",
        "open() without a device raises a LinkError with a hint: what to check",
        _not_there,
        "dead",
    ),
)
