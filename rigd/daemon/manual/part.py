"""Reduces a rig to some of its devices; the others need not be connected."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

from rigd.config.rig import RigConfig
from rigd.model.limits import Interlock


def only(rig: RigConfig, devices: Collection[str]) -> RigConfig:
    """Return ``rig`` with these devices alone, their links, and the interlocks on them alone."""
    kept = {name: device for name, device in rig.devices.items() if name in devices}
    links = {device.link for device in kept.values()}
    return replace(
        rig,
        devices=kept,
        links={name: link for name, link in rig.links.items() if name in links},
        interlocks=tuple(one for one in rig.interlocks if _sources(one) <= set(kept)),
    )


def _sources(interlock: Interlock) -> set[str]:
    """Return the devices whose channels an interlock looks at."""
    channels = (interlock.source, interlock.low, interlock.high)
    return {one.partition(".")[0] for one in channels if isinstance(one, str)}
