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


def runs(groups: Sequence[tuple[int, slice]]) -> Iterator[tuple[slice, slice, slice]]:
    """Yield groups of derived channels that follow one another, to be taken at once.

    ``groups`` have the number of their mount and their places in the table of values, in the order
    of the graph. The slices are those of mounts, values and results.
    """
    at = first = 0
    for place, (mount, values) in enumerate(groups):
        if place + 1 < len(groups) and groups[place + 1][0] == mount + 1:
            continue
        begin, start = groups[first]
        width = values.stop - start.start
        yield slice(begin, mount + 1), slice(start.start, values.stop), slice(at, at + width)
        at, first = at + width, place + 1
