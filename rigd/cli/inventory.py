"""Lists installed plug-ins and their declarations; reports those that cannot be imported."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Final

from rigd.config.loader import load_rig
from rigd.config.registry import DRIVERS, LINKS, PLANTS, SIMULATIONS
from rigd.model.channels import Channel
from rigd.model.errors import ConfigError
from rigd.sdk import AnyDriver, Link, Plant, Simulation
from rigd.sdk.options import Option, options_of
from rigd.sdk.shipped import shipped_folder


@dataclass(frozen=True)
class PluginKind:
    """A kind of thing that packages bring: its name, its base, where a rig file names it."""

    name: str
    base: type
    where: str


#: Kinds by the entry point group that makes them known, and where a rig file names them.
GROUPS: Final = {
    DRIVERS: PluginKind("driver", AnyDriver, "devices: {NAME: {driver: ...}}"),
    LINKS: PluginKind("link", Link, "links: {NAME: {type: ...}}"),
    PLANTS: PluginKind("plant", Plant, "plant: {model: ...}"),
    SIMULATIONS: PluginKind("simulation", Simulation, "simulation: {model: ...}"),
}


@dataclass(frozen=True)
class Installed:
    """One entry point as it was found; ``broken`` says why it cannot be used."""

    kind: str
    name: str
    package: str
    version: str
    title: str = ""
    doc: str = ""
    broken: str = ""
    link_kind: str = ""
    options: tuple[Option, ...] = ()
    #: Where the options come from that channels and setpoints are shown for; "" for the defaults.
    example: str = ""
    channels: tuple[Channel, ...] | None = None
    setpoints: tuple[Channel, ...] = ()
    has_status: bool = False
    status_bits: dict[str, int] = field(default_factory=dict)
    actions: dict[str, str] = field(default_factory=dict)


def points() -> Iterator[tuple[str, EntryPoint]]:
    """Yield group and entry point of everything installed, loading nothing."""
    for group in GROUPS:
        for point in sorted(entry_points(group=group), key=lambda item: item.name):
            yield group, point


def look_at(group: str, point: EntryPoint, *, in_full: bool) -> Installed:
    """Return what stands behind an entry point; options and channels only where ``in_full``.

    Loading it runs code that anybody may have written: whatever that raises is told as broken.
    """
    kind = GROUPS[group].name
    package, version = (point.dist.name, point.dist.version) if point.dist else ("?", "?")
    try:
        loaded = point.load()
        facts = _described(loaded, GROUPS[group], point.name, in_full=in_full)
    except (Exception, SystemExit) as error:  # noqa: BLE001  # one broken package hides no other
        reason = f"{type(error).__name__}: {error}"
        return Installed(kind, point.name, package, version, broken=reason)
    return Installed(kind, point.name, package, version, **facts)


def _described(loaded: Any, kind: PluginKind, name: str, *, in_full: bool) -> dict[str, Any]:
    title, doc = introduction(loaded, kind.base)
    facts: dict[str, Any] = {
        "title": title,
        "doc": doc,
        "link_kind": getattr(loaded, "link_kind", "") or getattr(loaded, "kind", ""),
    }
    if in_full:
        facts["options"] = options_of(loaded.Config)
        if kind.base is AnyDriver:
            facts |= _channels(loaded, name)
    return facts


def introduction(loaded: Any, base: type) -> tuple[str, str]:
    """Return the title of a class and its documentation.

    Raises:
        TypeError: it is no class derived from ``base``.
    """
    if not (isinstance(loaded, type) and issubclass(loaded, base)):
        package = base.__module__.rpartition(".")[0]
        raise TypeError(f"{loaded!r} is no {base.__name__} of {package}")
    doc = _plain(inspect.cleandoc(loaded.__doc__ or ""))
    return getattr(loaded, "title", "") or doc.partition("\n")[0], doc


def _plain(doc: str) -> str:
    """Return a docstring without its markup: ``:class:`Name``` and double backquotes."""
    return re.sub(r"``(.+?)``|:\w+:`~?\.?(?:[\w.]*\.)?(\w+)`", r"\1\2", doc)


def _channels(loaded: Any, name: str) -> dict[str, Any]:
    """Return channels and setpoints: those of the default options, or of a shipped rig's device."""
    if any(field.is_required() for field in loaded.Config.model_fields.values()):
        found = _shipped_device(name)
        if found is None:
            return {}
        example, config = found
    else:
        example, config = "", loaded.Config()
    driver = loaded(config, None)
    return {
        "example": example,
        "channels": driver.channels,
        "setpoints": getattr(driver, "setpoints", ()),
        "has_status": driver.has_status,
        "status_bits": dict(driver.status_bits),
        "actions": dict(driver.actions),
    }


def _shipped_device(driver: str) -> tuple[str, Any] | None:
    """Return where a shipped rig has a device of this driver, and its options."""
    for file in sorted(shipped_folder("configs").glob("*.yaml")):
        if f"driver: {driver}" not in file.read_text("utf-8"):
            continue
        try:
            rig = load_rig(file)
        except ConfigError:  # another part of it may need a package that is broken: told there
            continue
        for device in rig.devices.values():
            if device.driver == driver:
                return f"{device.name} in configs/{file.name}", device.config
    return None
