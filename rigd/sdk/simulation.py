"""Base class of simulated devices in a process of their own behind real connections."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

from rigd.sdk.documented import Documented
from rigd.sdk.setting import Setting


class SimulationConfig(Documented):
    """The options of one simulation in a rig file: frozen, every key known and documented."""


class Simulation(ABC):
    """Simulated devices that the drivers of a rig reach as they would reach real ones.

    Constructed as ``Simulation(config)`` in the process that serves (``rigd sim``), and in those
    that ask something of it (``rigd run`` answering a prompt, a fault campaign).
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
        """Serve until ``stop()``; ``started`` gets a line per device once all can be reached.

        ``faults`` is a file of faults that the devices show as it says.

        Raises:
            LinkError: a name or port it needs is taken.
            ConfigError: the file of faults is wrong.

        """

    @abstractmethod
    def ask(self, request: Mapping[str, Any]) -> Mapping[str, Any]:
        """Ask the process that serves: change the plant, inject a fault, show its state.

        ``{"do": "change", "quantity": "floor", "value": "pvc"}``, ``{"do": "state"}``,
        ``{"do": "fault", ...}``, ``{"do": "clear"}``.

        Raises:
            LinkError: nobody serves.
            ValueError: the request cannot be met; says what can.

        """

    @classmethod
    def files(cls, config: Any) -> Mapping[Path, str]:
        """Return path and text of the files that it is made from; see :meth:`PlantConfig.files`."""
        return {}

    @classmethod
    def settings(cls, config: Any) -> Mapping[str, Setting] | None:
        """Return what ``change`` takes, see :meth:`PlantConfig.settings`; None: it is not known."""
        return None
