"""The servo driver against a drive of another stack that acts only when it looks."""

from __future__ import annotations

import math
from collections.abc import Iterator

import pytest
from support.cards.scanned_drive import ScannedDrive
from support.instruments.modbus_bench import cycle, rows_of

from rigd_drivers.modbus.servo import ModbusServo, ServoConfig

RPM = 2 * math.pi / 60


@pytest.fixture(params=[0.002, 0.01, 0.05])
def drive(request: pytest.FixtureRequest) -> Iterator[ScannedDrive]:
    """A served drive with a scan of 2, 10 and 50 ms, as the manuals of real ones have."""
    served = ScannedDrive(request.param)
    served.start()
    yield served
    served.stop()


@pytest.fixture
def driver(drive: ScannedDrive) -> Iterator[ModbusServo]:
    options = {"host": "127.0.0.1", "port": drive.port, "map": "schneider-atv320",
               "max_speed": "3000 rpm", "watchdog": "0.5 s", "timeout": "0.1 s"}  # fmt: skip
    made = ModbusServo(ServoConfig.model_validate(options), None)
    yield made
    made.close()


def test_drive_that_scans_arms_after_watchdog_proof(
    drive: ScannedDrive, driver: ModbusServo
) -> None:
    driver.open()
    assert not driver.preflight()
    assert driver.prove_watchdog() > 0.5
    rows_of(driver, 1)
    driver.arm()
    cycle(driver, lambda rows: driver.ready(), [0.0])
    cycle(driver, lambda rows: drive.rpm == 600, [600 * RPM])
    driver.make_safe()


def test_trip_before_arming_is_reset_in_cycle(drive: ScannedDrive, driver: ModbusServo) -> None:
    driver.open()
    rows_of(driver, 1)
    drive.trip()
    cycle(driver, lambda rows: bool(rows) and bool(int(rows[-1][-1]) & 2))
    driver.arm()
    cycle(driver, lambda rows: driver.ready(), [0.0])
