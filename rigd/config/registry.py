"""Drivers and plants by name, found through entry points; nothing is imported before it is used."""

from __future__ import annotations

from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Final

from rigd.config.problems import suggest
from rigd.model.errors import ConfigError
from rigd.sdk import Driver, Plant

DRIVERS: Final = "rigd.drivers"
PLANTS: Final = "rigd.plants"


@cache
def installed(group: str) -> dict[str, EntryPoint]:
    """Return the entry points of ``group`` (:data:`DRIVERS` or :data:`PLANTS`) by name."""
    return {point.name: point for point in entry_points(group=group)}


def find_driver(name: str) -> type[Driver]:
    """Return the driver class called ``name``.

    Raises:
        ConfigError: no such driver is installed, or it cannot be loaded.
    """
    found = _load(DRIVERS, "driver", name)
    if isinstance(found, type) and issubclass(found, Driver):
        return found
    raise _not_a("Driver", DRIVERS, name)


def find_plant(name: str) -> type[Plant]:
    """Return the plant class called ``name``.

    Raises:
        ConfigError: no such plant is installed, or it cannot be loaded.
    """
    found = _load(PLANTS, "plant", name)
    if isinstance(found, type) and issubclass(found, Plant):
        return found
    raise _not_a("Plant", PLANTS, name)


def _load(group: str, kind: str, name: str) -> object:
    known = installed(group)
    if name not in known:
        raise ConfigError(f"no {kind} {name!r} is installed", hint=suggest(name, known))
    try:
        return known[name].load()
    except (ImportError, AttributeError) as error:
        raise ConfigError(
            f"{kind} {name!r} cannot be loaded: {error}",
            hint=f"reinstall the package that provides {known[name].value}",
        ) from error


def _not_a(base: str, group: str, name: str) -> ConfigError:
    return ConfigError(
        f"{name!r} ({installed(group)[name].value}) is not a rigd.sdk.{base}",
        hint="correct the entry point of the package that provides it",
    )
