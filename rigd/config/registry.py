"""Finds plug-ins by entry point; imports them only when they are used."""

from __future__ import annotations

from functools import cache
from importlib.metadata import EntryPoint, entry_points
from inspect import isabstract
from typing import Final, TypeVar

from rigd.config.problems import suggest
from rigd.model.errors import ConfigError
from rigd.sdk import AnyDriver, Link, Plant, Simulation

ANALYSES: Final = "rigd.analyses"
DRIVERS: Final = "rigd.drivers"
FRICTION_LAWS: Final = "rigd.friction_laws"
LINKS: Final = "rigd.links"
OBSERVERS: Final = "rigd.observers"
PLANTS: Final = "rigd.plants"
SIMULATIONS: Final = "rigd.simulations"

T = TypeVar("T")


@cache
def given_names(group: str) -> dict[str, list[EntryPoint]]:
    """Return all entry points of ``group`` by name: several packages may give one name."""
    found: dict[str, list[EntryPoint]] = {}
    for point in entry_points(group=group):
        found.setdefault(point.name, []).append(point)
    return found


def installed(group: str) -> dict[str, EntryPoint]:
    """Return the entry points of ``group`` (:data:`DRIVERS`, ...) by name.

    Of a name that several packages give, it is any of them: :func:`clash` is to be asked.
    """
    return {name: points[0] for name, points in given_names(group).items()}


def clash(group: str, name: str) -> str:
    """Return which packages give ``name`` of ``group`` if several do; "" if one does.

    Which of them a rig gets would depend on the order of the search path.
    """
    points = given_names(group).get(name, [])
    if len(points) < 2:
        return ""
    packages = sorted(f"{_package(point)} ({point.value})" for point in points)
    return (
        f"{' and '.join(packages)} all give it"
        if len(points) > 2
        else (f"both {packages[0]} and {packages[1]} give it")
    )


def _package(point: EntryPoint) -> str:
    return "?" if point.dist is None else f"{point.dist.name} {point.dist.version}"


def find_driver(name: str) -> type[AnyDriver]:
    """Return the driver class called ``name``.

    Raises:
        ConfigError: no such driver is installed, or it cannot be loaded.
    """
    return find(DRIVERS, AnyDriver, "driver", name)


def find_link(name: str) -> type[Link]:
    """Return the link class called ``name``; raises as :func:`find_driver`."""
    return find(LINKS, Link, "link", name)


def find_plant(name: str) -> type[Plant]:
    """Return the plant class called ``name``; raises as :func:`find_driver`."""
    return find(PLANTS, Plant, "plant", name)


def find_simulation(name: str) -> type[Simulation]:
    """Return the simulation class called ``name``; raises as :func:`find_driver`."""
    return find(SIMULATIONS, Simulation, "simulation", name)


def find(group: str, base: type[T], kind: str, name: str) -> type[T]:
    """Return the class called ``name`` of ``group``, derived from ``base``.

    Raises:
        ConfigError: none is installed, several packages give the name, or it cannot be loaded;
            ``kind`` is its name in errors.
    """
    known = installed(group)
    if name not in known:
        raise ConfigError(f"no {kind} {name!r} is installed", hint=suggest(name, known))
    if several := clash(group, name):
        raise ConfigError(
            f"{kind} {name!r} is not clear: {several}",
            hint="uninstall one of the packages, or give its entry point another name",
        )
    try:
        found = known[name].load()
    except (ImportError, AttributeError) as error:
        raise ConfigError(
            f"{kind} {name!r} cannot be loaded: {error}",
            hint=f"reinstall the package that provides {known[name].value}",
        ) from error
    if isinstance(found, type) and issubclass(found, base):
        if isabstract(found):
            missing = ", ".join(sorted(getattr(found, "__abstractmethods__", ())))
            raise ConfigError(
                f"{kind} {name!r} is not complete: {found.__name__} has no {missing}",
                hint=f"it is written for another version of rigd: update {known[name].value}",
            )
        return found
    raise ConfigError(
        f"{name!r} ({known[name].value}) is not a {base.__module__.rpartition('.')[0]}."
        f"{base.__name__}",
        hint="correct the entry point of the package that provides it",
    )
