"""Slow devices that take setpoints: orders of the cycle, and every way out."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import pytest
from support.recordings.blocks import until

from rigd.config.rig import DeviceConfig
from rigd.engine.slow import devices as slow
from rigd.engine.slow.devices import SlowDevices
from rigd.engine.slow.orders import DeviceOrders, Done, Order, Orders
from rigd.engine.slow.stand_ins import OrderingProxy
from rigd.engine.slow.table import LatestTable
from rigd.model.channels import Channel
from rigd.model.errors import LinkError
from rigd.model.limits import SetpointLimit
from rigd.sdk import Declaration, DriverConfig, EmitRow, SlowDriver

REST, WARM = 293.0, 353.0


class OvenConfig(DriverConfig):
    """An oven of a test."""

    watchdog: float | None = None
    """Its watchdog in s."""


class Oven(SlowDriver[OvenConfig, None]):
    """Keeps what it was told, and behaves as ``fault`` states."""

    Config = OvenConfig

    def __init__(self, config: OvenConfig, link: None = None) -> None:
        super().__init__(config, link)
        self.fault = ""
        self.calls: list[str] = []
        self.setpoint = float("nan")

    @classmethod
    def declare(cls, config: OvenConfig) -> Declaration:
        return Declaration(
            channels=(Channel("measured", "K"),),
            plain_rows=True,
            setpoints=(Channel("temperature", "K", low=273.0, high=500.0),),
            watchdog_s=config.watchdog,
        )

    async def open(self) -> None:
        self.calls.append("open")

    async def run(self, emit: EmitRow) -> None:
        while True:
            emit((self.setpoint,))
            await asyncio.sleep(0.01)

    async def write(self, setpoints: Sequence[float]) -> None:
        await self._behave("write")
        self.setpoint = setpoints[0]
        self.calls.append(f"write {setpoints[0]:g}")

    async def arm(self) -> None:
        await self._behave("arm")
        self.calls.append("arm")

    async def make_safe(self) -> None:
        await self._behave("safe")
        self.calls.append("safe")

    async def prove_watchdog(self) -> float:
        await self._behave("watchdog")
        return 0.3

    async def close(self) -> None:
        self.calls.append("close")

    async def _behave(self, where: str) -> None:
        if self.fault == f"{where} hangs":
            await asyncio.Event().wait()
        if self.fault == f"{where} fails":
            raise LinkError("nobody answers")
        if self.fault == f"{where} bug":
            raise KeyError("heater")


class Bench:
    """An oven on its loop, and the cycle's stand-in for it."""

    def __init__(self, folder: Path, watchdog: float | None) -> None:
        config = OvenConfig(watchdog=watchdog)
        self.oven = Oven(config)
        device = DeviceConfig(
            "oven", "test", Oven, config, self.oven.declaration,
            {"temperature": SetpointLimit(280.0, 400.0, 1.0, REST, True)},
        )  # fmt: skip
        table = LatestTable.create(folder / "latest", [device.stream])
        self.orders = Orders.create(folder / "orders", [device]).of("oven")
        assert self.orders is not None
        slots = {"oven": table.slot("oven")}
        self.devices = SlowDevices(
            {"oven": self.oven}, rings={}, slots=slots, start_ns=0, origin_ns=0,
            orders={"oven": self.orders},
        )  # fmt: skip
        theirs = Orders.attach(folder / "orders", [device]).of("oven")
        assert theirs is not None
        self.cycle = OrderingProxy(device, table.slot("oven"), theirs)

    def run_until(self, condition: Callable[[], bool], value: float = REST) -> None:
        """Write ``value`` as the cycle does, until ``condition`` holds."""

        def once() -> bool:
            self.cycle.write([value])
            return condition()

        until(once)

    def arm(self) -> None:
        self.devices.start()
        self.cycle.arm()
        self.run_until(self.cycle.ready)


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Callable[..., Bench]]:
    made: list[Bench] = []

    def make(watchdog: float | None = None) -> Bench:
        made.append(Bench(tmp_path, watchdog))
        return made[-1]

    yield make
    for item in made:
        item.devices.stop()


def test_nothing_is_sent_before_arming(bench: Callable[..., Bench]) -> None:
    found = bench()
    found.devices.start()
    begun = time.monotonic()
    found.run_until(lambda: time.monotonic() - begun > 5 * slow.ORDER_S)
    assert found.oven.calls == ["open"]


def test_stop_ends_proof_that_waits(bench: Callable[..., Bench]) -> None:
    found = bench(watchdog=600.0)
    found.devices.start()
    found.oven.fault = "watchdog hangs"
    found.devices._stopped = lambda: True
    proven, (reason,) = found.devices.prove_watchdogs()
    assert proven == {}
    assert reason == "oven: its watchdog is not proven: a stop was requested"
    assert found.devices.make_safe() == []
    assert found.oven.calls == ["open", "safe"]


