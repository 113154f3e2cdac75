"""Recordings to identify from, made by rigd's own engine on the simulated rig."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from rigd.config.loader import load_rig
from rigd.daemon.execute import RunRequest, execute
from rigd.procedure.compile import compile_procedure
from rigd.procedure.loader import load_procedure

FLOORS: Final = ("stone", "pvc", "paperboard")
PROCEDURE: Final = "constant_current"


def record(floor: str, seed: int, folder: Path) -> Path:
    """Record the paper's sweep on ``floor`` with noise, vibration and counts; return the file."""
    rig, source = load_rig("lugre-1"), load_procedure(PROCEDURE)
    procedure = compile_procedure(source, rig, {"floor": floor})
    path = folder / f"{floor}-{seed}.mcap"
    execute(RunRequest(procedure, source.file.text, rig, seed, output=path))
    return path
