"""Lists the values that a calibration may contain, as the installed analyses declare them."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

from rigd.config.problems import suggest
from rigd.config.registry import ANALYSES, find, installed
from rigd.model.errors import ConfigError
from rigd.sdk.analysis import Calibratable, DeclaredAnalysis


def calibratable() -> Mapping[str, Calibratable]:
    """Return every value that a calibration may contain, by name.

    Analyses that cannot be loaded declare nothing: a rig needs only those of its own family.

    Raises:
        ConfigError: two analyses declare the same name with different meanings.
    """
    return _declared()[0]


def unknown(name: str) -> str:
    """Return the remedy for a value called ``name`` that no analysis declares."""
    known, broken = _declared()
    hint = suggest(name, known)
    lacking = "".join(f"; the analysis {item!r} cannot be loaded: rigd analyses" for item in broken)
    return hint + lacking


@cache
def _declared() -> tuple[dict[str, Calibratable], tuple[str, ...]]:
    """Return the values by name, and the analyses that cannot be loaded."""
    found: dict[str, Calibratable] = {}
    broken = []
    for analysis in sorted(installed(ANALYSES)):
        try:
            declared = find(ANALYSES, DeclaredAnalysis, "analysis", analysis).calibratable
        except ConfigError:
            broken.append(analysis)
            continue
        for name, item in declared.items():
            if found.setdefault(name, item) != item:
                raise ConfigError(
                    f"analysis {analysis!r} declares the calibrated value {name!r}, which has "
                    "another meaning in another analysis",
                    hint="give it a name that contains its rig family",
                )
    return found, tuple(broken)
