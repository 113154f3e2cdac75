"""Lists installed plug-ins and their declarations; reports those that cannot be imported."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Final, TypeVar

from pydantic import ValidationError
from rich.console import Console
from rich.markup import escape

from rigd.analysis import Analysis
from rigd.cli.views.screen import folding_table, print_table
from rigd.computed.observers.model import ObserverModel
from rigd.config.loader import load_rig
from rigd.config.registry import DRIVERS, LINKS, OBSERVERS, PLANTS, SIMULATIONS, clash
from rigd.model.channels import Channel
from rigd.model.errors import ConfigError
from rigd.sdk import AnyDriver, Link, Plant, Simulation
from rigd.sdk.options.options import Option, options_of
from rigd.sdk.shipped_files import shipped_folder


@dataclass(frozen=True)
class PluginKind:
    """A kind of plug-in: its name, its base class, and the key of a rig file that names it."""

    name: str
    base: type
    where: str


#: Kinds by entry point group.
GROUPS: Final = {
    DRIVERS: PluginKind("driver", AnyDriver, "devices: {NAME: {driver: ...}}"),
    LINKS: PluginKind("link", Link, "links: {NAME: {type: ...}}"),
    PLANTS: PluginKind("plant", Plant, "plant: {model: ...}"),
    SIMULATIONS: PluginKind("simulation", Simulation, "simulation: {model: ...}"),
    OBSERVERS: PluginKind("observer", ObserverModel, "observers: {NAME: {model: ...}}"),
}


@dataclass(frozen=True)
class Installed:
    """One entry point as it was found; ``broken`` is the reason why it cannot be used, or ''."""

    name: str
    package: str
    version: str
    title: str = ""
    doc: str = ""
    broken: str = ""


Found = TypeVar("Found", bound=Installed)


@dataclass(frozen=True)
class InstalledPlugin(Installed):
    """A driver, link, plant, simulation or observer."""

    kind: str = ""
    link_kind: str = ""
    options: tuple[Option, ...] = ()
    #: The source of the options with which channels and setpoints are shown; "" for the defaults.
    example: str = ""
    channels: tuple[Channel, ...] | None = None
    setpoints: tuple[Channel, ...] = ()
    has_status: bool = False
    status_bits: dict[str, int] = field(default_factory=dict)
    actions: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class InstalledAnalysis(Installed):
    """An analysis, with what it needs."""

    signals: Mapping[str, str] = field(default_factory=dict)  #: with their units
    optional_signals: Mapping[str, str] = field(default_factory=dict)
    constants: tuple[str, ...] = ()
    optional_constants: tuple[str, ...] = ()
    constant_units: Mapping[str, str] = field(default_factory=dict)  #: of those that state one
    trial_parameters: tuple[str, ...] = ()
    references: tuple[str, ...] = ()
    calibrated: tuple[str, ...] = ()
    measures: tuple[str, ...] = ()
    options: tuple[str, ...] = ()


def points() -> Iterator[tuple[str, EntryPoint]]:
    """Yield group and entry point of everything that is installed; load nothing."""
    for group in GROUPS:
        for point in sorted(entry_points(group=group), key=lambda item: item.name):
            yield group, point


def look_at(
    point: EntryPoint, base: type, made: type[Found], facts: Callable[[Any], Mapping[str, Any]]
) -> Found:
    """Load an entry point and describe it, with ``facts`` of the class that it names.

    Loading runs the code of other packages: an exception there is reported as broken.
    """
    package, version = (point.dist.name, point.dist.version) if point.dist else ("?", "?")
    if several := clash(point.group, point.name):
        return made(point.name, package, version, broken=several)
    try:
        loaded = point.load()
        title, doc = introduction(loaded, base)
        return made(point.name, package, version, title, doc, **facts(loaded))
    except (Exception, SystemExit) as error:  # noqa: BLE001  # one broken package hides no other
        reason = f"{type(error).__name__}: {error}"
        return made(point.name, package, version, broken=reason)


def look_at_plugin(group: str, point: EntryPoint, *, in_full: bool) -> InstalledPlugin:
    """Load an entry point of ``group`` and describe it; add options and channels if ``in_full``."""
    kind = GROUPS[group]

    def facts(loaded: Any) -> dict[str, Any]:
        known = {"link_kind": getattr(loaded, "link_kind", "") or getattr(loaded, "kind", "")}
        if not in_full:
            return known
        channels = _channels(loaded, point.name) if kind.base is AnyDriver else {}
        return {**known, "options": options_of(loaded.Config), **channels}

    return replace(look_at(point, kind.base, InstalledPlugin, facts), kind=kind.name)


def look_at_analysis(point: EntryPoint) -> InstalledAnalysis:
    """Load the entry point of an analysis and describe it."""

    def facts(loaded: type[Analysis]) -> dict[str, Any]:
        needs = loaded.needs
        return {
            "signals": needs.signals,
            "optional_signals": needs.optional_signals,
            "constants": needs.constants,
            "optional_constants": needs.optional_constants,
            "constant_units": needs.constant_units,
            "trial_parameters": needs.trial_parameters,
            "references": needs.references,
            "calibrated": needs.calibrated,
            "measures": loaded.measures,
            "options": loaded.options,
        }

    return look_at(point, Analysis, InstalledAnalysis, facts)


def print_list(console: Console, found: Sequence[Installed], indent: str = "") -> None:
    """Print a line for each of ``found``."""
    table = folding_table("", "", "")
    for item in found:
        text = f"[red]broken: {escape(item.broken)}[/]" if item.broken else escape(item.title)
        table.add_row(f"{indent}{item.name}", f"{item.package} {item.version}", text)
    print_table(console, table)


def introduction(loaded: Any, base: type) -> tuple[str, str]:
    """Return the title of a class and its documentation.

    Raises:
        TypeError: the class is not derived from ``base``.
    """
    if not (isinstance(loaded, type) and issubclass(loaded, base)):
        package = base.__module__.rpartition(".")[0]
        raise TypeError(f"{loaded!r} is not derived from {base.__name__} of {package}")
    doc = _plain(inspect.cleandoc(loaded.__doc__ or ""))
    return getattr(loaded, "title", "") or doc.partition("\n")[0], doc


def _plain(doc: str) -> str:
    """Return a docstring without markup: without ``:class:`Name``` and double backquotes."""
    return re.sub(r"``(.+?)``|:\w+:`~?\.?(?:[\w.]*\.)?(\w+)`", r"\1\2", doc)


def _channels(loaded: Any, name: str) -> dict[str, Any]:
    """Return channels and setpoints for the default options, or for a device of a shipped rig."""
    try:
        example, config = "", loaded.Config()
    except ValidationError:  # it needs options
        found = _shipped_device(name)
        if found is None:
            return {}
        example, config = found
    declaration = loaded.declare(config)
    return {
        "example": example,
        "channels": declaration.channels,
        "setpoints": declaration.setpoints,
        "has_status": declaration.has_status,
        "status_bits": dict(declaration.status_bits),
        "actions": dict(declaration.actions),
    }


def _shipped_device(driver: str) -> tuple[str, Any] | None:
    """Return the shipped rig that has a device of this driver, and the options of the device."""
    for file in sorted(shipped_folder("configs").glob("*.yaml")):
        if f"driver: {driver}" not in file.read_text("utf-8"):
            continue
        try:
            rig = load_rig(file)
        except (
            ConfigError
        ):  # another part of the rig may need a broken package, which is reported in its own place
            continue
        for device in rig.devices.values():
            if device.driver == driver:
                return f"{device.name} in configs/{file.name}", device.config
    return None
