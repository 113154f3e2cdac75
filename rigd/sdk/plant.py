"""Base class of plants: the physics of a simulated rig, advanced by the clock of the rig."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

from rigd.sdk.documented import Documented


class PlantConfig(Documented):
    """The options of one plant in a rig file: frozen, every key known, every field documented."""


class Plant(ABC):
    """The physics that the simulated devices of one rig share.

    Constructed as ``Plant(config, period_ns=..., seed=...)``. The same seed and the same commands
    at the same times give the same samples bit for bit.
    """

    Config: ClassVar[type[PlantConfig]] = PlantConfig

    def __init__(self, config: Any, *, period_ns: int, seed: int) -> None:
        self.config = config
        self.period_ns = period_ns
        self.seed = seed

    @classmethod
    def files(cls, config: Any) -> Mapping[Path, str]:
        """Return path and text of the files, beyond the rig file, that the plant is made from.

        They are attached to recordings, and checked by ``rigd check``.

        Raises:
            ConfigError: one of them is wrong.
        """
        return {}

    @abstractmethod
    def advance(self, t_ns: int) -> None:
        """Bring the physics to ``t_ns`` with the inputs held since the last call.

        Again at the same time does nothing; the first call sets the origin of time.
        """

    @abstractmethod
    def change(self, quantity: str, value: float | str) -> None:
        """Change what a person would change at the bench: the floor, a weight.

        Raises:
            ValueError: the plant has no such ``quantity``, or cannot take ``value``.

        """
