"""Finds the channels, devices and actions of a rig by name; reduces a rig to some of its devices.

A channel is a named quantity that a device measures. An action is something that a device can do
when a user asks for it, such as to zero its display. A rig reduced to some of its devices keeps
only the links of these devices (the connections that devices share) and the interlocks (conditions
on channels) that look at no other device. The module only reads the description of the rig; it
opens no device.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

from rigd.computed.controllers.driver import ControllerConfig
from rigd.computed.derived.driver import DerivedConfig
from rigd.computed.observers.driver import ObserverConfig
from rigd.config.loader import channel_names
from rigd.config.problems import suggest
from rigd.config.rig import RigConfig
from rigd.model.errors import ConfigError
from rigd.model.limits import Interlock


def chosen_channels(rig: RigConfig, names: Sequence[str]) -> list[str]:
    """Return the channels that ``names`` mean, in the order of the rig file; all if empty.

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
    """Check that a device has an action; nothing is opened.

    Raises:
        ConfigError: unknown device, or it has no such action; names the devices that have it.
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
    """Return the actions of a device, each with its description; nothing is opened."""
    return rig.devices[name].declaration.actions


def only(rig: RigConfig, devices: Collection[str]) -> RigConfig:
    """Return ``rig`` with these devices, their links, and the interlocks on them, alone.

    A group of derived channels and an observer also keep the devices from which they are computed,
    and a controller what it uses.
    """
    devices, before = set(devices), set[str]()
    while devices != before:
        before = set(devices)
        for name in before & rig.devices.keys():
            config = rig.devices[name].config
            if isinstance(config, DerivedConfig | ObserverConfig):
                devices |= config.devices
            elif isinstance(config, ControllerConfig):
                devices |= config.needs
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
    """Return the devices whose channels an interlock uses."""
    channels = (
        interlock.source, interlock.low, interlock.high, interlock.follows, interlock.only_while,
    )  # fmt: skip
    return {channel.partition(".")[0] for channel in channels if isinstance(channel, str)}
