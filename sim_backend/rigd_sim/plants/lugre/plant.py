"""The plant of the LuGre rig: holds the state, advances it, and keeps the sensors' readings."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from annotated_types import Ge, Le

from rigd.sdk import In, Plant, PlantConfig
from rigd_sim.plants.lugre import layout

if TYPE_CHECKING:  # the physics (numpy, numba) loads when a plant is built, not when checked
    import numpy as np
    from numpy.typing import NDArray


class LugreConfig(PlantConfig):
    """Which rig is simulated, on which floor, and how honest its sensors are."""

    parameters: str = "lugre.yaml"
    """File of physical parameters: beside the rig file, or a shipped name."""
    floor: Literal["stone", "pvc", "paperboard"] = "stone"
    """The floor under the wheel at the start."""
    mass: Annotated[float, In("kg"), Ge(0.5), Le(20)] | None = None
    """Mass of the quarter model with its weights; by default that of the parameter file."""
    noise: bool = True
    """Whether sensors have noise, bias and finite resolution; false: ideal sensors."""
    vibration: bool = True
    """Whether the rollers' transitions shake the carriage and the accelerometer."""


class LugrePlant(Plant):
    """The rig's physics and sensors; devices write ``commands`` and read ``readings_at``.

    Deterministic: the same seed and the same commands at the same times give the same readings
    bit for bit, however the time between two commands is divided into cycles that are multiples
    of 0.125 ms. The noise depends on seed and time alone.

    Raises:
        ConfigError: the parameter file cannot be read or is not physical.

    """

    Config: ClassVar[type[PlantConfig]] = LugreConfig
    config: LugreConfig
