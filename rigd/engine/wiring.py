"""Wires a rig from its file: plant, devices, limiter, interlocks and the cycle they stand in."""

from __future__ import annotations

from dataclasses import dataclass

from rigd.config.rig import DeviceConfig, RigConfig
from rigd.engine.clock import Clock
from rigd.engine.control import Control
from rigd.engine.cycle import Cycle
from rigd.engine.interlocks import InterlockBank
from rigd.engine.limiter import Limiter
from rigd.engine.mount import mount
from rigd.model.errors import Blocked
from rigd.sdk import Driver, Plant


def _fast(device: DeviceConfig, link: object) -> Driver:
    driver = device.driver_class(device.config, link)
    if not isinstance(driver, Driver):
        raise Blocked([f"{device.name}: {device.driver} cannot stand in the cycle"])
    return driver


@dataclass(frozen=True)
class Wiring:
    """A rig ready to be played on; ``plant`` is None for real hardware."""

    cycle: Cycle
    plant: Plant | None


def wire(rig: RigConfig, clock: Clock, control: Control, seed: int) -> Wiring:
    """Return the wired rig; nothing is opened yet.

    Raises:
        Blocked: the rig has no plant, and no driver here opens real links yet.
    """
    if rig.plant is None:
        raise Blocked([f"rig {rig.name!r} has no `plant`: only simulated rigs can run so far"])
    plant = rig.plant.plant_class(rig.plant.config, period_ns=rig.period_ns, seed=seed)
    devices: dict[str, tuple[str, Driver]] = {
        name: (device.driver, _fast(device, plant)) for name, device in rig.devices.items()
    }
    mounted = mount(devices)
    limits = [
        device.limits[setpoint.name]
        for device in rig.devices.values()
        for setpoint in device.setpoints
    ]
    units = {
        f"{one.name}.{channel.name}": channel.unit
        for one in mounted.mounts
        for channel in one.driver.channels
    }
    interlocks = InterlockBank(rig.interlocks, mounted.readings, units, mounted.device_of)
    limiter = Limiter(limits, rig.period_ns * 1e-9)
    return Wiring(Cycle(mounted, limiter, interlocks, clock, control), plant)
