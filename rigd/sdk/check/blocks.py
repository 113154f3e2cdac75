"""Checks block drivers against the rules on which their helper process depends.

The library of a block device returns many rows at once; a helper process calls it. Sequences of
calls are played with a healthy device: what a block holds, the device has measured, at the times of
its rows, each row once and none left out.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from typing import Any, Final

import numpy as np

from rigd.sdk.check.caller import CLOSES_S, OPEN_S, TAIL_S, Caller, CallOutcome
from rigd.sdk.check.leaks import kept_for_good, nothing_left
from rigd.sdk.check.peer import Peer
from rigd.sdk.check.rows import Matching, beyond_range
from rigd.sdk.check.sequences import (
    VALUES,
    DrawnTrial,
    DrawValue,
    KindOfStep,
    RandomWalk,
    SequenceDrawing,
    StepFailed,
    check_identity,
    expect,
    first_failure,
    in_turn,
    made,
    surely,
)
from rigd.sdk.check.subject import FAILURES, Rule, Subject, described
from rigd.sdk.check.watching import Watcher, until
from rigd.sdk.driver import Block, BlockDriver

#: The time-out given to read_block, and how much longer it may take, in s.
TIMEOUT_S: Final = 0.2
ROOM_S: Final = 0.6
#: Another time-out, in s, which is shorter than the time from one block to the next.
SHORT_S: Final = 0.005
KEPT_CALLS: Final = 3
#: Blocks of the measurements, and how long they may take, in s.
BLOCKS: Final = 5
BLOCKS_S: Final = 3.0
#: The rows of a block are of the time since the block before, and so much older or newer, in s.
AGE_S: Final = 0.06
#: The newest row may be so much older than `oldest_s` when it comes, in s.
OLD_S: Final = 0.25
#: A row that comes later than this after the device has sent it is kept back, in s.
KEPT_S: Final = 0.03
#: Once it has sampled for so long, in s, its rate is known.
GATHER_S: Final = 1.2
#: Crystals are much better than this part of their rate.
TIMES_PART: Final = 0.01
#: Of a block with so many rows the cycle sees one of the second half, or a median of some.
RISING_ROWS: Final = 20
#: A gap is longer than so many periods.
LOST_PERIODS: Final = 1.5
#: Sequences of one examination, and the steps of each.
TRIALS: Final = 4
STEPS: Final = 18
#: How long nothing is read in a pause, and for how long what is closed is looked at, twice, in s.
PAUSE_S: Final = 0.4
ENDS_S: Final = 0.12
#: Faults that a device has for a while, in s.
FAULTS_THAT_END: Final = ("cut", "garbled", "dead", "silent", "lossy", "late")
FAULT_S: Final = 0.3
#: What a device that was late has sent has come after this time, in s.
LATE_S: Final = 2.0
#: A time may be so many periods from when the device measured, but for the time that the command
#: to begin takes; a machine that stood still for so many says nothing about that. The first rows
#: have come after this time, in s.
STAMP_PERIODS: Final = 0.5
STILL_PERIODS: Final = 0.4
BEGINS_S: Final = 0.1


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


#: States: closed, open, started.
CALLS: Final[Mapping[str, KindOfStep]] = {
    "open": KindOfStep("closed", 1, "open"),
    "open again": KindOfStep("open", 0.3, "closed", 1),
    "start": KindOfStep("open", 4, "started"),
    "read blocks": KindOfStep("started", 4.5),
    "measure": KindOfStep("started", 4),
    "pause": KindOfStep("started", 1.5),
    "newest row": KindOfStep("started", 1.0),
    "fail": KindOfStep("started", 1.0, "started", 2, "faults"),
    "close": KindOfStep("open started", 2.5, "closed"),
    "new driver": KindOfStep("closed", 0.1),
    # Those that are not drawn.
    "fail for long": KindOfStep("started", 0.0, "closed"),
    "keep nothing": KindOfStep("started", 0.0),
}


#: What comes before a fault.
SAMPLES: Final = (("open",), ("start",), ("read blocks",))


def any_order(subject: Subject) -> Iterator[str]:
    """Play sequences of calls until one shows a fault; see :data:`CALLS`."""
    values: dict[str, DrawValue] = dict.fromkeys(("start", "pause"), VALUES["measure"])
    values["read blocks"] = lambda _, rng: rng.choice((TIMEOUT_S, SHORT_S))
    trials = SequenceDrawing(subject, CALLS, values, FAULTS_THAT_END).trials(TRIALS, STEPS)
    yield from first_failure(partial(_play, subject), trials, subject.notes)


def _play(subject: Subject, trial: DrawnTrial) -> None:
    drawn = replace(subject, more=trial.options, varied=trial.seed)
    other = replace(drawn, varied=f"{trial.seed} beside")
    with (
        nothing_left(),
        drawn.fresh_peer() as peer,
        other.fresh_peer() if trial.beside else nullcontext() as beside,
        Caller() as caller,
    ):
        # What they leave open stays to be seen.
        others = [] if beside is None else [_Played(other, beside, caller)]
        played = _Played(drawn, peer, caller)
        played.play(trial, others)


class _Played:
    """Makes the calls of a sequence, and compares what comes with what the device has sent."""

    def __init__(self, subject: Subject, peer: Peer, caller: Caller) -> None:
        self._subject = subject
        self._peer = peer
        self._caller = caller
        self._all: list[BlockDriver] = []
        self._new_driver()
        self._oldest_s = self._driver.declaration.oldest_s
        self._watcher = Watcher(peer)
        self._readings = Matching(peer, self._driver.declaration, self._watcher.held)
        self._offsets: list[float] = []  # of times of rows from those of the device, in s
        self._gap_s = 0.0  # for how long this machine stood still at the start
        self._kept: list[int] = []  # of the last blocks: how many readings did not come with it
        self._ages: list[float] = []
        self._steps: list[float] = []  # from row to row, in ns
        self._dry: list[float] = []  # when calls in a row began that gave none of the rows sent
        self._last_ns = 0
        self._before: tuple[Block, Block] | None = None  # the last block, and a copy of it

    def play(self, trial: DrawnTrial, beside: Sequence[_Played] = ()) -> None:
        """Make the calls, and read from others beside it, each before a device of its own.

        Raises:
            StepFailed: the driver breaks a promise.
            Unjudged: it may be the machine, or the options.
        """
        walk = RandomWalk(trial, CALLS)
        with self._watcher:
            try:
                with walk.judged(self._watcher.stalls):
                    for other in beside:
                        other.begin(self._watcher)
                    for step in walk:
                        made(self, step)
                        for other in beside:
                            other.go_on(2)
            finally:
                for played in (*beside, self):
                    played.end()

    def begin(self, watcher: Watcher) -> None:
        """Begin to sample, beside another; ``watcher`` sees whether this machine stalls."""
        self._watcher = watcher
        self._open()
        self._start()

    def end(self) -> None:
        """Close it."""
        self._caller.call(self._driver.close, OPEN_S)

    # The calls of each step.

    def _open(self) -> None:
        self._must("open", self._driver.open)
        check_identity(self._driver, self._peer.look())

    def _open_again(self) -> None:
        error = self._caller.call(self._driver.open, OPEN_S).error
        if error is not None and not isinstance(error, FAILURES):
            raise StepFailed(f"open() of an open driver raises {described(error)}")
        self._close()

    def _start(self, values: Mapping[str, float] | None = None) -> None:
        if values and self._peer.measure is not None:
            self._peer.measure(values)
        self._readings.begin()
        self._last_ns, self._steps, self._offsets, self._dry = 0, [], [], []
        self._began_ns, self._watcher.gap_s = time.monotonic_ns(), 0.0
        before = self._readings.sent
        self._must("start", self._driver.start)
        until(lambda: self._readings.sent > before, BEGINS_S)
        self._gap_s = self._watcher.gap_s
        rate = self._driver.rate_hz
        if not (np.isfinite(rate) and rate > 0):
            raise surely(f"rate_hz is {rate} once it is open")

    def _read_blocks(self, timeout_s: float = TIMEOUT_S) -> None:
        self.go_on(BLOCKS, timeout_s)

    def go_on(self, count: int, timeout_s: float = TIMEOUT_S) -> None:
        """Read so many blocks, and check them."""
        blocks, end = 0, time.monotonic() + BLOCKS_S
        late = ""
        while blocks < count or late:  # what was late before a pause comes first
            if blocks % count == 0:
                self._kept, self._ages = [], []
            if self._read(timeout_s):
                blocks += 1
                late = self._late() if blocks % count == 0 else late
            if time.monotonic() > end:
                problem = late or f"{blocks} blocks with rows in {BLOCKS_S:g} s"
                raise StepFailed(problem) if blocks else surely(problem)
        off_s = float(np.median(self._offsets)) if self._offsets else 0.0
        period_s = 1.0 / self._driver.rate_hz
        if abs(off_s) > STAMP_PERIODS * period_s and self._gap_s < STILL_PERIODS * period_s:
            raise StepFailed(
                f"the time of a row is {off_s / period_s:.2g} periods from when it was measured"
            )
        span_s = (time.monotonic_ns() - self._began_ns) * 1e-9
        apart_s, rate_hz = float(np.median(self._steps)) * 1e-9, self._driver.rate_hz
        if span_s > GATHER_S and not abs(apart_s * rate_hz - 1) <= TIMES_PART:
            raise StepFailed(
                f"the rows are {apart_s * 1e3:g} ms apart, and rate_hz is {rate_hz:g} Hz"
            )

    def _read(self, timeout_s: float) -> bool:
        """Read a block, and check it; return whether it has rows."""
        due, began_s = self._readings.waiting, time.monotonic()
        outcome = self._caller.call(partial(self._driver.read_block, timeout_s), OPEN_S)
        block = expect("read_block", outcome)
        _in_time(outcome)
        is_empty = block is None or (isinstance(block, Block) and not len(block.times_ns))
        self._dry = [*self._dry, began_s] if due and is_empty else []
        since_s = (self._dry or [began_s])[0]
        kept_s = time.monotonic() - since_s
        most_s = self._oldest_s + (KEPT_S if len(self._dry) >= KEPT_CALLS else TIMEOUT_S / 2)
        if due and self._watcher.held.exceeds(kept_s, most_s, since_s):
            raise StepFailed(f"rows that were sent do not come for {kept_s:.2g} s")
        if is_empty:
            return False
        self._check(block)
        return True

    def _late(self) -> str:
        """Return why the last blocks come too late; "" if they do not."""
        if self._kept and min(self._kept) > self._driver.rate_hz * (self._oldest_s + KEPT_S):
            return f"at least {min(self._kept)} rows that were sent do not come"
        if min(self._ages) > self._oldest_s + OLD_S:
            return f"rows are {min(self._ages):.3g} s old when they come"
        return ""

    def _measure(self, values: Mapping[str, float], pause_s: float = 0.0) -> None:
        time.sleep(pause_s / 2)
        if self._peer.measure is not None:
            self._peer.measure(values)
        time.sleep(pause_s / 2)
        self._read_blocks()

    def _pause(self, values: Mapping[str, float]) -> None:
        self._measure(values, PAUSE_S)

    def _fail_for_long(self, fault: str) -> None:
        self._failing(fault, TAIL_S + 2 * self._driver.declaration.silent_s)

    def _fail(self, fault: str) -> None:
        """Have the device fail for a while; opened again, the driver is as before."""
        self._failing(fault, LATE_S if fault == "late" else FAULT_S)
        self._peer.mended(fault)
        self._must("open once the fault is over", self._driver.open)
        self._start()
        self._read_blocks()

    def _failing(self, fault: str, for_s: float) -> None:
        """Read from a device that fails, and close it."""
        self._peer.faults[fault]()
        times, began_s = [self._last_ns], time.monotonic()
        error: BaseException | None = None
        while error is None and (since_s := time.monotonic() - began_s) < for_s:
            if fault == "late" and since_s > FAULT_S:
                self._peer.mended(fault)
            outcome = self._caller.call(partial(self._driver.read_block, TIMEOUT_S), OPEN_S)
            error = outcome.error
            if error is None and fault != "dead":
                _in_time(outcome)
            if error is None and len(getattr(outcome.value, "times_ns", ())):
                times += outcome.value.times_ns.tolist()
                if fault == "late":
                    self._check(outcome.value)
                elif since_s > TAIL_S and fault != "lossy":
                    raise surely(
                        f"read_block still gives rows {TAIL_S:g} s after the device is {fault}"
                    )
        if error is not None and not isinstance(error, FAILURES):
            raise surely(f"while the device is {fault}, read_block raises {described(error)}")
        if error is None and fault == "dead" and for_s > TAIL_S:
            raise surely(f"{for_s:.1f} s after it read_block has not raised")
        if error is None and fault == "lossy":
            gaps = np.diff(times)
            if np.max(gaps) < LOST_PERIODS * np.median(gaps):
                raise surely("samples are lost, it raises nothing, and the times show no gap")
        self._end()

    def _end(self) -> None:
        for turn in ("close", "close again"):
            outcome = self._caller.call(self._driver.close, OPEN_S)
            expect(turn, outcome)
            if outcome.took_s > CLOSES_S:
                raise StepFailed(f"{turn} takes {outcome.took_s:.1f} s")

    def _keep_nothing(self) -> None:
        read = partial(self._driver.read_block, TIMEOUT_S)
        go_on = partial(self._caller.call, read, OPEN_S)
        for problem in kept_for_good(self._driver, self._peer, 3 * BLOCKS, go_on):
            raise StepFailed(problem)

    def _newest_row(self) -> None:
        self._read_blocks()
        block, declared = self._block, self._driver.declaration
        columns = len(declared.channels) + declared.has_status
        shortest = Block(block.times_ns[-1:], block.values[-1:])
        rising = _rising(block, len(declared.channels))
        for given in (block, shortest, rising):
            rows = len(given.times_ns)
            outcome = self._caller.call(partial(self._driver.newest_row, given), OPEN_S)
            expect(f"newest_row of a block of {rows}", outcome)
            if np.shape(outcome.value) != (columns,):
                raise StepFailed(
                    f"newest_row gives {np.size(outcome.value)} values, expected {columns}"
                )
        for channel, value, column in zip(
            declared.channels, outcome.value, rising.values.T, strict=False
        ):
            if value < column[rows // 2]:
                late = (column[-1] - value) / (column[1] - column[0])
                raise StepFailed(
                    f"newest_row has {channel.name} of {late:.0f} rows before the last"
                )

    def _close(self) -> None:
        self._end()
        time.sleep(ENDS_S)  # what is under way arrives
        before = self._readings.sent
        time.sleep(ENDS_S)
        if self._readings.sent != before:
            raise StepFailed("the device goes on sending after close()")

    def _new_driver(self) -> None:
        self._driver: BlockDriver = self._subject.make(self._peer, self._peer.link())
        self._all.append(self._driver)  # what it leaves open stays to be seen

    # What must hold.

    def _must(self, what: str, function: Callable[[], Any]) -> Any:
        return expect(what, self._caller.call(function, OPEN_S))

    def _check(self, block: Block) -> None:
        """Check a block that came just now."""
        now_ns = time.monotonic_ns()
        for problem in _block_problems(self._driver, block):
            raise StepFailed(problem)
        if self._before is not None:
            before, as_it_came = self._before
            if not (
                np.array_equal(before.times_ns, as_it_came.times_ns)
                and np.array_equal(before.values, as_it_came.values)
            ):
                raise StepFailed("the block before changes when the next one is read")
        self._block = block
        self._before = block, Block(block.times_ns.copy(), block.values.copy())
        times, period_ns = block.times_ns, 1e9 / self._driver.rate_hz
        if self._peer.readings is not None:
            kept = self._readings.waiting - len(times)
            if kept < 0:
                raise StepFailed(f"{-kept} rows more than the device has sent")
            self._kept.append(kept)
            for at_ns, (taken_s, problem) in zip(
                times, self._readings.compare_next(block.values.tolist()), strict=True
            ):
                if problem:
                    raise StepFailed(problem)
                self._offsets.append(at_ns * 1e-9 - taken_s)
        if self._last_ns:
            times = np.concatenate([[self._last_ns], times])
        steps = np.diff(times)
        if np.any(steps <= 0):
            raise StepFailed(
                "the times of the rows do not increase from row to row, block to block"
            )
        self._steps += steps.tolist()
        if len(steps) and np.max(steps) > LOST_PERIODS * period_ns:
            raise StepFailed("the times have a gap, and the device has lost nothing")
        self._last_ns = int(times[-1])
        age_s = (now_ns - self._last_ns) * 1e-9
        if age_s < 0:
            raise StepFailed(f"the times of rows are {-age_s:.3g} s after they came")
        if times[0] < self._began_ns - AGE_S * 1e9:
            raise StepFailed("a row is of a time before start()")
        self._ages.append(age_s)


def _in_time(outcome: CallOutcome) -> None:
    if outcome.took_s > TIMEOUT_S + ROOM_S:
        raise StepFailed(f"read_block({TIMEOUT_S:g}) takes {outcome.took_s:.1f} s")


def _rising(block: Block, channels: int) -> Block:
    """Return a block as long as ``block``, or longer, whose values rise from row to row."""
    rows = max(len(block.values), RISING_ROWS)
    values = np.repeat(block.values[-1:], rows, axis=0)
    values[:, :channels] += np.linspace(-1e-3, 0.0, rows)[:, np.newaxis]
    return Block(block.times_ns[-1] - np.arange(rows)[::-1], values)


#: If the first rule is broken, the others are not checked.
RULES: Final = (
    Rule(
        "any order of calls",
        "a block has int64 times of CLOCK_MONOTONIC in ns at which its rows were taken, "
        "1 / rate_hz apart, and float64 values with a column per channel, the status last if it "
        "has one: what the device measured then, each row once; read_block() waits no longer than "
        "its time-out; newest_row(block) returns a value per column, of the last rows, of one row "
        "also; close() may come twice and leaves nothing",
        any_order,
        "",
    ),
    Rule(
        "keeps nothing",
        "keep no block that was handed over: a run may last for days",
        in_turn(_play, (*SAMPLES, ("keep nothing",))),
        "",
    ),
    *(
        Rule(fault, demand, in_turn(_play, (*SAMPLES, ("fail for long", fault)), seed=fault), fault)
        for fault, demand in {
            "dead": "with the device gone read_block() raises a LinkError or DeviceError within 2 "
            "silent_s",
            "silent": "with the device silent read_block() returns None at its time-out or raises "
            "a DeviceError",
            "garbled": "damaged packets are thrown away or raise a ProtocolError; they never "
            "become rows",
            "frozen": "a packet that was seen before gives no rows: compare the counter that it "
            "carries",
            "lossy": "raise a DeviceError if samples were lost, or leave a gap in the times",
        }.items()
    ),
)
