"""Finds the poses of bodies in a plane among the channels of streams, by name and unit."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final, Protocol

#: The units of a position and of a heading.
POSITION_UNIT: Final = "m"
HEADING_UNIT: Final = "rad"


class NamedChannel(Protocol):
    """What is needed of a channel."""

    @property
    def name(self) -> str:
        """Its name in its stream."""
        ...

    @property
    def unit(self) -> str:
        """Its SI unit."""
        ...


class NamedStream(Protocol):
    """What is needed of a stream."""

    @property
    def name(self) -> str:
        """Its name."""
        ...

    @property
    def channels(self) -> Sequence[NamedChannel]:
        """Its channels."""
        ...


@dataclass(frozen=True)
class Pose:
    """A body in a plane: the channels of ``stream`` with its position in m and heading in rad.

    The heading counts from the x axis towards the y axis; None if it is not measured.
    """

    body: str
    stream: str
    x: str
    y: str
    heading: str | None


def poses_of(streams: Iterable[NamedStream]) -> tuple[Pose, ...]:
    """Return the poses in ``streams``, in their order.

    A pose is two channels of one stream in m whose names differ in ``x`` and ``y`` alone, and the
    channel in rad that has ``heading`` instead: ``x``, ``y``, ``heading``, or ``cart_x``,
    ``cart_y``, ``cart_heading``.
    """
    return tuple(pose for stream in streams for pose in _of_stream(stream))


def _of_stream(stream: NamedStream) -> Iterator[Pose]:
    units = {channel.name: channel.unit for channel in stream.channels}
    for name, unit in units.items():
        parts = name.split("_")
        if unit != POSITION_UNIT or parts.count("x") != 1:
            continue
        at = parts.index("x")
        rest = [*parts[:at], *parts[at + 1 :]]
        y, heading = ("_".join([*parts[:at], word, *parts[at + 1 :]]) for word in ("y", "heading"))
        if units.get(y) == POSITION_UNIT:
            found = heading if units.get(heading) == HEADING_UNIT else None
            yield Pose(" ".join([stream.name, *rest]), stream.name, name, y, found)
