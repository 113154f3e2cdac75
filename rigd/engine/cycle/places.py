"""Finds the places of devices in the tables of the cycle."""

from __future__ import annotations

from typing import NamedTuple

from rigd.engine.cycle.mount import Mount
from rigd.sdk import Driver


class DevicePlaces(NamedTuple):
    """A device as the cycle reads it; ``places`` are those of its ``width`` values."""

    name: str
    driver: Driver
    places: slice
    width: int

    @classmethod
    def of(cls, mount: Mount) -> DevicePlaces:
        """Return the places of the device of ``mount``."""
        places, driver = mount.values, mount.driver
        return cls(mount.name, driver, places, places.stop - places.start)
