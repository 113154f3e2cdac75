"""Advances a plant to CLOCK_MONOTONIC whenever a device at the wire reads it."""

from __future__ import annotations

import time
from typing import Generic, TypeVar

from rigd.sdk import Plant

PlantT = TypeVar("PlantT", bound=Plant)


class PlantWorld(Generic[PlantT]):
    """A plant that all devices of a bench share, in real time; for one thread."""

    def __init__(self, plant: PlantT) -> None:
        self.plant = plant
        self.now()

    def at(self, t_ns: int) -> None:
        """Bring the plant to ``t_ns``, unless a device has looked later."""
        if not self.plant.begun or t_ns > self.plant.now_ns:
            self.plant.advance(t_ns)

    def now(self) -> None:
        """Bring the plant to this moment."""
        self.at(time.monotonic_ns())

    def change(self, quantity: str, value: float | str) -> None:
        """Change the bench at this moment; see :meth:`rigd.sdk.Plant.change`."""
        self.now()
        self.plant.change(quantity, value)
