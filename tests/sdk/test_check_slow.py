"""The suite finds every mistake that a slow driver can make, and none in a good one."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import socket
import time
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, ClassVar

import pytest
from sdk.mutants.known.kinds import KINDS
from support.instruments.memory_wire import Wire, assert_found, each_mistake

from rigd.sdk import (
    Channel,
    Declaration,
    DeviceError,
    DriverConfig,
    EmitRow,
    LinkError,
    Row,
    SlowDriver,
)
from rigd.sdk.check import Observed, Peer, SentReading, check_driver, examine_driver
from rigd.sdk.check.suite import RULES
from rigd.sdk.check.watching import HeldTime


@contextmanager
def thermometer() -> Iterator[Peer]:
    yield Wire().peer()


class TemperatureRow(Row):
    temperature: float


class Good(SlowDriver[DriverConfig, Wire]):
    """A thermometer in memory."""

    title: ClassVar[str] = "thermometer in memory"
    ours = False

    @classmethod
    def declare(cls, config: DriverConfig) -> Declaration:
        return Declaration(
            channels=(Channel("temperature", "K", "temperature", 200.0, 400.0),),
            row=TemperatureRow,
            actions={"zero": "takes what it shows as zero"},
            silent_s=0.2,
        )

    async def open(self) -> None:
        """Open."""
        if self.link.fault == "dead":
            raise LinkError("nothing answers", hint="plug it in")
        if self.link.taken:
            raise LinkError("somebody has it", hint="end the other session")
        self.link.taken = self.ours = True
        await asyncio.sleep(0.01)

    async def run(self, emit: EmitRow) -> None:
        """Run."""
        while True:
            await asyncio.sleep(0.01)
            if self.link.fault == "dead":
                raise LinkError("it is gone")
            if not self.link.fault:
                emit(self.row())

    def row(self) -> Sequence[float]:
        return TemperatureRow.of(temperature=293.15)

    async def act(self, action: str) -> str:
        """Act."""
        if action != "zero":
            raise ValueError(f"no action {action!r}")
        if self.link.fault:
            raise DeviceError("it does not say that it has done it")
        return "zero done"

    async def close(self) -> None:
        """Close."""
        if self.ours:
            self.link.taken = self.ours = False


def test_a_good_driver_passes_every_rule() -> None:
    report = check_driver(Good, peer=thermometer)
    assert report.findings == ()
    assert report.skipped.keys() == {"action refused", "another at open"}


class Later(list[SentReading]):
    """Readings that are there from the second look on."""

    looks = 0

    def __len__(self) -> int:
        self.looks += 1
        return super().__len__() if self.looks > 2 else 0


def test_measured_value_of_no_channel_is_found() -> None:
    @contextmanager
    def misspelt() -> Iterator[Peer]:
        with thermometer() as peer:
            readings = [SentReading(time.monotonic(), {"temprature": 293.15})] * 1000
            yield replace(peer, readings=Later(readings))

    report = examine_driver(Good, peer=misspelt, only=["any order of calls"])
    assert_found(
        report, "any order of calls", "the peer sends temprature, none of which is a channel"
    )


class Heater(Good):
    async def write(self, setpoints: Sequence[float]) -> None:
        """Write."""

    async def make_safe(self) -> None:
        """Do something."""


def test_slow_driver_says_what_safe_means() -> None:
    report = examine_driver(Heater, only=["safe is described"])
    assert_found(report, "safe is described", "no docstring states what safe means")


class Closed(Good):
    async def open(self) -> None:
        raise LinkError("never")


class Unready(Good):
    def preflight(self) -> Sequence[str]:
        return ("cold",)


class Short(Good):
    def row(self) -> Sequence[float]:
        return ()


class Sentence(Good):
    def row(self) -> Any:
        return TemperatureRow.of(temperature="293.15")  # type: ignore[arg-type]


class Ends(Good):
    async def run(self, emit: EmitRow) -> None:
        for _ in range(5):
            emit(self.row())


class Mute(Good):
    async def run(self, emit: EmitRow) -> None:
        await asyncio.Event().wait()


class Blocking(Good):
    async def run(self, emit: EmitRow) -> None:
        while True:
            time.sleep(0.5)  # as an author who calls a blocking library
            emit(self.row())
            await asyncio.sleep(0)


class Immortal(Good):
    async def run(self, emit: EmitRow) -> None:
        while True:
            try:
                await asyncio.sleep(0.01)
                emit(self.row())
            except asyncio.CancelledError:
                return


class Leaky(Good):
    async def open(self) -> None:
        if self.link.taken:
            raise LinkError("somebody has it", hint="end the other session")
        self.link.taken = True
        await asyncio.sleep(0.02)
        self.ours = True  # not reached when cancelled: it stays taken


class Keeping(Good):
    async def open(self) -> None:
        await super().open()
        self.kept: list[Any] = [*socket.socketpair()]
        self.kept.append(self.kept)  # closed once they are collected


class Deaf(Good):
    async def act(self, action: str) -> str:
        raise DeviceError("cannot")


class Hopeful(Good):
    async def act(self, action: str) -> str:
        if action != "zero":
            raise ValueError(f"no action {action!r}")
        return "zero done"


class Vague(Good):
    async def act(self, action: str) -> str:
        return ""


class CloseOnce(Good):
    async def close(self) -> None:
        if self.link is not None:
            if not self.ours:
                raise LinkError("not open")
            self.link.taken = self.ours = False


class Abandoning(Good):
    task: asyncio.Task[bool] | None = None

    async def open(self) -> None:
        await super().open()
        self.task = asyncio.create_task(asyncio.Event().wait(), name="forgotten")


class Inventive(Good):
    async def run(self, emit: EmitRow) -> None:
        while True:
            await asyncio.sleep(0.01)
            emit(self.row())


class BadWords(Good):
    async def run(self, emit: EmitRow) -> None:
        while not self.link.fault:
            await asyncio.sleep(0.01)
            emit(self.row())
        raise OSError(5, "Input/output error")


class GivesUp(Good):
    async def run(self, emit: EmitRow) -> None:
        while not self.link.fault:
            await asyncio.sleep(0.01)
            emit(self.row())


class BelievesGarbage(Good):
    def row(self) -> Sequence[float]:
        return (293.15,) if self.link.fault else super().row()

    async def run(self, emit: EmitRow) -> None:
        while True:
            await asyncio.sleep(0.01)
            emit(self.row())


class Startled(Good):
    async def open(self) -> None:
        if self.link.fault:
            raise UnicodeDecodeError("ascii", b"\xff", 0, 1, "not in range")
        await super().open()


class Pretending(Good):
    async def open(self) -> None:
        self.link.taken = self.ours = True


class Curt(Good):
    async def open(self) -> None:
        raise LinkError("no")


class Careless(Good):
    async def run(self, emit: EmitRow) -> None:
        while self.link.taken:
            await asyncio.sleep(0.01)
            emit(self.row())
        raise LinkError("it is closed")

    async def close(self) -> None:
        self.link.taken = self.ours = False  # also what another has opened


BAD: list[tuple[str, type[SlowDriver], str]] = [
    ("any order of calls", Closed, "open raises LinkError: never"),
    ("any order of calls", Unready, "cold"),
    ("any order of calls", Abandoning, "tasks go on after close(): forgotten"),
    ("any order of calls", Short, "a row is (), expected TemperatureRow(temperature)"),
    ("any order of calls", Sentence, "expected a float"),
    ("any order of calls", Ends, "run() returns"),
    ("any order of calls", Mute, "run() gives no row"),
    ("never blocks", Blocking, "the event loop stood still"),
    ("any order of calls", Immortal, "run() returns when it is cancelled"),
    ("any order of calls", Leaky, "somebody has it"),
    ("any order of calls", Deaf, "DeviceError: cannot"),
    ("any order of calls", Vague, "returns ''"),
    ("silent", Hopeful, "and act('zero') returns 'zero done'"),
    ("garbled", Hopeful, "and act('zero') returns 'zero done'"),
    ("any order of calls", CloseOnce, "not open"),
    ("any order of calls", Careless, "LinkError: it is closed"),
    ("dead", Inventive, "still gives rows"),
    ("dead", GivesUp, "run() returns"),
    ("silent", Inventive, "still gives rows"),
    ("silent", BadWords, "run() raises OSError"),
    ("late", BadWords, "run() raises OSError"),
    ("garbled", BelievesGarbage, "expected TemperatureRow"),
    ("silent at open", Startled, "UnicodeDecodeError"),
    ("garbled at open", Startled, "UnicodeDecodeError"),
    ("not there", Pretending, "open() succeeds"),
    ("not there", Curt, "without a hint"),
]


@contextmanager
def zeroed() -> Iterator[Peer]:
    """Show what has been done."""
    wire = Wire()
    yield replace(wire.peer(), observed=lambda: Observed(acted=tuple(wire.acted)))


class Zeroing(Good):
    async def act(self, action: str) -> str:
        reply = await super().act(action)
        self.link.acted.append(action)
        return reply


class Insisting(Zeroing):
    async def act(self, action: str) -> str:
        with contextlib.suppress(DeviceError):
            return await super().act(action)
        self.link.acted += [action] * 2  # it was done, and no answer came
        raise DeviceError("no answer")


class Halting(Zeroing):
    until_s = 0.0

    @classmethod
    def declare(cls, config: DriverConfig) -> Declaration:
        return replace(super().declare(config), silent_s=3.0)

    async def act(self, action: str) -> str:
        reply = await super().act(action)
        self.until_s = time.monotonic() + 1.0
        return reply

    async def run(self, emit: EmitRow) -> None:
        def settled(row: Sequence[float]) -> None:
            if time.monotonic() > self.until_s:
                emit(row)

        await super().run(settled)


def test_action_done_twice_is_found() -> None:
    assert examine_driver(Zeroing, peer=zeroed).findings == ()
    report = examine_driver(Insisting, peer=zeroed, only=["silent"])
    assert_found(report, "silent", "act('zero') has the device do zero, zero")


def test_rows_that_stop_after_action_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(HeldTime, "since", lambda *_: 0.0)  # on a machine that holds nothing back
    report = examine_driver(Halting, peer=zeroed, only=["any order of calls"])
    assert_found(report, "any order of calls", "once the device has done it no row comes for 1")


@each_mistake(BAD)
def test_a_mistake_is_found_by_its_rule(rule: str, driver: type[SlowDriver], words: str) -> None:
    assert_found(examine_driver(driver, peer=thermometer, only=[rule]), rule, words)


def test_no_rule_is_without_driver_that_breaks_it() -> None:
    found = {mutant.rule for mutant in KINDS["slow"]} | {rule for rule, _, _ in BAD}
    assert {rule.name for rule in RULES[SlowDriver]} == {
        *found, "action refused", "another at open",
    } - {"constructor opens nothing", "safe and closed before open"}  # fmt: skip


def test_what_a_faulty_driver_left_is_collected() -> None:
    report = examine_driver(Keeping, peer=thermometer, only=["any order of calls"])
    assert any("left open" in finding.problem for finding in report.findings), str(report)
    with warnings.catch_warnings(record=True) as later:
        warnings.simplefilter("always")
        gc.collect()
    assert later == []
