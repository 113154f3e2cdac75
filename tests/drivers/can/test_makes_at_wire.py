"""Each shipped profile with the simulated drive of that make, over a real bus: it runs and is safe.

Driver and simulated drive have the make from files of their own, so that both must read the maker's
documents alike.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from support.can.bench import belt, wheel
from support.can.bench_sim import Shaft

from rigd.sdk import ProtocolError, Row
from rigd.sdk.check import background_loop
from rigd_drivers import device_file
from rigd_drivers.can.bus import CanBus, CanBusConfig
from rigd_drivers.can.cia402_servo.current import CurrentServo
from rigd_drivers.can.cia402_servo.speed import SpeedServo
from rigd_sim.wire.can.drive import Cia402Drive, Mode, Motor, Ratings
from rigd_sim.wire.can.hub import CanHub
from rigd_sim.wire.can.traits import known_makes, read_make

PATIENCE_S = 10.0
WHEEL = Ratings(Mode.CST, 1.5, 2.0, 0.0295, 1024)
BELT = Ratings(Mode.CSV, 5.0, 9.0, 0.2, 4096)
#: What the rig file must add, since the drive or its documents do not tell it.
ADDED: dict[str, dict[str, Any]] = {
    "kollmorgen-akd": {"rated_current": "1.5 A"},
    "nanotec": {"force": False},
}


class Bench:
    """One drive of a make on a bus of its own, and what it does to its motor."""

    def __init__(self, make: str, node: int, ratings: Ratings, path: Path) -> None:
        self.shaft = Shaft()
        self.hub = CanHub("bus", path)
        motor = Motor(self.shaft.sense, self.shaft.command)
        traits = read_make(make)
        self.drive = Cia402Drive("drive", self.hub, node, motor, ratings, traits=traits)
        self.bus = CanBus(CanBusConfig(interface="hub", channel=str(path)))
        self.rows: list[Row] = []

    def cycle(
        self, driver: CurrentServo | SpeedServo, value: float, until: Callable[[], bool]
    ) -> None:
        """Play cycles with this setpoint until something holds."""
        deadline = time.monotonic() + PATIENCE_S
        while not until():
            assert time.monotonic() < deadline
            now = time.monotonic_ns()
            self.bus.begin(now)
            row = driver.read(now)
            self.rows += [] if row is None else [row]
            driver.write([value])
            self.bus.end(now)
            self.bus.wait(lambda: False, 0.002)


@contextmanager
def bench(make: str, node: int, ratings: Ratings) -> Iterator[Bench]:
    path = Path(tempfile.mkdtemp(prefix="rigd-", dir="/tmp")) / "bus"
    found = Bench(make, node, ratings, path)

    async def start() -> None:
        await found.hub.start()
        await found.drive.start()

    async def stop() -> None:
        await found.drive.stop()
        await found.hub.stop()

    with background_loop() as run:
        run(start())
        found.bus.open()
        try:
            yield found
        finally:
            found.bus.close()
            run(stop())
            path.parent.rmdir()


def driver_of(name: str, bus: CanBus) -> CurrentServo | SpeedServo:
    """Return the driver that a case ``current MAKE`` or ``speed MAKE`` names."""
    kind, make = name.split()
    added = dict(ADDED.get(make, {}))
    if kind == "current":
        added.pop("force", None)
        return wheel(bus, profile=make, current_range="1 A", **added)
    return belt(bus, profile=make, clutch=False, speed_range="2 m/s", **added)


CASES = [
    f"{kind} {path.stem}"
    for path in device_file.shipped("cia402")
    for kind in ("current", "speed")
    if f"{kind} {path.stem}" != "speed kollmorgen-akd"  # its unit of velocities is not known
]


@pytest.mark.parametrize("case", CASES)
def test_drive_of_the_make_runs_and_is_safe(case: str) -> None:
    kind, make = case.split()
    node, ratings = (1, WHEEL) if kind == "current" else (2, BELT)
    value = 0.6 if kind == "current" else 1.0  # 1 m/s at 100 mm a revolution: 62.83 rad/s
    wanted = 0.6 if kind == "current" else 62.83
    with bench(make, node, ratings) as found:
        driver = driver_of(case, found.bus)
        driver.open()
        assert driver.prove_watchdog() <= (driver.watchdog_s or 0.0)
        driver.arm()
        found.cycle(driver, 0.0, driver.ready)
        found.cycle(driver, value, lambda: found.shaft.demand.value != 0.0)
        assert found.shaft.demand.value == pytest.approx(wanted, rel=2e-3)
        driver.make_safe()
        driver.confirm_safe()
        assert not found.shaft.demand.powered
        assert found.drive.state()["enabled"] is False
        driver.close()


def test_every_make_has_profile_and_simulated_drive() -> None:
    assert [path.stem for path in device_file.shipped("cia402")] == known_makes()


def test_drive_of_another_make_is_not_opened() -> None:
    with bench("elmo-gold", 1, WHEEL) as found:
        driver = wheel(found.bus, profile="maxon-epos4", current_range="1 A")
        with pytest.raises(ProtocolError, match=r"vendor id 0x9A .* maxon EPOS4 expects 0xFB"):
            driver.open()


def test_drive_without_profile_is_refused() -> None:
    told = "unit of its velocities"  # which are 1 count/s; it has no object 60A9
    with bench("elmo-gold", 2, BELT) as found, pytest.raises(ProtocolError, match=told):
        belt(found.bus, clutch=False).open()


@pytest.mark.parametrize("make", ["maxon-epos4", "elmo-gold"])
def test_homed_drive_is_at_zero_and_runs(make: str) -> None:
    with bench(make, 2, BELT) as found:
        options: dict[str, Any] = {"zero": "0 count", "homing": 37, "speed_range": "2 m/s"}
        driver = belt(found.bus, profile=make, clutch=False, **options)
        driver.open()
        told: list[str] = []

        def homed() -> bool:
            assert found.shaft.demand.value == 0.0
            told.extend(filter(None, [driver.acted()]))
            return bool(told)

        driver.act("home")
        found.cycle(driver, 0.0, homed)
        assert "shows 0 counts, before 1234" in told[0]
        found.cycle(driver, 0.0, lambda: not found.shaft.demand.powered)
        assert found.rows[-1][0] == 0.0
        driver.arm()  # in the mode that it had before
        found.cycle(driver, 0.0, driver.ready)
        found.cycle(driver, 1.0, lambda: found.shaft.demand.value != 0.0)
        driver.make_safe()
        driver.close()
