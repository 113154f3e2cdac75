"""The suite finds every mistake that a block driver can make, and none in a good one."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
from sdk.mutants.known.kinds import KINDS
from support.instruments.memory_wire import Wire, assert_found, each_mistake

from rigd.sdk import Block, BlockDriver, Channel, Declaration, DeviceError, DriverConfig, LinkError
from rigd.sdk.check import Peer, SentReading, check_driver, examine_driver
from rigd.sdk.check.suite import RULES

ROWS = 10
MS = 1_000_000


@contextmanager
def card() -> Iterator[Peer]:
    yield Wire().peer()


class Good(BlockDriver[DriverConfig, Wire]):
    """A card in memory."""

    title: ClassVar[str] = "card in memory"
    ours = False
    last_ns = 0

    @classmethod
    def declare(cls, config: DriverConfig) -> Declaration:
        channel = Channel("voltage", "V", "input 0", -10.0, 10.0)
        return Declaration(channels=(channel,), has_status=True)

    def open(self) -> None:
        """Open."""
        if self.link.fault == "dead":
            raise LinkError("there is no card", hint="plug it in")
        if self.link.taken:
            raise LinkError("somebody has it", hint="end the other session")
        self.link.taken = self.ours = True
        self.rate_hz = 1000.0

    def start(self) -> None:
        """Start."""
        self.last_ns = 0

    def read_block(self, timeout_s: float) -> Block | None:
        """Read, when a millisecond for each row has passed."""
        while time.monotonic_ns() < self.last_ns + ROWS * MS:
            time.sleep(0.001)
        if self.link.fault == "dead":
            raise LinkError("it is gone")
        if self.link.fault == "lossy":
            raise DeviceError("samples were lost")
        return None if self.link.fault else Block(self.times(), self.values())

    def times(self) -> Any:
        self.last_ns = (self.last_ns or time.monotonic_ns() - ROWS * MS) + ROWS * MS
        return self.last_ns + MS * np.arange(1 - ROWS, 1)

    def values(self) -> Any:
        return np.zeros((ROWS, 2))

    def close(self) -> None:
        """Close."""
        if self.ours:
            self.link.taken = self.ours = False


def test_a_good_driver_passes_every_rule() -> None:
    report = check_driver(Good, peer=card)
    assert report.findings == ()
    assert report.skipped.keys() == {"another at open"}


class Patchy(Good):
    """A library that returns an empty block where another returns None."""

    turn = False

    def read_block(self, timeout_s: float) -> Block | None:
        self.turn = not self.turn
        if self.turn:
            return Block(np.zeros(0, np.int64), np.zeros((0, 2)))
        return super().read_block(timeout_s)


def test_empty_blocks_are_no_mistake() -> None:
    assert examine_driver(Patchy, peer=card).findings == ()


class Closed(Good):
    def open(self) -> None:
        raise LinkError("never")


class Rateless(Good):
    def open(self) -> None:
        super().open()
        self.rate_hz = 0.0


class Narrow(Good):
    def values(self) -> Any:
        return np.zeros((ROWS, 1))


class Beyond(Good):
    def values(self) -> Any:
        return np.full((ROWS, 2), 11.0)


class Single(Good):
    def values(self) -> Any:
        return np.zeros((ROWS, 2), np.float32)


class Seconds(Good):
    def times(self) -> Any:
        return np.linspace(0.0, 1.0, ROWS)


class Undefined(Good):
    def values(self) -> Any:
        return np.full((ROWS, 2), np.nan)


class Backward(Good):
    def times(self) -> Any:
        return super().times()[::-1]


class WallClock(Good):
    def times(self) -> Any:
        return np.arange(ROWS) + time.time_ns()


class Rows(Good):
    def read_block(self, timeout_s: float) -> Any:
        return [(0.0, 1)]


class Empty(Good):
    def read_block(self, timeout_s: float) -> Block | None:
        time.sleep(timeout_s)
        return None


class Waiting(Good):
    def read_block(self, timeout_s: float) -> Block | None:
        time.sleep(2.0)
        return None


class Patient(Good):
    def read_block(self, timeout_s: float) -> Block | None:
        if self.link.fault == "silent":
            time.sleep(1.5)
        return super().read_block(timeout_s)


class CloseOnce(Good):
    def close(self) -> None:
        if self.link is not None:
            if not self.ours:
                raise LinkError("not open")
            super().close()


class OpenOnce(Good):
    def open(self) -> None:
        if self.ours:
            raise RuntimeError("already open")
        super().open()


class Clinging(Good):
    def close(self) -> None:
        """Forget to let go."""


class Inventive(Good):
    def read_block(self, timeout_s: float) -> Block | None:
        time.sleep(0.01)
        return Block(self.times(), self.values())


class BadWords(Good):
    def read_block(self, timeout_s: float) -> Block | None:
        if self.link.fault:
            raise OSError(5, "Input/output error")
        return super().read_block(timeout_s)


class Pretending(Good):
    def open(self) -> None:
        self.link.taken = self.ours = True


class Curt(Good):
    def open(self) -> None:
        raise LinkError("no")


class Short(Good):
    def newest_row(self, block: Block) -> Sequence[float]:
        return block.values[-1, :-1].tolist()  # type: ignore[no-any-return]


class Behind(Good):
    def newest_row(self, block: Block) -> Sequence[float]:
        return block.values[0].tolist()  # type: ignore[no-any-return]


class Shared(Good):
    memory = np.zeros((ROWS, 2))

    def values(self) -> Any:
        self.memory[:, 0] += 0.01
        return self.memory


class Greedy(Good):
    def newest_row(self, block: Block) -> Sequence[float]:
        return block.values[-5].tolist()  # type: ignore[no-any-return]


class Hoarding(Good):
    def __init__(self, config: DriverConfig, link: Wire) -> None:
        super().__init__(config, link)
        self.kept: list[Block | None] = []

    def read_block(self, timeout_s: float) -> Block | None:
        self.kept.append(super().read_block(timeout_s))
        return self.kept[-1]


BAD: list[tuple[str, type[BlockDriver], str]] = [
    ("any order of calls", Closed, "open raises LinkError: never"),
    ("any order of calls", Rateless, "rate_hz is 0.0"),
    ("any order of calls", Narrow, "of shape (10, 1), expected float64 of (10, 2)"),
    ("any order of calls", Beyond, "voltage is 11 V, beyond its range"),
    ("any order of calls", Single, "float32"),
    ("any order of calls", Seconds, "times_ns is float64"),
    ("any order of calls", Undefined, "not finite"),
    ("any order of calls", Backward, "do not increase"),
    ("any order of calls", WallClock, "after they came"),
    ("any order of calls", Rows, "returns list"),
    ("any order of calls", Empty, "0 blocks with rows in"),
    ("any order of calls", Short, "newest_row gives 1 values, expected 2"),
    ("any order of calls", Shared, "changes when the next one is read"),
    ("any order of calls", Behind, "rows before the last"),
    ("any order of calls", Greedy, "newest_row of a block of 1 raises IndexError"),
    ("any order of calls", Waiting, "read_block(0.2) takes"),
    ("any order of calls", OpenOnce, "RuntimeError: already open"),
    ("any order of calls", CloseOnce, "close again raises"),
    ("any order of calls", Clinging, "somebody has it"),
    ("keeps nothing", Hoarding, "bytes for good"),
    ("dead", Inventive, "still gives rows"),
    ("dead", BadWords, "read_block raises OSError"),
    ("silent", Inventive, "still gives rows"),
    ("silent", Patient, "read_block(0.2) takes"),
    ("not there", Pretending, "open() succeeds"),
    ("not there", Curt, "without a hint"),
]


@each_mistake(BAD)
def test_a_mistake_is_found_by_its_rule(rule: str, driver: type[BlockDriver], words: str) -> None:
    assert_found(examine_driver(driver, peer=card, only=[rule]), rule, words)


def test_rows_that_wait_for_time_out_are_found() -> None:
    readings: list[SentReading] = []

    class Collecting(Good):
        def start(self) -> None:
            super().start()
            readings.extend([SentReading(time.monotonic(), {"voltage": 0.0})] * ROWS)

        def read_block(self, timeout_s: float) -> Block | None:
            time.sleep(timeout_s)  # and collects what comes meanwhile
            return super().read_block(timeout_s)

    @contextmanager
    def sending() -> Iterator[Peer]:
        with card() as peer:
            yield replace(peer, readings=readings)

    report = examine_driver(Collecting, peer=sending, only=["any order of calls"])
    assert_found(report, "any order of calls", "rows that were sent do not come for 0.")


def test_no_rule_is_without_driver_that_breaks_it() -> None:
    mutants = {mutant.rule for mutant in KINDS["block"]}
    assert {rule.name for rule in RULES[BlockDriver]} - {
        "another at open",
        "silent at open",
    } == {rule for rule, _, _ in BAD} | mutants - {"constructor opens nothing"}
