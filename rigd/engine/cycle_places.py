"""Finds the places of devices and of derived channels in the tables of the cycle."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from rigd.engine.mount import Mount
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


def runs(groups: Sequence[tuple[int, slice, int]]) -> Iterator[tuple[slice, slice, slice]]:
    """Yield what is computed and follows one another, to be taken at once.

    A group of derived channels, or a controller, is a mount.

    ``groups`` have the number of their mount, their places in the table of values, and where their
    results begin. The slices are those of mounts, values and results.
    """
    first = 0
    for place, (mount, values, at) in enumerate(groups):
        width = values.stop - values.start
        if place + 1 < len(groups):
            following, _, then = groups[place + 1]
            if following == mount + 1 and then == at + width:
                continue
        begin, start, origin = groups[first]
        yield slice(begin, mount + 1), slice(start.start, values.stop), slice(origin, at + width)
        first = place + 1
