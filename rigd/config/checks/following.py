"""Reads interlocks that follow a setpoint, and finds what no interlock or a wrong one watches."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Final

from rigd.computed.derived.driver import DerivedConfig
from rigd.config.document import Document, KeyPath
from rigd.config.problems import Problems, suggest
from rigd.config.quantities import read_difference
from rigd.config.rig import RigConfig
from rigd.config.source import InterlockSource
from rigd.model.channels import Channel
from rigd.model.limits import Interlock
from rigd.model.units import format_difference, parse_unit

#: A band up to this share of the largest setpoint is not worth a word.
_SMALL_BAND: Final = 0.1


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
        switch = _setpoint(document, (*path, "while"), source.only_while, rig, problems)
        if switch is not None and switch.unit != "1":
            problems.add(
                document.place((*path, "while")),
                f"{source.only_while} is in {switch.unit}, and 'while' needs a switch, 0 or 1",
                "name the setpoint of a clutch or a relay, or leave 'while' out",
            )
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
    band = read_difference(document, (*path, "band"), source.band, channel.shown_in, problems)
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


def blind_below(rig: RigConfig) -> Sequence[str]:
    """Return in words how much of a setpoint's range each interlock that follows it cannot see.

    A drive that gives nothing is within the band of every setpoint that is smaller. Bands up to
    a tenth of the largest setpoint are left out, and those of switches.
    """
    return [
        f"interlock {lock.name} does not notice a drive that gives nothing, at {lock.follows} up "
        f"to {shown}, its band"
        for lock, setpoint, most in _followed(rig)
        if lock.band > _SMALL_BAND * most
        for shown in [format_difference(lock.band, setpoint.shown_in)]
    ]


def trip_without_value(rig: RigConfig) -> Sequence[str]:
    """Return in words which interlocks watch a channel that has a value under a condition only."""
    graphs = {
        name: device.config.graph
        for name, device in rig.devices.items()
        if isinstance(device.config, DerivedConfig)
    }
    return [
        f"interlock {lock.name} trips wherever {lock.source} has no value, by its `where` or "
        "`hold`, also at rest: watch one with `where(condition, x, 0)` in its formula instead"
        for lock in rig.interlocks
        for group in [lock.source.partition(".")[0]]
        if group in graphs and graphs[group].is_conditional(lock.source)
    ]


def unseen_levels(rig: RigConfig, levels: Iterable[tuple[str, str, float]]) -> Sequence[str]:
    """Return in words which of ``levels`` the interlocks that follow their setpoints cannot see.

    ``levels`` are step, setpoint and value in SI; a value of 0 is a drive that shall stand still.
    Of several interlocks that follow one setpoint, that with the smallest band sees most.
    """
    found: dict[str, tuple[float, str]] = {}
    by_band = sorted(_followed(rig), key=lambda item: item[0].band, reverse=True)
    followed = {lock.follows: (lock, setpoint) for lock, setpoint, _ in by_band}
    for step, name, value in levels:
        lock, _ = followed.get(name, (None, None))
        if lock is None or not 0.0 < abs(value) < lock.band:
            continue
        least = found.get(name, (math.inf, ""))
        found[name] = min(least, (abs(value), step))
    return [
        f"interlock {lock.name} does not notice a drive that gives nothing in step {step!r}: "
        f"{name} is {format_difference(value, setpoint.shown_in)} there, within its band of "
        f"{format_difference(lock.band, setpoint.shown_in)}"
        for name, (value, step) in found.items()
        for lock, setpoint in [followed[name]]
    ]


def _followed(rig: RigConfig) -> Iterator[tuple[Interlock, Channel, float]]:
    """Yield interlocks that follow a setpoint with its channel and largest value, no switches."""
    for lock in rig.interlocks:
        device, _, short = (lock.follows or "").partition(".")
        setpoint = rig.setpoint(lock.follows or "")
        if setpoint is None:
            continue
        limit = rig.devices[device].limits[short]
        if setpoint.unit != "1":
            yield lock, setpoint, max(abs(limit.low), abs(limit.high))


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
