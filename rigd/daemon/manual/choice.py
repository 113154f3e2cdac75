"""Resolves names of channels, devices and actions; cuts a rig down to some devices."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

from rigd.config.loader import channel_names
from rigd.config.problems import suggest
from rigd.config.rig import RigConfig
from rigd.model.errors import ConfigError
from rigd.model.limits import Interlock
from rigd.sdk import Driver, SlowDriver


def chosen_channels(rig: RigConfig, names: Sequence[str]) -> list[str]:
    """Return the channels that ``names`` mean, in the order of the rig file; all where empty.

    A name is a channel, or a device, which means all its channels.

    Raises:
        ConfigError: the rig has neither of that name.
    """
    every = channel_names(rig)
    for name in names:
        if name not in every and name not in rig.devices:
            raise ConfigError(
                f"rig {rig.name} has no channel {name!r}",
                hint=suggest(name, [*every, *rig.devices]),
            )
    if not names:
        return every
    return [item for item in every if item in names or item.partition(".")[0] in names]


def check_action(rig: RigConfig, name: str, action: str) -> None:
    """Make sure that a device has an action; nothing is opened.

    Raises:
        ConfigError: there is no such device, or it has no such action; names those that have.
    """
    device = rig.devices.get(name)
    if device is None:
        raise ConfigError(f"rig {rig.name} has no device {name!r}", hint=suggest(name, rig.devices))
    known = actions_of(rig, name)
    if action in known:
        return
    if known:
        hint = "it has: " + ", ".join(known)
    else:
        able = [item for item in rig.devices if action in actions_of(rig, item)]
        hint = f"it has none; {action} of this rig: {', '.join(able) or 'no device has it'}"
    raise ConfigError(f"{name} ({device.driver}) has no action {action!r}", hint=hint)


def actions_of(rig: RigConfig, name: str) -> Mapping[str, str]:
    """Return the actions of a device, each with what it does; nothing is opened."""
    device = rig.devices[name]
    driver = device.driver_class(device.config, None)
    return driver.actions if isinstance(driver, Driver | SlowDriver) else {}


def only(rig: RigConfig, devices: Collection[str]) -> RigConfig:
    """Return ``rig`` with these devices, their links, and the interlocks on them, alone."""
    kept = {name: device for name, device in rig.devices.items() if name in devices}
    links = {device.link for device in kept.values()}
    return replace(
        rig,
        devices=kept,
        links={name: link for name, link in rig.links.items() if name in links},
        interlocks=tuple(
            interlock for interlock in rig.interlocks if _sources(interlock) <= set(kept)
        ),
    )


def _sources(interlock: Interlock) -> set[str]:
    """Return the devices whose channels an interlock looks at."""
    channels = (interlock.source, interlock.low, interlock.high)
    return {channel.partition(".")[0] for channel in channels if isinstance(channel, str)}
