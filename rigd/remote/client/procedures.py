"""Procedures that travel to a daemon: by value, with their digest."""

from __future__ import annotations

from pathlib import Path

from rigd.procedure.loader import load_procedure
from rigd.remote.protocol.arguments import ProcedureFile


def read_procedure(given: str | Path) -> ProcedureFile:
    """Return a procedure of this computer: a file, or the name of one found here.

    Raises:
        ConfigError: there is no such file, or it is wrong; names every problem with its place.
    """
    procedure = load_procedure(given)
    return ProcedureFile.of(procedure.name, procedure.file.text)
