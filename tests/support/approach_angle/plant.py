"""Plants of the approach-angle rig for tests: varied, set up, and their history."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from numpy.typing import NDArray

from rigd_sim.approach_angle import layout
from rigd_sim.approach_angle.acquisition import Acquisition
from rigd_sim.approach_angle.parameters import AngleParameters
from rigd_sim.approach_angle.plant import AngleConfig, AnglePlant

MS = 1_000_000
S = 1_000_000_000


@cache
def shipped() -> AngleParameters:
    """Return the shipped parameters."""
    parameters: AngleParameters = AngleConfig().read_parameters()
    return parameters


def varied(**parts: dict[str, object]) -> AngleParameters:
    """Return the shipped parameters with keys of parts changed: ``relay={"brake": True}``."""
    changed = {
        name: getattr(shipped(), name).model_copy(update=values) for name, values in parts.items()
    }
    return shipped().model_copy(update=changed)


def make_plant(
    set_name: str = "clean_0",
    load_kg: float = 4.0,
    voltage_v: float = 10.0,
    *,
    seed: int = 1,
    parameters: AngleParameters | None = None,
    **options: object,
) -> AnglePlant:
    """Return a plant that stands at time 0, set up for a run."""
    plant = AnglePlant(
        AngleConfig.model_validate(options),
        period_ns=MS,
        seed=seed,
        parameters=parameters or shipped(),
    )
    degrees, wheel = layout.SETS[set_name]
    plant.change("angle", math.radians(degrees))
    plant.change("wheel", wheel)
    plant.change("load", load_kg)
    plant.change("voltage", voltage_v)
    plant.advance(0)
    return plant


def pass_time(plant: AnglePlant, seconds: float) -> None:
    """Let time pass."""
    plant.advance(plant.now_ns + round(seconds * S))


def truth(plant: AnglePlant, name: str) -> float:
    """Return one quantity of the hidden state."""
    return plant.truth[[known for known, _, _ in layout.TRUTH].index(name)]


def history(plant: AnglePlant) -> dict[str, NDArray[np.float64]]:
    """Return all that the plant remembers, by name, a value per step since step 0."""
    if plant.steps >= layout.HISTORY_ROWS:
        raise ValueError("the beginning is forgotten; let less time pass")
    rows = plant.history[: plant.steps + 1]
    return {name: rows[:, k].copy() for k, name in enumerate(layout.HISTORY)}


def mean_volts(plant: AnglePlant, seconds: float = 0.5) -> NDArray[np.float64]:
    """Return the mean of each input over some time from now on."""
    card = Acquisition(plant, start_ns=plant.now_ns, load_cell=True)
    blocks = [card.read_due().volts for _ in range(round(seconds * card.rate_hz / card.block))]
    mean: NDArray[np.float64] = np.concatenate(blocks).mean(axis=0)
    return mean
