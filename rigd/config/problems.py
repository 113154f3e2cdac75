"""Collects all problems of a file, so that one check reports all of them to the author."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from dataclasses import dataclass, field

from rigd.model.errors import ConfigError, Place


@dataclass
class Problems:
    """The problems of a file found so far."""

    found: list[ConfigError] = field(default_factory=list)
    _known: set[tuple[Place | None, str]] = field(default_factory=set)

    def add(
        self, place: Place | None, message: str, hint: str | None = None, *, lacks: str = ""
    ) -> None:
        """Note a problem; the same problem twice (in two trials of a sweep) counts once."""
        self.take([ConfigError(message, place=place, hint=hint, lacks=lacks)])

    def take(self, errors: Iterable[ConfigError]) -> None:
        """Note problems that another check has found, each once."""
        for error in errors:
            if (error.place, error.message) not in self._known:
                self._known.add((error.place, error.message))
                self.found.append(error)

    def add_lacking(
        self, place: Place, rig: str, kind: str, name: str, known: Iterable[str]
    ) -> None:
        """Note that the rig lacks a channel, setpoint, device or stream."""
        message = f"the rig {rig} has no {kind} {name!r}"
        if (place, message) not in self._known:  # each search for a near name takes long
            self.add(place, message, suggest(name, known), lacks=name)

    def raise_any(self) -> None:
        """Raise all problems noted so far as one error, in the order of the file.

        Raises:
            ConfigError: there is at least one problem.
        """
        if self.found:
            self.found.sort(key=_position)
            raise ConfigError.several(self.found)


def _position(error: ConfigError) -> tuple[str, int, int]:
    place = error.place
    return ("", 0, 0) if place is None else (place.file, place.line, place.column)


def suggest(name: str, known: Iterable[str]) -> str:
    """Return a hint for the unknown ``name``: the nearest known name, or all known names."""
    names = sorted(known)
    nearest = difflib.get_close_matches(name, names, n=1, cutoff=0.5)
    if nearest:
        return f"did you mean {nearest[0]!r}?"
    if not names:
        return "there are none"
    shown = ", ".join(names[:12]) + (", ..." if len(names) > 12 else "")
    return f"known: {shown}"
