"""The scale of the simulated approach-angle rig, and the hidden truth."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import ClassVar

from rigd.sdk import Channel, DriverConfig, PlantSensor
from rigd_sim.plants.angle import layout
from rigd_sim.plants.angle.plant import AnglePlant


class AngleScale(PlantSensor):
    """The scale under the rig's base, at a pace of its own.

    A row is the mass in kg and a status word: stable 1, overload 2, underload 4 (which nothing at
    this bench brings about). Under overload the value is NaN, so that interlocks trip.
    """

    link: AnglePlant
    title: ClassVar[str] = "scale of the simulated approach-angle rig"
    channels = (Channel("mass", "kg", "net mass shown by the scale"),)
    has_status = True
    status_bits: Mapping[str, int] = {
        "stable": layout.STABLE,
        "overload": layout.OVERLOAD,
        "underload": layout.UNDERLOAD,
    }
    every_cycle = False
    silent_s = 2.0

    def __init__(self, config: DriverConfig, link: AnglePlant | None) -> None:
        super().__init__(config, link)
        self._seen = 0

    def read(self, t_ns: int) -> Sequence[float] | None:
        """Return mass and status word, None while there is no new reading."""
        self.link.advance(t_ns)
        if self.link.scale_readings == self._seen:
            return None
        self._seen = self.link.scale_readings
        mass, status = self.link.scale()
        return (math.nan if status == layout.OVERLOAD else mass), status


class AngleTruth(PlantSensor):
    """The hidden state of the plant, for verification; no real rig has it."""

    link: AnglePlant
    title: ClassVar[str] = "hidden state of the simulated approach-angle rig"
    channels = tuple(Channel(name, unit, doc) for name, unit, doc in layout.TRUTH)

    def read(self, t_ns: int) -> Sequence[float]:
        """Return the hidden state in the order of ``channels``."""
        self.link.advance(t_ns)
        return self.link.truth
