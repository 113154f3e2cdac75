"""Mechanisms for tests: a plant from a few lines of YAML, and its state over time."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigd_sim.mechanism.plant import MechanismConfig, MechanismPlant

MS = 1_000_000


def plant_of(folder: Path, text: str, *, noise: bool = False) -> MechanismPlant:
    """Return the plant that ``text`` describes; cycle 1 ms."""
    path = folder / "mechanism.yaml"
    path.write_text(textwrap.dedent(text), "utf-8")
    config = MechanismConfig(parameters=str(path), noise=noise)
    return MechanismPlant(config, period_ns=MS, seed=1)


def over_time(
    plant: MechanismPlant, bodies: Sequence[str], seconds: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return positions and speeds of ``bodies`` in every ms, shapes (bodies, ms + 1)."""
    rows = []
    for cycle in range(round(seconds * 1000) + 1):
        plant.advance(cycle * MS)
        rows.append([value for name in bodies for value in at(plant, name)])
    table = np.array(rows).T
    return table[0::2], table[1::2]


def at(plant: MechanismPlant, body: str) -> tuple[float, float]:
    """Return position and speed of a body."""
    place = 2 * list(plant.mechanism.axes).index(body)
    truth: list[Any] = plant.truth()
    return float(truth[place]), float(truth[place + 1])


def force_in(plant: MechanismPlant, element: str) -> float:
    """Return the force in an element."""
    return float(plant.memory.terms["f"][plant.mechanism.index[element]])


def command(plant: MechanismPlant, drive: str, value: float) -> None:
    """Enable a drive with a setpoint."""
    names = [item.name for item in plant.mechanism.drives]
    plant.command(names.index(drive), value, enabled=True)
