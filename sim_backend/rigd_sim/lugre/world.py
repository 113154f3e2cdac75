"""Advances the plant of the LuGre rig to CLOCK_MONOTONIC whenever a device reads the plant."""

from __future__ import annotations

import time
from collections.abc import Callable

from rigd_sim.lugre import layout
from rigd_sim.lugre.plant import LugrePlant
from rigd_sim.wire.part import State


class World:
    """The simulated rig that all devices of the bench share; for one thread."""

    def __init__(self, plant: LugrePlant) -> None:
        self.plant = plant
        self._t_ns = 0

    def at(self, t_ns: int) -> list[float]:
        """Return the readings at ``t_ns``, or later ones if a device has read later."""
        if t_ns > self._t_ns:
            self._t_ns = t_ns
            self.plant.advance(t_ns)
        return self.plant.readings

    def now(self) -> list[float]:
        """Return the readings at this moment."""
        return self.at(time.monotonic_ns())

    def reading(self, index: int) -> Callable[[], float]:
        """Return a function that gives the reading ``index`` (``layout``) of the moment."""
        return lambda: self.now()[index]

    def command(self, t_ns: int, first: int, *values: float) -> None:
        """Change commands (``layout``) from ``first`` on, as of ``t_ns``."""
        self.at(t_ns)
        self.plant.commands[first : first + len(values)] = values

    def change(self, quantity: str, value: float | str) -> None:
        """Change the bench at this moment; see :meth:`LugrePlant.change`."""
        self.now()
        self.plant.change(quantity, value)

    def state(self) -> State:
        """Return the hidden state of the plant, and what lies on the bench."""
        truth = self.now()[layout.TRUTH_READINGS :]
        names = (name for name, _, _ in layout.TRUTH)
        return {
            **dict(zip(names, truth, strict=True)),
            "floor": self.plant.floor,
            "mass": self.plant.mass,
        }
