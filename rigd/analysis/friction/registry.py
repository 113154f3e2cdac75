"""Finds the friction laws that are installed, by their entry points."""

from __future__ import annotations

from typing import Final

from numba.core.errors import NumbaError

from rigd.analysis.friction.law import FrictionLaw
from rigd.config.registry import FRICTION_LAWS, find, installed
from rigd.model.errors import ConfigError

#: What a law declares beside its methods.
_DECLARED: Final = ("parameters", "step")


def find_law(name: str) -> type[FrictionLaw]:
    """Return the friction law called ``name``.

    Raises:
        ConfigError: no such law is installed, it cannot be loaded or compiled, or is incomplete.
    """
    try:
        law: type[FrictionLaw] = find(FRICTION_LAWS, FrictionLaw, "friction law", name)
    except NumbaError as error:
        raise ConfigError(
            f"friction law {name!r} cannot be compiled: {str(error).strip().splitlines()[0]}",
            hint="`check_friction_law` in its tests shows the whole error",
        ) from error
    if missing := [item for item in _DECLARED if not hasattr(law, item)]:
        raise ConfigError(
            f"friction law {name!r} is not complete: {law.__name__} has no {', '.join(missing)}",
            hint="docs/friction_laws.md shows what a law declares",
        )
    return law


def installed_laws() -> tuple[dict[str, type[FrictionLaw]], tuple[str, ...]]:
    """Return all laws that can be used by name, and a sentence on each that cannot."""
    laws, broken = {}, []
    for name in sorted(installed(FRICTION_LAWS)):
        try:
            laws[name] = find_law(name)
        except ConfigError as error:
            broken.append(error.message)
    return laws, tuple(broken)
