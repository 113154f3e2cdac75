"""Builds the control cycle of a rig from its devices, limiter and interlocks; opens nothing.

Devices are connected to a simulated plant or to links (a bus, a serial line, a card).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rigd.computed.controllers.driver import Controller, ControllerConfig
from rigd.computed.derived.driver import Derived, DerivedConfig
from rigd.config.rig import DeviceConfig, RigConfig
from rigd.engine.clock import Clock
from rigd.engine.cycle.cycle import Cycle
from rigd.engine.cycle.limiter import Limiter
from rigd.engine.cycle.mount import CYCLE_STREAM, mount, recorded_stream
from rigd.engine.cycle.plant_blocks import PlantBlocks
from rigd.engine.play.control import Control
from rigd.engine.play.interlocks import InterlockBank
from rigd.model.channels import Stream
from rigd.model.errors import Blocked
from rigd.sdk import BlockDriver, Driver, Link, Plant

if TYPE_CHECKING:
    from rigd.computed.controllers.bank import Bank
    from rigd.computed.derived.evaluator import Evaluator

#: ``stand_in(device)``: returns the driver that replaces an off-cycle device in the cycle.
StandIn = Callable[[DeviceConfig], Driver]


@dataclass(frozen=True)
class Wiring:
    """The cycle of a rig; ``plant`` is None if the devices are reached by links.

    ``bank`` computes its controllers; None without.
    """

    cycle: Cycle
    plant: Plant | None
    bank: Bank | None


def in_cycle(device: DeviceConfig) -> bool:
    """Return whether the cycle itself exchanges with the device."""
    kind = device.driver_class
    return issubclass(kind, Driver) or (issubclass(kind, BlockDriver) and kind.on_plant)


def streams_of(rig: RigConfig) -> Sequence[Stream]:
    """Return every stream that a run on ``rig`` can record; opens and starts nothing."""
    recorded = (
        recorded_stream(name, device.driver, device.driver_class.title, device.declaration)
        for name, device in rig.devices.items()
    )
    return [*recorded, CYCLE_STREAM]


def wire(
    rig: RigConfig, clock: Clock, control: Control, seed: int, stand_in: StandIn | None = None
) -> Wiring:
    """Return the wired rig; nothing is opened yet.

    Raises:
        Blocked: an off-cycle device has no stand-in; or a device is simulated on a plant, and the
            rig has no plant.
    """
    plant = None
    if rig.plant is not None:
        plant = rig.plant.plant_class(rig.plant.config, period_ns=rig.period_ns, seed=seed)
    links = {name: setup.link_class(setup.config) for name, setup in rig.links.items()}
    evaluator, bank = evaluator_of(rig), bank_of(rig)
    devices: dict[str, tuple[str, Driver]] = {
        name: (device.driver, _driver(device, plant, links, stand_in, evaluator, bank))
        for name, device in rig.devices.items()
    }
    mounted = mount(devices, links)
    limits = [
        device.limits[setpoint.name]
        for device in rig.devices.values()
        for setpoint in device.setpoints
    ]
    units = {
        f"{device.name}.{channel.name}": channel.shown_in
        for device in rig.devices.values()
        for channel in device.channels
    }
    interlocks = InterlockBank(
        rig.interlocks, mounted.readings, units, mounted.stamp_of, mounted.setpoints
    )
    targets = [] if bank is None else [mounted.setpoints[name] for name in bank.loops]
    limiter = Limiter(limits, rig.period_ns * 1e-9, targets)
    at_rest = rig.supervision.at_rest
    cycle = Cycle(mounted, limiter, interlocks, clock, control, evaluator, bank, at_rest)
    return Wiring(cycle, plant, bank)


def evaluator_of(rig: RigConfig) -> Evaluator | None:
    """Return what computes the derived channels of ``rig``: one graph for all; None without.

    The first call after an installation compiles it, which takes seconds.
    """
    configs = (device.config for device in rig.devices.values())
    graphs = [config.graph for config in configs if isinstance(config, DerivedConfig)]
    if not graphs:
        return None
    from rigd.computed.derived.evaluator import Evaluator  # it loads numba

    return Evaluator(graphs[0])


def bank_of(rig: RigConfig) -> Bank | None:
    """Return what computes the controllers of ``rig``, all at once; None without.

    The first call after an installation compiles it, which takes seconds.
    """
    devices = rig.devices.values()
    configs = [item.config for item in devices if isinstance(item.config, ControllerConfig)]
    if not configs:
        return None
    from rigd.computed.controllers.bank import Bank  # it loads numba

    limits = {
        f"{item.name}.{name}": limit for item in devices for name, limit in item.limits.items()
    }
    return Bank(configs, limits, rig.period_ns * 1e-9)


def _driver(
    device: DeviceConfig,
    plant: Plant | None,
    links: Mapping[str, Link],
    stand_in: StandIn | None,
    evaluator: Evaluator | None,
    bank: Bank | None,
) -> Driver:
    if bank is not None and isinstance(device.config, ControllerConfig):
        return Controller(device.config, bank)
    if evaluator is not None and isinstance(device.config, DerivedConfig):
        return Derived(device.config, evaluator)
    if issubclass(device.driver_class, Driver):
        driver = _fast(device, plant if device.link is None else links[device.link])
        driver.lockstep = stand_in is None  # all in one process: cycles need not keep the time
        return driver
    if in_cycle(device):
        if plant is None:
            raise Blocked(
                [f"{device.name}: {device.driver} is simulated on a plant, and there is no plant"]
            )
        return PlantBlocks(device, plant)
    if stand_in is None:
        raise Blocked(
            [f"{device.name}: {device.driver} is an off-cycle device, which needs real time"]
        )
    return stand_in(device)


def _fast(device: DeviceConfig, link: Plant | Link | None) -> Driver:
    driver = device.driver_class(device.config, link)
    if not isinstance(driver, Driver):
        raise TypeError(f"{device.driver} is not a fast driver")
    driver.declaration = device.declaration  # with the display units of the rig file
    return driver
