"""Simulates the scale of the approach-angle rig, and gives the true state of its plant."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import ClassVar

from rigd.sdk import Channel, Declaration, DriverConfig, PlantSensor, Row
from rigd_sim.approach_angle import layout
from rigd_sim.approach_angle.plant import AnglePlant


class MassRow(Row):
    """What the scale shows."""

    mass: float
    status: int


class AngleScale(PlantSensor[DriverConfig, AnglePlant]):
    """The scale under the rig's base, which updates at its own rate.

    A row is the mass in kg and a status word: stable 1, overload 2, underload 4 (which nothing at
    this bench brings about). Under overload the value is NaN, so that interlocks trip.
    """

    title: ClassVar[str] = "scale of the simulated approach-angle rig"

    def __init__(self, config: DriverConfig, link: AnglePlant) -> None:
        super().__init__(config, link)
        self._seen = 0

    @classmethod
    def declare(cls, config: DriverConfig) -> Declaration:
        """Return the mass, which comes at the scale's own pace."""
        return Declaration(
            channels=(Channel("mass", "kg", "net mass shown by the scale"),),
            row=MassRow,
            status_bits={
                "stable": layout.STABLE,
                "overload": layout.OVERLOAD,
                "underload": layout.UNDERLOAD,
            },
            every_cycle=False,
            silent_s=2.0,
        )

    def read(self, t_ns: int) -> MassRow | None:
        """Return mass and status word, None while there is no new reading."""
        self.link.advance(t_ns)
        if self.link.scale_readings == self._seen:
            return None
        self._seen = self.link.scale_readings
        mass, status = self.link.scale()
        return MassRow.of(mass=math.nan if status == layout.OVERLOAD else mass, status=status)


class AngleTruth(PlantSensor[DriverConfig, AnglePlant]):
    """The hidden state of the plant, for verification; no real rig has it."""

    title: ClassVar[str] = "hidden state of the simulated approach-angle rig"

    @classmethod
    def declare(cls, config: DriverConfig) -> Declaration:
        """Return the hidden state that the plant lists."""
        channels = tuple(Channel(name, unit, doc) for name, unit, doc in layout.TRUTH)
        return Declaration(channels=channels, plain_rows=True)

    def read(self, t_ns: int) -> Sequence[float]:
        """Return the hidden state in the order of ``layout.TRUTH``."""
        self.link.advance(t_ns)
        return self.link.truth
