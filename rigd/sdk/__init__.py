"""Provides all names that the author of a driver, link, plant or simulation imports."""

from rigd.model.channels import Channel, Stream
from rigd.model.errors import DeviceError, LinkError, ProtocolError
from rigd.model.machine.system import dropped, readable
from rigd.sdk.declaration import Declaration, Input
from rigd.sdk.driver import (
    AnyDriver,
    Block,
    BlockDriver,
    Driver,
    DriverConfig,
    EmitRow,
    SlowDriver,
)
from rigd.sdk.idle_reader import IdleReader
from rigd.sdk.link import DeviceSheet, Link, LinkConfig
from rigd.sdk.options.documented_model import Documented, WrongEntries, about_entry, wrong_entry
from rigd.sdk.options.quantities import In
from rigd.sdk.parameters import ParameterGroup, ParametersConfig
from rigd.sdk.plant import Energy, GridPlant, Plant, PlantConfig
from rigd.sdk.plant_sensor import PlantSensor, accepted
from rigd.sdk.row import Row
from rigd.sdk.setting import Setting
from rigd.sdk.shipped_files import shipped_configs
from rigd.sdk.simulation import Simulation, SimulationConfig

__all__ = [
    "AnyDriver",
    "Block",
    "BlockDriver",
    "Channel",
    "Declaration",
    "DeviceError",
    "DeviceSheet",
    "Documented",
    "Driver",
    "DriverConfig",
    "EmitRow",
    "Energy",
    "GridPlant",
    "IdleReader",
    "In",
    "Input",
    "Link",
    "LinkConfig",
    "LinkError",
    "ParameterGroup",
    "ParametersConfig",
    "Plant",
    "PlantConfig",
    "PlantSensor",
    "ProtocolError",
    "Row",
    "Setting",
    "Simulation",
    "SimulationConfig",
    "SlowDriver",
    "Stream",
    "WrongEntries",
    "about_entry",
    "accepted",
    "dropped",
    "readable",
    "shipped_configs",
    "wrong_entry",
]
