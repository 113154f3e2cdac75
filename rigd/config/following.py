"""Reads interlocks that compare a measured value with its setpoint, and finds what has none."""

from __future__ import annotations

from collections.abc import Sequence

from rigd.config.document import Document, KeyPath
from rigd.config.problems import Problems, suggest
from rigd.config.quantities import read_difference
from rigd.config.rig import RigConfig
from rigd.config.source import InterlockSource
from rigd.model.channels import Channel
from rigd.model.units import parse_unit


def read_following(
    document: Document,
    path: KeyPath,
    source: InterlockSource,
    channel: Channel,
    rig: RigConfig,
    problems: Problems,
) -> float:
    """Return how far ``channel`` may be from the setpoint of the interlock ``source``.

    In the unit of the channel; 0 if it follows none. Problems are noted.
    """
    if source.follows is None:
        for key, given in (("band", source.band), ("while", source.only_while)):
            if given is not None:
                place = document.key_place((*path, key))
                problems.add(place, f"{key!r} belongs to 'follows'", "name the setpoint there")
        return 0.0
    for key, given in (("low", source.low), ("high", source.high)):
        if given is not None:
            problems.add(
                document.key_place((*path, key)),
                f"{key!r} and 'follows' exclude one another",
                "make two interlocks of them",
            )
    setpoint = _setpoint(document, (*path, "follows"), source.follows, rig, problems)
    if setpoint is not None and not parse_unit(setpoint.unit).same_kind(parse_unit(channel.unit)):
        problems.add(
            document.place((*path, "follows")),
            f"{source.follows} is in {setpoint.unit}, {source.source} in {channel.unit}",
            "compare a setpoint with the same quantity",
        )
    if source.only_while is not None:
        _setpoint(document, (*path, "while"), source.only_while, rig, problems)
    if source.delay <= 0:
        problems.add(
            document.place((*path, "delay")),
            "with 'follows' a delay is needed: no drive follows at once",
            "give the longest time that the drive takes, such as 'delay: 0.5 s'",
        )
    if source.band is None:
        problems.add(
            document.place((*path, "follows")),
            "key 'band' is missing",
            f"how far the value may be from its setpoint, in {channel.unit}",
        )
        return 0.0
    band = read_difference(document, (*path, "band"), source.band, channel.unit, problems)
    if band <= 0:
        problems.add(document.place((*path, "band")), f"band {source.band} must be above 0")
    return band


def _setpoint(
    document: Document, path: KeyPath, name: str, rig: RigConfig, problems: Problems
) -> Channel | None:
    found = rig.setpoint(name)
    if found is None:
        known = [f"{device.name}.{item.name}" for device in rig.devices.values()
                 for item in device.setpoints]  # fmt: skip
        problems.add(document.place(path), f"unknown setpoint {name!r}", suggest(name, known))
    return found


def unsupervised(rig: RigConfig) -> Sequence[str]:
    """Return the setpoints that are measured too, and that no interlock compares with it."""
    followed = {interlock.follows for interlock in rig.interlocks}
    return [
        name
        for device in rig.devices.values()
        if device.is_actuator
        for setpoint in device.setpoints
        if (name := f"{device.name}.{setpoint.name}") not in followed
        if rig.channel(name) is not None
    ]
