"""Slow devices on their loop: rows, actions, and failures that stay with the one that failed."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from support.recordings.blocks import until

from rigd.engine.slow.devices import SlowDevices
from rigd.engine.slow.table import LatestTable
from rigd.model.channels import Channel, Stream
from rigd.model.errors import DeviceError, LinkError, ProtocolError
from rigd.sdk import Declaration, DriverConfig, EmitRow, Row, SlowDriver

START_NS, ORIGIN_NS = 1_700_000_000_000_000_000, 5_000_000_000


class MassRow(Row):
    mass: float


class Scale(SlowDriver[DriverConfig, None]):
    """A scale that gives 1, 2, 3, ... kg and behaves as its name states."""

    def __init__(self, fault: str = "") -> None:
        super().__init__(DriverConfig(), None)
        self.fault = fault
        self.opened = self.closed = self.cancelled = self.let_go = False
        self.mass = 0.0

    @classmethod
    def declare(cls, config: DriverConfig) -> Declaration:
        actions = {"tare": "sets zero", "dawdle": "never ends", "refuse": "says no"}
        return Declaration(channels=(Channel("mass", "kg"),), row=MassRow, actions=actions)

    async def open(self) -> None:
        match self.fault:
            case "absent":
                raise LinkError("nobody answers", hint="switch it on")
            case "other":
                raise ProtocolError("it is a kettle", hint="fill it")
            case "deaf":
                await asyncio.Event().wait()
        self.opened = True
        self.identity = "scale 1"

    def preflight(self) -> Sequence[str]:
        return ["it is loaded"] if self.fault == "loaded" else []

    async def run(self, emit: EmitRow) -> None:
        while not (self.fault == "returns" and self.mass == 3):
            self.mass += 1.0
            if self.mass > 3 and self.fault:
                await self.go_wrong(emit)
            emit(MassRow.of(mass=self.mass))
            try:
                await asyncio.sleep(0.01)
            except asyncio.CancelledError:
                self.cancelled = True
                raise

    async def go_wrong(self, emit: EmitRow) -> None:
        match self.fault:
            case "fails":
                raise DeviceError("overload")
            case "bug":
                raise KeyError("unit")
            case "cancels":
                raise asyncio.CancelledError
            case "wide":
                emit((1.0, 2.0))
            case "blocks":
                while not self.let_go:
                    time.sleep(0.01)  # what a driver must never do
            case "stubborn":
                while not self.let_go:
                    try:
                        await asyncio.sleep(0.01)
                    except asyncio.CancelledError:
                        self.cancelled = True

    async def act(self, action: str) -> str:
        match action:
            case "tare":
                self.mass = 0.0
                return "zero is set"
            case "refuse":
                raise DeviceError("the load moves")
        await asyncio.Event().wait()
        raise AssertionError

    async def close(self) -> None:
        if self.fault == "clings":
            raise OSError("the port is gone")
        self.closed = True


@dataclass
class Ring:
    """Keeps rows."""

    rows: list[tuple[int, tuple[float, ...]]] = field(default_factory=list)

    def push(self, t_ns: int, row: Sequence[float]) -> None:
        self.rows.append((t_ns, tuple(row)))


@dataclass
class Bench:
    """Some scales, run together."""

    scales: dict[str, Scale]
    rings: dict[str, Ring]
    table: LatestTable
    devices: SlowDevices


Make = Callable[..., Bench]


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Make]:
    made: list[Bench] = []

    def make(**faults: str) -> Bench:
        scales = {name: Scale(fault) for name, fault in faults.items()}
        streams = [Stream(name, scale.declaration.channels) for name, scale in scales.items()]
        table = LatestTable.create(tmp_path / f"latest-{len(made)}", streams)
        rings = {name: Ring() for name in scales}
        devices = SlowDevices(
            scales,
            rings=rings,
            slots={name: table.slot(name) for name in scales},
            start_ns=START_NS,
            origin_ns=ORIGIN_NS,
        )
        made.append(Bench(scales, rings, table, devices))
        return made[-1]

    yield make
    for item in made:
        for scale in item.scales.values():
            scale.let_go = True
        item.devices.stop()


def test_rows_go_to_ring_and_newest_to_table(bench: Make) -> None:
    found = bench(left="", right="")
    found.devices.start()
    until(lambda: all(len(ring.rows) >= 5 for ring in found.rings.values()))
    assert found.devices.poll() is None
    assert found.devices.identities == {"left": "scale 1", "right": "scale 1"}
    found.devices.stop()
    rows = found.rings["left"].rows
    assert [row for _, row in rows] == [(index + 1.0,) for index in range(len(rows))]
    newest = found.table.slot("left").read()
    assert newest is not None
    assert (newest[0] + START_NS - ORIGIN_NS, tuple(newest[1])) == rows[-1]
    now_ns = time.monotonic_ns() + START_NS - ORIGIN_NS
    assert all(now_ns - 60e9 < t_ns <= now_ns for t_ns, _ in rows)
    assert all(scale.cancelled and scale.closed for scale in found.scales.values())
    assert found.devices.faults == {}


def test_devices_failing_to_open_are_named_and_closed(bench: Make) -> None:
    found = bench(good="", gone="absent", wrong="other")
    with pytest.raises(LinkError, match=r"gone: .*; wrong: .*kettle") as caught:
        found.devices.start()
    assert caught.value.hint == "switch it on; fill it"
    assert all(scale.closed for scale in found.scales.values())
    assert found.rings["good"].rows == []
    assert "slow devices" not in {thread.name for thread in threading.enumerate()}


def test_opening_is_bounded(bench: Make) -> None:
    found = bench(deaf="deaf")
    with pytest.raises(LinkError, match=r"deaf was not open within 0\.2 s"):
        found.devices.start(timeout_s=0.2)
    assert found.scales["deaf"].closed


def test_reason_against_arming_is_reported(bench: Make) -> None:
    found = bench(left="loaded", right="")
    found.devices.start()
    assert found.devices.arming_blockers == ["left: it is loaded"]


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("fails", "bad: overload"),
        ("bug", "bad: its driver fails: KeyError: 'unit'"),
        ("returns", "bad: it stopped measuring by itself"),
        ("cancels", "bad: it cancelled itself"),
        ("wide", "bad: its driver fails: ValueError: the row has 2 values, expected 1"),
    ],
)
def test_one_that_fails_does_not_stop_the_others(bench: Make, fault: str, words: str) -> None:
    found = bench(bad=fault, good="")
    found.devices.start()
    until(lambda: found.devices.poll() is not None)
    assert found.devices.poll() == words
    assert found.devices.faults == {"bad": words}
    assert len(found.rings["bad"].rows) == 3
    seen = len(found.rings["good"].rows)
    until(lambda: len(found.rings["good"].rows) > seen + 3)
    with pytest.raises(DeviceError, match="bad does not run"):
        found.devices.act("bad", "tare")
    assert found.devices.act("good", "tare") == "zero is set"
    found.devices.stop()
    assert found.scales["bad"].closed
    assert found.scales["good"].closed


def test_action_runs_while_device_measures(bench: Make) -> None:
    found = bench(scale="")
    found.devices.start()
    until(lambda: len(found.rings["scale"].rows) > 5)
    assert found.devices.act("scale", "tare") == "zero is set"
    until(lambda: [row for _, row in found.rings["scale"].rows].count((1.0,)) == 2)
    with pytest.raises(DeviceError, match="the load moves"):
        found.devices.act("scale", "refuse")
    with pytest.raises(
        DeviceError, match=r"scale did not complete the action dawdle within 0\.1 s"
    ):
        found.devices.act("scale", "dawdle", timeout_s=0.1)
    with pytest.raises(DeviceError, match="scale cannot do 'jump'") as caught:
        found.devices.act("scale", "jump")
    assert caught.value.hint == "its actions: tare, dawdle, refuse"
    with pytest.raises(DeviceError, match="unknown slow device 'stool'"):
        found.devices.act("stool", "tare")
    assert found.devices.poll() is None


def test_stop_ends_opening_that_waits(bench: Make) -> None:
    """Asked for while a device is opened that does not answer for 20 s."""
    found = bench(bad="deaf", good="")
    found.devices._stopped = lambda: found.scales["good"].opened
    with pytest.raises(DeviceError, match="a stop was requested"):
        found.devices.start()
    assert found.scales["good"].closed
    assert found.scales["bad"].closed


def test_driver_that_blocks_loop_is_found_out(bench: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rigd.engine.slow.devices.BLOCKED_S", 0.5)
    monkeypatch.setattr("rigd.engine.slow.devices.CLOSE_S", 0.2)
    found = bench(bad="blocks", good="")
    found.devices.start()
    until(lambda: found.devices.poll() is not None)
    reason = str(found.devices.poll())
    assert reason.startswith("the loop of the slow devices (bad, good) has been blocked for 0.5 s")
    found.devices.stop()  # bounded
    assert not found.scales["good"].closed


def test_uncancellable_device_does_not_hold_the_others(
    bench: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rigd.engine.slow.devices.CLOSE_S", 0.5)
    found = bench(bad="stubborn", good="")
    found.devices.start()
    until(lambda: found.scales["bad"].mass > 3)
    found.devices.stop()
    assert found.devices.faults == {"bad": "bad: did not stop within 0.5 s"}
    assert found.scales["good"].closed


def test_device_that_cannot_close_is_reported(bench: Make) -> None:
    found = bench(bad="clings", good="")
    found.devices.start()
    found.devices.stop()
    found.devices.stop()  # twice is silent
    assert found.devices.faults == {"bad": "bad: could not be closed: the port is gone"}
    assert found.scales["good"].closed
