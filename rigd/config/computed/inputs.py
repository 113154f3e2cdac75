"""Checks what devices take of the rest of the rig: that it is there, in a unit that fits."""

from __future__ import annotations

from collections.abc import Sequence

from rigd.config.document import Document
from rigd.config.problems import Problems, suggest
from rigd.config.rig import RigConfig
from rigd.model.units import parse_unit


def check_inputs(
    document: Document, rig: RigConfig, known: Sequence[str], problems: Problems
) -> None:
    """Note the inputs of devices that are no channel of ``rig``, or one of another unit.

    ``known`` are the names to suggest.
    """
    for device in rig.devices.values():
        for item in device.declaration.inputs:
            place = document.place(("devices", device.name, "options", *item.path))
            channel = rig.recorded(item.channel)
            if channel is None:
                problems.add(
                    place, f"unknown channel {item.channel!r}",
                    suggest(item.channel, known),
                )  # fmt: skip
            elif not parse_unit(channel.unit).same_kind(parse_unit(item.unit)):
                problems.add(
                    place,
                    f"{item.channel} is in {channel.unit}, and {device.name} takes {item.unit}",
                    "give another channel, or a derived one that converts it",
                )
