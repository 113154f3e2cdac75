"""Collects every problem of a file, so that its author sees all of them at once."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from dataclasses import dataclass, field

from rigd.model.errors import ConfigError, Place


@dataclass
class Problems:
    """What is wrong with a file so far."""

    found: list[ConfigError] = field(default_factory=list)

    def add(
        self, place: Place | None, message: str, hint: str | None = None, *, lacks: str = ""
    ) -> None:
        """Note one problem; the same one twice (in two trials of a sweep) counts once."""
        error = ConfigError(message, place=place, hint=hint, lacks=lacks)
        if all((error.place, error.message) != (old.place, old.message) for old in self.found):
            self.found.append(error)

    def add_lacking(
        self, place: Place, rig: str, kind: str, name: str, known: Iterable[str]
    ) -> None:
        """Note that the rig has no such channel, setpoint, device or stream."""
        message = f"the rig {rig} has no {kind} {name!r}"
        self.add(place, message, suggest(name, known), lacks=name)

    def raise_any(self) -> None:
        """Raise all problems noted so far as one error, in the order of the file.

        Raises:
            ConfigError: there is at least one.

        """
        if self.found:
            self.found.sort(key=_position)
            raise ConfigError.several(self.found)


def _position(error: ConfigError) -> tuple[str, int, int]:
    place = error.place
    return ("", 0, 0) if place is None else (place.file, place.line, place.column)


def suggest(name: str, known: Iterable[str]) -> str:
    """Return what to write instead of the unknown ``name``: the nearest name, or all there are."""
    names = sorted(known)
    nearest = difflib.get_close_matches(name, names, n=1, cutoff=0.5)
    if nearest:
        return f"did you mean {nearest[0]!r}?"
    if not names:
        return "there is none"
    shown = ", ".join(names[:12]) + (", ..." if len(names) > 12 else "")
    return f"known: {shown}"
