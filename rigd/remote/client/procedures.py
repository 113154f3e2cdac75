"""Procedures that travel to a daemon: by value, with their digest."""

from __future__ import annotations

import hashlib
from pathlib import Path

from rigd.procedure.loader import load_procedure
from rigd.remote.protocol.arguments import ProcedureFile


def read_procedure(given: str | Path) -> ProcedureFile:
    """Return a procedure of this computer: a file, or the name of one found here.

    Raises:
        ConfigError: there is no such file, or it is wrong; names every problem with its place.
    """
    procedure = load_procedure(given)
    text = procedure.file.text
    return ProcedureFile(
        name=procedure.name, text=text, sha256=hashlib.sha256(text.encode()).hexdigest()
    )


def is_path(given: str | Path) -> bool:
    """Return whether ``given`` is a path, and not the name of a procedure."""
    return isinstance(given, Path) or "/" in given or given.endswith((".yaml", ".yml"))
