"""Simulated devices behind real sockets and ptys, and drivers that are polled like a cycle does."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from rigd.sdk import Driver
from rigd_drivers.modbus.servo import ModbusServo, ServoConfig
from rigd_drivers.modbus.transmitter import ModbusTransmitter, TransmitterConfig
from rigd_sim.wire.modbus.line import Line, SerialLine, TcpLine

#: Far longer than anything here takes, on a machine that stalls.
PATIENCE_S = 10.0

Rows = list[Sequence[float]]


def cycle(driver: Driver, until: Callable[[Rows], bool], setpoints: Sequence[float] = ()) -> Rows:
    """Poll ``driver`` at about 1 kHz until the rows it gave are enough."""
    rows: Rows = []
    end = time.monotonic() + PATIENCE_S
    while not until(rows):
        assert time.monotonic() < end, f"only {len(rows)} rows came: {rows[-3:]}"
        row = driver.read(time.monotonic_ns())
        if row is not None:
            rows.append(row)
        if setpoints:
            driver.write(setpoints)
        time.sleep(0.0005)
    return rows


def status(row: Sequence[float]) -> int:
    """Return the status word of a row."""
    return int(row[-1])


def rows_of(driver: Driver, count: int) -> Rows:
    """Return the next ``count`` rows."""
    return cycle(driver, lambda rows: len(rows) >= count)


@dataclass
class Physics:
    """What stands in for a plant: a force in N, and a motor that turns as commanded, in rad/s."""

    force: float = 12.5
    speed: float = 0.0

    def command(self, speed: float, enabled: bool) -> None:
        self.speed = speed


class Bench:
    """One simulated device, served, and the drivers opened on it."""

    def __init__(self, line: Line, part: Any, physics: Physics) -> None:
        self.line = line
        self.part = part
        self.physics = physics
        self.drivers: list[Driver] = []
        self.call: Callable[[Callable[[], Any]], Any] = lambda function: function()

    def fault(self, name: str, **options: Any) -> None:
        self.call(lambda: self.part.inject(name, **options))

    def clear(self) -> None:
        self.call(self.part.clear)

    def state(self) -> dict[str, Any]:
        return dict(self.call(self.part.state))

    def options(self, **more: Any) -> dict[str, Any]:
        if isinstance(self.line, TcpLine):
            return {"host": "127.0.0.1", "port": self.line.port} | more
        assert isinstance(self.line, SerialLine)
        serial = {"serial_port": str(self.line.path), "baud": self.line.baud, "parity": "none"}
        return serial | more

    def keep(self, driver: Any) -> Any:
        self.drivers.append(driver)
        return driver


class TransmitterBench(Bench):
    def driver(self, **options: Any) -> ModbusTransmitter:
        given = {"map": "laumas-tlb4", "scale": "0.01 N/count", "low": "-500 N", "high": "500 N"}
        made = TransmitterConfig.model_validate(self.options(**given | options))
        driver: ModbusTransmitter = self.keep(ModbusTransmitter(made, None))
        return driver


class ServoBench(Bench):
    def comes_to_rest(self) -> bool:
        """Wait for the drive's next look at what was written; return whether its motor stands."""
        end = time.monotonic() + PATIENCE_S
        while self.physics.speed != 0.0 and time.monotonic() < end:
            time.sleep(0.001)
        return self.physics.speed == 0.0

    def driver(self, **options: Any) -> ModbusServo:
        given = {"map": "schneider-atv320", "max_speed": "3000 rpm", "watchdog": "1.5 s"}
        made = ServoConfig.model_validate(self.options(**given | options))
        driver: ModbusServo = self.keep(ModbusServo(made, None))
        return driver
