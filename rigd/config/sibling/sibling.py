"""Reads the simulated sibling of a real rig file, checks that names agree, lists what differs.

A dry run of a real rig plays on the plant of its sibling. Plant and devices are those of the
sibling; limits, interlocks, cycle, constants and computed channels are those of the real file.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from rigd.computed.controllers.driver import ControllerConfig
from rigd.computed.derived.driver import DerivedConfig
from rigd.computed.driver import ComputedConfig
from rigd.computed.observers.driver import ObserverConfig
from rigd.config.document import Document, KeyPath, parse_document
from rigd.config.loader import channel_names, load_rig, parse_rig
from rigd.config.problems import Problems, suggest
from rigd.config.rig import DeviceConfig, RigConfig, SiblingFile
from rigd.config.sibling.differences import Difference, alike, differences
from rigd.model.channels import Channel
from rigd.model.errors import ConfigError


@dataclass(frozen=True)
class Sibling:
    """The simulated sibling of a rig, right and with the same names.

    ``rig`` has the cycle of the real rig. ``differences`` are those of the two files.
    """

    rig: RigConfig
    differences: tuple[Difference, ...]

    def stand_in(self, rig: RigConfig) -> RigConfig:
        """Return ``rig`` with the plant and the devices of the sibling.

        Its own are limits, interlocks, constants, and what is computed of channels. A device that
        only one of the two has is left out.
        """
        devices: dict[str, DeviceConfig] = {}
        for name, device in rig.devices.items():
            if isinstance(device.config, ComputedConfig):
                devices[name] = device
            elif name in self.rig.devices:
                devices[name] = replace(self.rig.devices[name], limits=device.limits)
        return replace(
            rig,
            plant=self.rig.plant,
            devices=devices,
            links=self.rig.links,
            simulation=None,
            sibling=None,
        )


def read_sibling(rig: RigConfig) -> Sibling | None:
    """Return the sibling that the file of ``rig`` names; None if it names none.

    Raises:
        ConfigError: the sibling is missing or wrong, is no rig with a plant, or has other names;
            with places in both files.
    """
    named = rig.sibling
    if named is None:
        return None
    sibling = _load(rig, named)
    if sibling.period_ns != rig.period_ns:
        try:
            played = parse_rig(sibling.source.text, sibling.source.path, period_ns=rig.period_ns)
        except ConfigError as error:
            raise ConfigError(
                f"the sibling cannot be played at the cycle of this file: {error}",
                place=named.place,
            ) from error
    else:
        played = sibling
    _Names(rig, played).check()
    return Sibling(played, tuple(differences(rig, sibling)))


def _load(rig: RigConfig, named: SiblingFile) -> RigConfig:
    if _same(named.path, rig.source.path):
        raise ConfigError(
            "the sibling is this file itself", place=named.place,
            hint="name a file of the same rig with a `plant`",
        )  # fmt: skip
    if not named.path.is_file():
        raise ConfigError(
            f"the sibling {named.path} does not exist", place=named.place,
            hint="give its path from the folder of this file, or remove the key",
        )  # fmt: skip
    sibling = load_rig(named.path)
    if sibling.sibling is not None:
        raise ConfigError(
            f"the sibling names a sibling itself ({sibling.sibling.place})", place=named.place,
            hint="name the file with the `plant`",
        )  # fmt: skip
    if sibling.plant is None:
        place = _document(sibling).place(("rig",))
        raise ConfigError(
            f"the sibling {sibling.name} ({place}) has no `plant`: nothing to play on",
            place=named.place, hint="name a file of the same rig that is simulated in process",
        )  # fmt: skip
    return sibling


def _same(path: Path, other: Path) -> bool:
    return path.resolve() == other.resolve()


def _document(rig: RigConfig) -> Document:
    return parse_document(rig.source.text, rig.source.path)


class _Names:
    """Checks that two files of a rig have the same names for what acts and what is used."""

    def __init__(self, rig: RigConfig, sibling: RigConfig) -> None:
        self.rig, self.sibling = rig, sibling
        self.here, self.there = _document(rig), _document(sibling)
        self.problems = Problems()

    def check(self) -> None:
        """Raise what differs.

        Raises:
            ConfigError: names or units differ; with places in both files.
        """
        for device in _devices(self.rig):
            for setpoint in device.setpoints:
                self._setpoint(device, setpoint)
        if not self.problems.found:  # a device with another name would be noted twice
            self._taken_there()
        for name, path, use in _uses(self.rig):
            self._used(name, path, use)
        self._ages()
        self.problems.raise_any()

    def _setpoint(self, device: DeviceConfig, setpoint: Channel) -> None:
        name = f"{device.name}.{setpoint.name}"
        found = self.sibling.setpoint(name)
        path: KeyPath = ("devices", device.name, "limits", setpoint.name)
        if found is None:
            place = self.there.key_place(("devices", device.name))
            self.problems.add(
                self.here.key_place(path),
                f"{name} is a setpoint here, and the sibling has none of this name ({place})",
                _hint(name, self.sibling.settable),
            )
        elif not alike(found, setpoint):
            place = self.there.key_place(path)
            self.problems.add(
                self.here.key_place(path),
                f"{name} is in {setpoint.unit} here, and in {found.unit} in the sibling ({place})",
                "give both devices the same quantity",
            )

    def _taken_there(self) -> None:
        for device in _devices(self.sibling):
            for setpoint in device.setpoints:
                name = f"{device.name}.{setpoint.name}"
                if self.rig.setpoint(name) is None:
                    place = self.there.key_place(("devices", device.name, "limits", setpoint.name))
                    self.problems.add(
                        self.here.key_place(("devices", device.name)),
                        f"{name} is a setpoint of the sibling ({place}), and here is none of this "
                        "name",
                        _hint(name, self.rig.settable),
                    )

    def _used(self, name: str, path: KeyPath, use: str) -> None:
        device = name.partition(".")[0]
        known = self.rig.devices.get(device)
        if known is None or isinstance(known.config, ComputedConfig):
            return
        channel, found = self.rig.channel(name), self.sibling.channel(name)
        if channel is None or (found is not None and alike(found, channel)):
            return
        place = self.there.key_place(("devices", device))
        if found is None:
            problem = f"does not measure it ({place})"
            hint = _hint(device, list(self.sibling.devices))
            if device in self.sibling.devices:
                hint = _hint(name, channel_names(self.sibling))
        else:
            problem = f"measures it in {found.unit} instead of {channel.unit} ({place})"
            hint = "give both devices the same quantity"
        where = self.here.place(path)
        self.problems.add(where, f"{use} {name}, and the sibling {problem}", hint)

    def _ages(self) -> None:
        """Note interlocks that would take rows of the sibling, which come on time, for lost."""
        for index, interlock in enumerate(self.rig.interlocks):
            device = self.sibling.devices.get(interlock.source.partition(".")[0])
            if device is None:
                continue
            oldest_s = self.sibling.oldest_s(interlock.source)
            least_s = oldest_s + 1e-9 * self.rig.period_ns
            if oldest_s and interlock.stale_after_s < least_s:
                place = self.there.key_place(("devices", device.name))
                self.problems.add(
                    self.here.place(("interlocks", index, "stale_after")),
                    f"interlock {interlock.name!r} counts {interlock.source} as lost after "
                    f"{1e3 * interlock.stale_after_s:g} ms, and in the sibling its rows become "
                    f"{1e3 * least_s:.1f} ms old ({place})",
                    "make the blocks of the sibling's device smaller",
                )


def _devices(rig: RigConfig) -> Iterator[DeviceConfig]:
    """Yield the devices that are not computed of others."""
    for device in rig.devices.values():
        if not isinstance(device.config, ComputedConfig):
            yield device


def _uses(rig: RigConfig) -> Iterator[tuple[str, KeyPath, str]]:
    """Yield each channel that the rig file itself uses, where, and what uses it."""
    for index, interlock in enumerate(rig.interlocks):
        path: KeyPath = ("interlocks", index)
        yield interlock.source, (*path, "source"), f"interlock {interlock.name!r} watches"
        for key, bound in (("low", interlock.low), ("high", interlock.high)):
            if isinstance(bound, str):
                yield bound, (*path, key), f"interlock {interlock.name!r} compares with"
    for name, device in rig.devices.items():
        config = device.config
        if isinstance(config, ControllerConfig):
            for used in config.inputs:
                yield used, ("controllers", name), f"controller {name!r} uses"
        elif isinstance(config, ObserverConfig):
            for used in (*config.inputs, *config.measured):
                yield used, ("observers", name), f"observer {name!r} uses"
        elif isinstance(config, DerivedConfig):
            for derived in config.graph.groups()[config.group]:
                for used in sorted(config.graph.uses[derived]):
                    yield used, ("derived", derived), f"{derived} is computed from"
        for item in device.declaration.inputs:
            yield item.channel, ("devices", name, "options", *item.path), f"{name} takes"


def _hint(name: str, known: list[str]) -> str:
    return f"give both files the same names; {suggest(name, known)}"
