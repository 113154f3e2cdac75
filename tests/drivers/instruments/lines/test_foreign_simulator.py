"""The driver reads the instruments that pyvisa-sim simulates, over a serial port."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import Iterator, Sequence
from typing import Any

import pytest
from support.instruments.visa_bridge import Bridge

from rigd.sdk import ProtocolError
from rigd_drivers.instruments.lines.config import LinesConfig
from rigd_drivers.instruments.lines.driver import Lines
from rigd_drivers.instruments.lines.output_driver import READY, LineOutputs
from rigd_drivers.instruments.lines.outputs import LineOutputsConfig

TIMEOUT_S = 30


@contextlib.contextmanager
def bridged(resource: str, **options: Any) -> Iterator[Lines]:
    bridge = Bridge(resource)
    given = {"port": bridge.port, "period": "0.05 s", "silence": "1 s", **options}
    try:
        yield Lines(LinesConfig.model_validate(given), None)
    finally:
        bridge.close()


async def first_rows(driver: Lines, count: int) -> list[Sequence[float]]:
    rows: list[Sequence[float]] = []
    enough = asyncio.Event()

    def emit(row: Sequence[float]) -> None:
        rows.append(row)
        if len(rows) >= count:
            enough.set()

    await driver.open()
    task = asyncio.create_task(driver.run(emit))
    try:
        async with asyncio.timeout(TIMEOUT_S):
            await enough.wait()
    finally:
        task.cancel()
        await asyncio.wait([task])
        await driver.close()
    return rows


def test_line_device_of_another_author_is_read() -> None:
    with bridged(
        "ASRL1::INSTR",
        identify=r"?IDN\r\n",
        start=r"!FREQ 250.25\r\n",
        ask=r"?FREQ\r\n",
        pattern=r"(?P<frequency>\d+\.\d\d)",
        channels={"frequency": "Hz"},
    ) as driver:
        rows = asyncio.run(first_rows(driver, 5))
    assert driver.identity == "LSG Serial #1234"
    assert rows == [(250.25, 0)] * 5


def test_scpi_device_of_another_author_is_read() -> None:
    with bridged(
        "ASRL2::INSTR",
        identify=r"*IDN?\r\n",
        start=r":VOLT:IMM:AMPL 3.500\r\n",
        ask=r":VOLT:IMM:AMPL?\r\n",
        pattern=r"(?P<voltage>[-+]\d\.\d{8}E[-+]\d\d)",
        channels={"voltage": {"unit": "mV", "low": "0 V", "high": "6 V"}},
    ) as driver:
        rows = asyncio.run(first_rows(driver, 5))
    assert driver.identity == "SCPI,MOCK,VERSION_1.0"
    assert [row[0] for row in rows] == pytest.approx([0.0035] * 5)


def test_refusal_of_another_author_is_shown() -> None:
    with (
        bridged(
            "ASRL1::INSTR", ask=r"?TEMP\r\n", columns=["temperature"], channels={"temperature": "K"}
        ) as driver,
        pytest.raises(ProtocolError) as caught,
    ):
        asyncio.run(first_rows(driver, 1))
    assert r"the last is b'ERROR': column 1 ('temperature') is 'ERROR'" in caught.value.message


def test_supply_of_another_author_follows_and_is_safe() -> None:
    bridge = Bridge("ASRL2::INSTR")
    config = LineOutputsConfig.model_validate({
        "port": bridge.port,
        "identify": r"*IDN?\r\n",
        "ask": r":VOLT:IMM:AMPL?\r\n",
        "pattern": r"(?P<voltage>[-+]\d\.\d{8}E[-+]\d\d)",
        "channels": {"voltage": "V"},
        "outputs": {"voltage": {"unit": "V", "low": "1 V", "high": "6 V",
                                "write": r":VOLT:IMM:AMPL {voltage:.3f}\r\n"}},
        "arm": r"OUTP 1\r\n",
        "safe": r"OUTP 0\r\n",
        "state": {"ask": r"OUTP?\r\n", "safe": "0", "ready": "1"},
        "timeout": "0.2 s",
    })  # fmt: skip
    driver = LineOutputs(config, None)
    try:
        driver.open()
        driver.arm()
        deadline = time.monotonic() + TIMEOUT_S
        row: Sequence[float] | None = None
        while row is None or (row[0], int(row[1]) & READY) != (3.25, READY):
            assert time.monotonic() < deadline, row
            row = driver.read(time.monotonic_ns()) or row
            driver.write((3.25,))
            time.sleep(0.005)
        driver.make_safe()
        driver.confirm_safe()
    finally:
        driver.close()
        bridge.close()
