"""Finds the register maps of Modbus devices that are shipped with rigd, by name."""

from __future__ import annotations

import difflib
import tomllib
from importlib.resources import files
from typing import Any

_FOLDER = files("rigd_drivers.modbus") / "maps"


def shipped_map(name: str, kind: str) -> dict[str, Any]:
    """Return the shipped map ``name`` of a device of ``kind``, as it would stand in a rig file.

    Raises:
        ValueError: there is none; names those there are.

    """
    known = {}
    for file in _FOLDER.iterdir():
        if file.name.endswith(".toml"):
            described = tomllib.loads(file.read_text(encoding="utf-8"))
            if described.pop("kind") == kind:
                known[file.name.removesuffix(".toml")] = described
    if name in known:
        return known[name]
    close = difflib.get_close_matches(name, known, 1)
    hint = f"; did you mean {close[0]!r}?" if close else ""
    raise ValueError(
        f"no shipped map of a {kind} is called {name!r} ({', '.join(sorted(known))}){hint}"
    )
