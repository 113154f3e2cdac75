"""Recordings to identify from, made by rigd's own engine on the simulated rig, and their truth."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rigd.config.loader import load_rig
from rigd.daemon.execute import RunRequest, execute
from rigd.procedure.compile import compile_procedure
from rigd.procedure.loader import load_procedure
from rigd_sim.plants.lugre.files import find_parameters, load_parameters
from rigd_sim.plants.lugre.parameters import Floor

FLOORS: Final = ("stone", "pvc", "paperboard")
PROCEDURE: Final = "constant_current"


def record(floor: str, seed: int, folder: Path) -> Path:
    """Record the paper's sweep on ``floor`` with noise, vibration and counts; return the file."""
    rig, source = load_rig("lugre-1"), load_procedure(PROCEDURE)
    procedure = compile_procedure(source, rig, {"floor": floor})
    path = folder / f"{floor}-{seed}.mcap"
    execute(RunRequest(procedure, source.file.text, rig, seed, output=path))
    return path


def truth(floor: str) -> Floor:
    """Return what the plant was given."""
    given: Floor = getattr(load_parameters(find_parameters("lugre")).floors, floor)
    return given


def true_friction(floor: str, slip_m_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return g of the plant at ``slip_m_s`` (corrected Eq. 6)."""
    known = truth(floor)
    decay = np.exp(-np.sqrt(slip_m_s / known.stribeck_speed))
    return np.asarray(known.mu_coulomb + (known.mu_static - known.mu_coulomb) * decay)
