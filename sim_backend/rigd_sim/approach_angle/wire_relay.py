"""Simulates the relay of the approach-angle rig: the state of its contact, and its faults."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from rigd_sim.approach_angle.world import AngleWorld
from rigd_sim.wire.part import Part, State


class SimRelay(Part):
    """The relay, which hangs on lines of the card; it serves nothing itself."""

    faults: ClassVar[Mapping[str, str]] = {
        "welded": "the contact stays closed with any coil current",
        "broken": "the contact never closes",
        "one_shot_dead": "the one-shot stays up for ever",
    }

    def __init__(self, name: str, world: AngleWorld, where: str) -> None:
        self.name = name
        self._world = world
        self._where = where
        self._shown: set[str] = set()

    async def start(self) -> str:
        """Return which line it is wired to."""
        return f"{self.name}: relay on {self._where}"

    async def stop(self) -> None:
        """Nothing is open."""

    def state(self) -> State:
        """Return what coil, contact and one-shot do; times are CLOCK_MONOTONIC, in ns.

        ``opened_...`` is where the platform was when the coil lost its current, and
        ``furthest_position`` where it has been since the coil last got any.
        """
        world = self._world
        world.now()
        opened = world.opened
        return {
            "coil": not world.safe_since_ns,
            "contact": world.plant.closed,
            "one_shot": world.one_shot_up(),
            "safe_since_ns": world.safe_since_ns,
            "closings": world.closings,
            "opened_ns": opened.at_ns,
            "opened_position": opened.position,
            "opened_speed": opened.speed,
            "opened_volts": opened.volts,
            "furthest_position": world.furthest,
            "refused": world.refused,
        }

    def inject(self, fault: str, **options: Any) -> None:
        """Show a fault of :attr:`faults`; see :meth:`Part.inject`."""
        if fault not in self.faults or options:
            raise ValueError(
                f"{self.name} has no fault {fault!r} with options {sorted(options)}; it knows "
                + "; ".join(f"{name}: {doc}" for name, doc in self.faults.items())
            )
        if fault == "one_shot_dead" and self._world.one_shot is None:
            raise ValueError(f"{self.name} stands behind no one-shot")
        self._shown.add(fault)
        self._apply()

    def clear(self, fault: str | None = None) -> None:
        """Stop showing ``fault``, or all of them."""
        self._shown -= set(self.faults) if fault is None else {fault}
        self._apply()

    def _apply(self) -> None:
        world = self._world
        if world.one_shot is not None:
            world.one_shot.dead = "one_shot_dead" in self._shown
        world.spoil(welded="welded" in self._shown, broken="broken" in self._shown)
