"""Defines how a rig file describes a simulated CAN bus, and a CANopen node or drive on it."""

from __future__ import annotations

from typing import Annotated

from annotated_types import Ge, Gt, Le
from pydantic import BeforeValidator

from rigd.sdk import In, SimulationConfig
from rigd_sim.wire.can.traits import DriveTraits, as_make

NodeId = Annotated[int, Ge(1), Le(127)]


class BusOptions(SimulationConfig):
    """One CAN bus; its socket stands in the folder under the bus's name."""

    bitrate: Annotated[float, In("bit/s"), Gt(0), Le(1e6)] | None = None
    """Frames take their time at this rate, the lowest id first; without it they take none."""


class NodeOptions(SimulationConfig):
    """The bus, node id and serial number of a CANopen node."""

    bus: str
    """The bus of `buses` that it is on."""
    node: NodeId
    """Its node id."""
    serial: Annotated[int, Ge(0), Le(0xFFFFFFFF)] = 1
    """Serial number, object 1018:4."""


class ServoOptions(NodeOptions):
    """A servo drive; the wheel's ratings are those of the plant's motor."""

    rpdo_timer: bool = False
    """Whether it watches the time between RPDOs (objects 1400:5 ...); the EPOS4 does not."""
    profile: Annotated[DriveTraits, BeforeValidator(as_make)] | None = None
    """Make of the drive, by name (elmo-gold, kollmorgen-akd, maxon-epos4, nanotec), or what it is
    like; none: as CiA 402 has it."""
