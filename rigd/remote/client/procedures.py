"""Reads a procedure file to send it to a daemon, with its digest."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rigd.config.shipped import is_path
from rigd.procedure.loader import load_procedure
from rigd.remote.protocol import Code, Refusal
from rigd.remote.protocol.arguments import ProcedureFile


def read_procedure(given: str | Path) -> ProcedureFile:
    """Return a procedure of this computer: a file, or the name of one found here.

    Raises:
        ConfigError: there is no such file, or it is wrong; names every problem with its place.
    """
    procedure = load_procedure(given)
    return ProcedureFile.of(procedure.name, procedure.file.text)


@contextmanager
def naming_the_file(given: str | Path, name: str) -> Iterator[None]:
    """Let what a daemon finds wrong with the procedure ``name`` give the file that it is from."""
    try:
        yield
    except Refusal as refusal:
        if refusal.code is not Code.WRONG or not is_path(given):
            raise
        message = refusal.message.replace(f"{name}.yaml:", f"{given}:")
        raise Refusal(refusal.code, message, hint=refusal.hint) from refusal