def test_setpoints_go_to_rest_before_output_is_on(bench: Callable[..., Bench]) -> None:
    found = bench()
    assert found.cycle.ready()
    found.arm()
    assert found.oven.calls == ["open", f"write {REST:g}", "arm"]
    found.run_until(lambda: found.oven.setpoint == WARM, WARM)
    assert found.oven.calls[3:] == [f"write {WARM:g}"], "only what has changed is sent"


def test_safe_order_ends_the_setpoints(bench: Callable[..., Bench]) -> None:
    found = bench()
    found.arm()
    found.cycle.make_safe()
    found.cycle.write([WARM])  # what a late cycle writes
    until(lambda: found.orders is not None and found.orders.reported is Done.SAFE)
    assert found.oven.calls[-1] == "safe"
    assert list(found.devices.make_safe()) == []
    assert found.oven.calls.count("safe") == 1
    assert found.devices.poll() is None


def test_daemon_makes_safe_without_order(bench: Callable[..., Bench]) -> None:
    found = bench()
    found.arm()
    assert list(found.devices.make_safe()) == []
    assert found.oven.calls[-1] == "safe"
    found.devices.stop()
    assert found.oven.calls[-2:] == ["safe", "close"]


def test_stop_makes_safe_before_it_closes(bench: Callable[..., Bench]) -> None:
    found = bench()
    found.arm()
    found.devices.stop()
    assert found.oven.calls[-2:] == ["safe", "close"]
    assert found.devices.faults == {}


@pytest.mark.parametrize("writing", [False, True], ids=["between", "in an order"])
def test_silent_cycle_makes_safe_and_is_a_fault(
    bench: Callable[..., Bench], monkeypatch: pytest.MonkeyPatch, writing: bool
) -> None:
    monkeypatch.setattr(slow, "UNORDERED_S", 0.2)
    found = bench()
    found.arm()
    if writing:  # as a cycle that was killed leaves it: the sequence number is odd
        assert found.orders is not None
        found.orders._given._words[0] |= 1
    until(lambda: found.devices.poll() is not None)
    assert found.devices.poll() == "oven: the cycle gave it no setpoint for 0.2 s"
    until(lambda: found.oven.calls[-1] == "safe")


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("write fails", "oven: nobody answers"),
        ("write hangs", "oven: it did not take its setpoints within 0.2 s"),
        ("arm hangs", "oven: it did not take its setpoints within 0.2 s"),
        ("write bug", "oven: its driver fails: KeyError: 'heater'"),
    ],
)
def test_device_that_takes_no_setpoint_is_a_fault(
    bench: Callable[..., Bench], monkeypatch: pytest.MonkeyPatch, fault: str, words: str
) -> None:
    monkeypatch.setattr(slow, "WRITE_S", 0.2)
    found = bench()
    found.oven.fault = fault
    found.devices.start()
    found.cycle.arm()
    found.run_until(lambda: found.devices.poll() is not None)
    assert found.devices.poll() == words
    assert not found.cycle.ready()
    until(lambda: "safe" in found.oven.calls)


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("safe fails", "oven could not be made safe: nobody answers"),
        ("safe hangs", "oven could not be made safe: it did not answer within 0.2 s"),
        ("safe bug", "oven could not be made safe: its driver fails: KeyError: 'heater'"),
    ],
)
def test_device_that_does_not_become_safe_is_named(
    bench: Callable[..., Bench], monkeypatch: pytest.MonkeyPatch, fault: str, words: str
) -> None:
    monkeypatch.setattr(slow, "SAFE_S", 0.2)
    found = bench()
    found.arm()
    found.oven.fault = fault
    found.cycle.make_safe()
    assert list(found.devices.make_safe()) == [words]
    found.oven.fault = ""
    found.devices.stop()  # tries once more
    assert found.oven.calls[-2:] == ["safe", "close"]


def test_watchdog_is_proven_or_named(bench: Callable[..., Bench]) -> None:
    found = bench(watchdog=0.5)
    found.devices.start()
    assert found.devices.prove_watchdogs() == ({"oven": 0.3}, [])
    found.oven.fault = "watchdog fails"
    assert found.devices.prove_watchdogs() == (
        {}, ["oven: its watchdog is not proven: nobody answers"]
    )  # fmt: skip


def test_device_without_watchdog_has_nothing_to_prove(bench: Callable[..., Bench]) -> None:
    found = bench()
    found.devices.start()
    assert found.devices.prove_watchdogs() == ({}, [])


def test_newest_order_is_read(tmp_path: Path) -> None:
    device = DeviceConfig("oven", "test", Oven, OvenConfig(), Oven(OvenConfig()).declaration, {})
    orders = Orders.create(tmp_path / "orders", [device]).of("oven")
    assert isinstance(orders, DeviceOrders)
    assert orders.given() is None
    assert orders.reported is Done.NOTHING
    orders.give(5, Order.ARM, [WARM])
    assert orders.given() == (5, Order.ARM, [WARM])
