"""Defines the base class of simulations: simulated devices in their own process.

The drivers reach the simulated devices through real connections.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

from rigd.sdk.options.documented_model import Documented
from rigd.sdk.setting import Setting


class SimulationConfig(Documented):
    """The options of one simulation in a rig file: frozen, every key known and documented."""


class Simulation(ABC):
    """Simulated devices that the drivers of a rig reach in the same way as real devices.

    Constructed as ``Simulation(config)`` in the process that serves (``rigd sim``), and in
    processes that send requests to it (``rigd run`` answering a prompt, a fault campaign).
    """

    Config: ClassVar[type[SimulationConfig]] = SimulationConfig
    title: ClassVar[str] = ""

    def __init__(self, config: Any) -> None:
        self.config = config

    @abstractmethod
    def serve(
        self,
        started: Callable[[Sequence[str]], None],
        stop: Callable[[], bool],
        faults: Path | None = None,
    ) -> None:
        """Serve until ``stop()``; ``started`` gets a line per device when all can be reached.

        ``faults`` is a file of faults for the devices to show.

        Raises:
            LinkError: a required name or port is in use.
            ConfigError: the file of faults is wrong.
        """

    @abstractmethod
    def ask(self, request: Mapping[str, Any]) -> Mapping[str, Any]:
        """Ask the process that serves to change the plant, inject a fault, or show its state.

        ``{"do": "change", "quantity": "floor", "value": "pvc"}``, ``{"do": "state"}``,
        ``{"do": "fault", ...}``, ``{"do": "clear"}``.

        Raises:
            LinkError: no process serves.
            ValueError: the request cannot be met; the message lists the possible requests.

        """

    @classmethod
    def of_makes(cls, config: Any, makes: Mapping[str, str]) -> Any:
        """Return ``config`` with simulated devices of these makes, by device; "" is every one.

        Raises:
            ValueError: there is no such make or device; the message lists those there are.

        """
        raise ValueError(f"the devices of {cls.title or cls.__name__} are of no make")

    @classmethod
    def files(cls, config: Any) -> Mapping[Path, str]:
        """Return path and text of the files that it is made from; see :meth:`PlantConfig.files`."""
        return {}

    @classmethod
    def settings(cls, config: Any) -> Mapping[str, Setting] | None:
        """Return the settings for ``change``, see :meth:`PlantConfig.settings`; None: unknown."""
        return None
