"""Every driver that comes with rigd keeps the promises of the SDK."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

import pytest

from rigd.config.loader import load_rig
from rigd.sdk.check import FAULTS, Observed, Peer, check_driver
from rigd.sdk.shipped_files import shipped_folder
from rigd_sim.articulated.drive import ArticulatedDrive
from rigd_sim.articulated.plant import ArticulatedConfig, ArticulatedPlant
from rigd_sim.articulated.sensors import ArticulatedTracker, ArticulatedTruth
from rigd_sim.lugre import layout
from rigd_sim.lugre.amplifier import LugreAmplifier
from rigd_sim.lugre.belt import LugreBelt
from rigd_sim.lugre.plant import LugreConfig, LugrePlant
from rigd_sim.lugre.sensors import LugreAccelerometer, LugreEncoder, LugreTruth

#: Options of drivers that no shipped rig has; the suite needs some to construct them.
OPTIONS: dict[str, dict[str, Any]] = {
    "sim-fmu": {"inputs": {"torque": {"variable": "T", "unit": "N m", "low": "-1 N m",
                                       "high": "1 N m"}},
                "outputs": {"speed": {"variable": "omega", "unit": "rad/s"}}},
    "modbus-transmitter": {"host": "cell", "map": "laumas-tlb4", "low": "-500 N", "high": "500 N",
                           "scale": "0.01 N/count"},
    "cia404-transmitter": {"node": 21, "unit": "5 N", "low": "-1500 N", "high": "1500 N"},
    "card-frequency": {"counter": 1, "name": "speed", "unit": "rpm", "scale": "1 rev/count",
                       "width": True},
    "card-pulses": {"counter": 0, "name": "volume", "unit": "m^3", "scale": "0.5 cm^3/count"},
    "pymeasure": {"instrument": "pymeasure.instruments.keithley.Keithley2000",
                  "address": "GPIB0::16::INSTR",
                  "channels": {"voltage": {"read": "voltage", "unit": "V"}}},
    "modbus-servo": {"host": "drive", "map": "schneider-atv320", "max_speed": "300 rpm",
                     "watchdog": "0.5 s"},
    "line-outputs": {"port": "tcp://supply:5025", "ask": r"MEAS:VOLT?\n",
                     "pattern": r"(?P<u>\d+\.\d+)",
                     "channels": {"u": {"unit": "V", "low": "0 V", "high": "30 V"}},
                     "outputs": {"u": {"unit": "V", "low": "0 V", "high": "30 V",
                                       "write": r"VOLT {u:.3f}\n"}},
                     "safe": [r"OUTP OFF\n"], "arm": r"OUTP ON\n",
                     "state": {"ask": r"OUTP?\n", "safe": "0", "ready": "1"}},
}  # fmt: skip


#: Drivers whose options need a file or plant that is not shipped; their own tests hold them to the
#: suite.
ELSEWHERE = {"can-message", "fmu-in-loop", "sim-mechanism", "sim-mechanism-truth"}


RIGS = sorted(shipped_folder("configs").glob("*.yaml"))


@pytest.mark.parametrize("file", RIGS, ids=lambda file: file.stem)
def test_every_device_of_shipped_rig_declares_itself_well(file: Path) -> None:
    for device in load_rig(file).devices.values():
        check_driver(device.driver_class, device.config)


@pytest.mark.parametrize("name", sorted(OPTIONS))
def test_other_drivers_declare_themselves_well(name: str) -> None:
    (point,) = entry_points(group="rigd.drivers", name=name)
    check_driver(point.load(), OPTIONS[name])


def test_no_driver_is_left_out() -> None:
    shipped = {
        point.name
        for point in entry_points(group="rigd.drivers")
        if point.dist is not None and point.dist.name == "rigd"
    }
    assert (
        shipped
        <= {device.driver for file in RIGS for device in load_rig(file).devices.values()}
        | OPTIONS.keys()
        | ELSEWHERE
    )


def lugre() -> LugrePlant:
    return LugrePlant(LugreConfig(), period_ns=1_000_000, seed=1)


def robot() -> ArticulatedPlant:
    return ArticulatedPlant(ArticulatedConfig(), period_ns=1_000_000, seed=1)


class PlantPeer:
    """Makes a plant for one device, and looks at what the device commands."""

    def __init__(
        self, make: Callable[[], Any], actuated: Callable[[Sequence[Any]], Observed]
    ) -> None:
        self._make = make
        self._actuated = actuated

    @contextmanager
    def __call__(self) -> Iterator[Peer]:
        made: list[Any] = []

        def link() -> Any:
            made.append(self._make())
            return made[-1]

        yield Peer(link=link, observed=lambda: self._actuated(made[-1].commands.tolist()))


def wheel(commands: Sequence[float]) -> Observed:
    enabled = bool(commands[layout.WHEEL_ENABLED])
    return Observed((commands[layout.WHEEL_CURRENT] if enabled else 0.0,), enabled)


def belt(commands: Sequence[float], first: int) -> Observed:
    """A belt is safe while it is braked: speed zero, and the clutch engaged."""
    driven = (commands[first], commands[first + 1])
    return Observed(driven, energised=driven != (0.0, 1.0))


def along(commands: Sequence[float]) -> Observed:
    return belt(commands, layout.BELT_COMMANDS)


def across(commands: Sequence[float]) -> Observed:
    return belt(commands, layout.LATERAL_COMMANDS)


def motor(commands: Sequence[Sequence[float]]) -> Observed:
    target, enabled = commands[0]
    return Observed((target if enabled else 0.0,), bool(enabled))


def sensor(commands: Sequence[Any]) -> Observed:
    return Observed()


@pytest.mark.parametrize(
    ("driver", "options", "make", "observed"),
    [
        (LugreAmplifier, {}, lugre, wheel),
        (LugreBelt, {"axis": "longitudinal"}, lugre, along),
        (LugreBelt, {"axis": "lateral"}, lugre, across),
        (LugreEncoder, {"axis": "wheel"}, lugre, sensor),
        (LugreAccelerometer, {}, lugre, sensor),
        (LugreTruth, {}, lugre, sensor),
        (
            ArticulatedDrive,
            {"module": "front", "wheel": "front_right", "torque_range": "0.1 N m"},
            robot,
            motor,
        ),
        (ArticulatedTracker, {"module": "rear"}, robot, sensor),
        (ArticulatedTruth, {"module": "front"}, robot, sensor),
    ],
)
def test_devices_in_process_work_as_drivers_do(
    driver: type[Any],
    options: dict[str, Any],
    make: Callable[[], Any],
    observed: Callable[[Sequence[Any]], Observed],
) -> None:
    report = check_driver(driver, options, peer=PlantPeer(make, observed))
    assert set(report.skipped.values()) == {
        f"the peer has no fault '{fault}'"
        for fault in FAULTS
        if fault not in {"lossy", "cut", "flooding"}
    }
