"""Simulated devices behind real sockets and ptys."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from support.cards.served import served
from support.instruments.modbus_bench import Bench, Physics, ServoBench, TransmitterBench

from rigd_sim.wire.modbus.line import Line, SerialLine, TcpLine
from rigd_sim.wire.modbus.servo import SimModbusServo
from rigd_sim.wire.modbus.transmitter import LoadCell, SimModbusTransmitter


@pytest.fixture(params=["tcp", "rtu"])
def line(request: pytest.FixtureRequest, tmp_path: Path) -> Line:
    """A TCP port, and a serial line, of 115200 baud."""
    if request.param == "tcp":
        return TcpLine(port=0)
    return SerialLine(tmp_path / "tty", 115200)


@pytest.fixture
def instrument() -> str:
    """Which transmitter; tests that need another override it."""
    return "laumas-tlb4"


@pytest.fixture
def drive() -> str:
    """Which drive; tests that need another override it."""
    return "schneider-atv320"


def _serve(bench: Bench) -> Iterator[Any]:
    with served(bench.part) as call:
        bench.call = call
        try:
            yield bench
        finally:
            for driver in bench.drivers:
                driver.close()


@pytest.fixture
def transmitter(line: Line, instrument: str) -> Iterator[TransmitterBench]:
    """A served transmitter that bears 12.5 N."""
    physics = Physics()
    cell = LoadCell(lambda: physics.force, capacity=500.0, resolution=0.01, seed=1)
    part = SimModbusTransmitter("cell", line, cell, instrument=instrument)
    yield from _serve(TransmitterBench(line, part, physics))


@pytest.fixture
def servo(line: Line, drive: str) -> Iterator[ServoBench]:
    """A served drive whose motor turns at once as commanded."""
    physics = Physics()
    part = SimModbusServo(
        "drive", line, command=physics.command, speed=lambda: physics.speed, drive=drive
    )
    yield from _serve(ServoBench(line, part, physics))
