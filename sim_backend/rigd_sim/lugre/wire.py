"""Serves all devices of the simulated LuGre rig in one process, on one plant, in real time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar, Self

from pydantic import Field, model_validator

from rigd.sdk import SimulationConfig, wrong_entry
from rigd_sim.lugre.plant import LugreConfig, LugrePlant
from rigd_sim.lugre.wire_parts import Bench, DeviceOptions, build_parts, with_makes
from rigd_sim.lugre.world import World
from rigd_sim.wire.can.hub import CanHub
from rigd_sim.wire.can.options import BusOptions
from rigd_sim.wire.folder import Folder
from rigd_sim.wire.part import Part
from rigd_sim.wire.service import PLANT_PERIOD_NS, WirePlantConfig, WirePlantSimulation


class WireLugreConfig(WirePlantConfig, DeviceOptions):
    """The addresses of the simulated devices, their plant, and the options of each device."""

    plant: LugreConfig = LugreConfig()
    """The physics."""
    buses: dict[str, BusOptions] = Field(
        default_factory=lambda: {"servo_bus": BusOptions(), "encoder_bus": BusOptions()}
    )
    """CAN buses by name; each is a socket of that name in the folder."""

    @model_validator(mode="after")
    def _buses_exist(self) -> Self:
        for name in DeviceOptions.model_fields:
            bus = getattr(getattr(self, name), "bus", None)
            if bus is not None and bus not in self.buses:
                raise wrong_entry(
                    f"{name} is on bus {bus!r}; `buses` has {', '.join(self.buses)}", name, "bus"
                )
        for name, sensor in self.can_sensors.items():
            if sensor.bus not in self.buses:
                known = ", ".join(self.buses) or "none"
                raise wrong_entry(
                    f"{name} is on bus {sensor.bus!r}; `buses` has {known}",
                    "can_sensors",
                    name,
                    "bus",
                )
            if name in {*DeviceOptions.model_fields, *self.buses}:
                raise wrong_entry(
                    f"{name} of `can_sensors` is the name of another part: rename it",
                    "can_sensors",
                    name,
                )
        return self


class WireLugre(WirePlantSimulation):
    """Serves the devices of the LuGre rig, and a control socket beside them."""

    Config: ClassVar[type[SimulationConfig]] = WireLugreConfig
    title: ClassVar[str] = "the LuGre rig at the wire: CAN servos and encoders in real time"
    config: WireLugreConfig

    @classmethod
    def of_makes(cls, config: WireLugreConfig, makes: Mapping[str, str]) -> WireLugreConfig:
        """Return ``config`` with drives of these makes; see :meth:`Simulation.of_makes`."""
        return config.model_copy(update=with_makes(config, makes))

    def build(self, folder: Folder) -> tuple[World, Sequence[Part]]:
        """Return the plant in real time and every device; see :class:`WireSimulation`."""
        config = self.config
        world = World(LugrePlant(config.plant, period_ns=PLANT_PERIOD_NS, seed=config.seed))
        hubs = {
            name: CanHub(name, folder.socket(name), bitrate=bus.bitrate, seed=config.seed + number)
            for number, (name, bus) in enumerate(config.buses.items())
        }
        bench = Bench(world, hubs, folder, config.seed)
        return world, [*hubs.values(), *build_parts(config, bench)]
