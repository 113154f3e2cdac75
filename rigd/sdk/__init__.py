"""Everything that the author of a driver, link, plant or simulation imports."""

from rigd.model.channels import Channel, Stream
from rigd.model.errors import DeviceError, LinkError, ProtocolError
from rigd.sdk.documented import Documented
from rigd.sdk.driver import (
    AnyDriver,
    Block,
    BlockDriver,
    Driver,
    DriverConfig,
    EmitRow,
    SlowDriver,
)
from rigd.sdk.link import DeviceSheet, Link, LinkConfig
from rigd.sdk.plant import Plant, PlantConfig
from rigd.sdk.quantities import In
from rigd.sdk.shipped import shipped_configs
from rigd.sdk.simulation import Simulation, SimulationConfig

__all__ = [
    "AnyDriver",
    "Block",
    "BlockDriver",
    "Channel",
    "DeviceError",
    "DeviceSheet",
    "Documented",
    "Driver",
    "DriverConfig",
    "EmitRow",
    "In",
    "Link",
    "LinkConfig",
    "LinkError",
    "Plant",
    "PlantConfig",
    "ProtocolError",
    "Simulation",
    "SimulationConfig",
    "SlowDriver",
    "Stream",
    "shipped_configs",
]
