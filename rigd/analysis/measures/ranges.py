"""Finds the sensors and formulas behind a channel, and samples at the end of a sensor's range."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from rigd.model.channels import ECHO, Channel
from rigd.model.units import format_quantity
from rigd.record import Recording

#: A channel in a formula; units and functions have no dot.
_NAME = re.compile(r"\b[a-z][a-z0-9_]*\.[a-z][a-z0-9_]*\b")
#: The words and signs of a formula, without the spaces between them.
_WORDS = re.compile(r"\w+(?:\.\w+)*|[^\w\s]")
#: What the name of a constant of the rig begins with in a formula.
_RIG: Final = "rig."


@dataclass(frozen=True)
class Sensor:
    """A channel with a range, by its name in the recording."""

    name: str
    channel: Channel

    def end(self, values: NDArray[np.float64]) -> tuple[int, str]:
        """Return how many of ``values`` (n,) are at an end of the range, and which, in words."""
        low, high = self.channel.ends
        for bound, beyond in (
            (self.channel.low, values <= low),
            (self.channel.high, values >= high),
        ):
            if beyond.any():
                shown = format_quantity(bound, self.channel.shown_in)
                return int(beyond.sum()), f"{self.name} at the end of its range, {shown}"
        return 0, ""


@dataclass(frozen=True)
class Sensors:
    """The sensors behind each channel of a recording: itself, its raw value, those of a formula."""

    channels: Mapping[str, Channel]
    formulas: Mapping[str, str]

    @classmethod
    def of(cls, recording: Recording, formulas: Mapping[str, str]) -> Self:
        """Return those of ``recording``; ``formulas`` are those of its derived channels."""
        channels = {
            f"{stream.name}.{channel.name}": channel
            for stream in recording.streams.values()
            for channel in stream.channels
        }
        return cls(channels, formulas)

    def behind(self, name: str) -> Sequence[Sensor]:
        """Return the sensors that a channel rests on, those without an end left out."""
        reached = self._reached(name)
        found = (Sensor(item, self.channels[item]) for item in reached if item in self.channels)
        return [sensor for sensor in found if any(map(math.isfinite, sensor.channel.ends))]

    def rounds(self, name: str) -> bool:
        """Whether equal values of a channel may come of a sensor's step: not of a switch."""
        channel = self.channels.get(name)
        return channel is None or not (channel.is_share or name.endswith(ECHO))

    def constants(self, name: str) -> Sequence[str]:
        """Return the constants of the rig in the formulas that a channel rests on."""
        reached = self._reached(name)
        return [item.removeprefix(_RIG) for item in reached if item.startswith(_RIG)]

    def formulas_behind(self, names: Collection[str]) -> dict[str, str]:
        """Return the formulas that channels rest on, by the channel that each gives."""
        reached = dict.fromkeys(item for name in names for item in self._reached(name))
        return {item: self.formulas[item] for item in reached if item in self.formulas}

    def _reached(self, name: str) -> Sequence[str]:
        reached, waiting = dict[str, None](), [name]
        while waiting:
            item = waiting.pop()
            if item in reached:
                continue
            reached[item] = None
            waiting += _NAME.findall(self.formulas.get(item, ""))
            device, _, short = item.partition(".")
            waiting += [
                other
                for other, channel in self.channels.items()
                if channel.raw_of == short and other.partition(".")[0] == device
            ]
        return list(reached)


def changed_formula(first: Mapping[str, str], second: Mapping[str, str]) -> str | None:
    """Return a channel whose formula is another in ``second``; spaces do not count.

    A formula that only one of them states, as of an unreadable rig file, cannot be compared.
    """
    for name in first.keys() & second.keys():
        if _WORDS.findall(first[name]) != _WORDS.findall(second[name]):
            return name
    return None
