"""Simulates a rig by a co-simulation unit (FMU) of FMI 2 or 3."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, ClassVar

from annotated_types import Ge, Le

from rigd.model.errors import ConfigError
from rigd.sdk import DeviceError, Plant, PlantConfig
from rigd_sim.fmu.description import Variable
from rigd_sim.fmu.messages import Wires
from rigd_sim.fmu.options import UnitOptions, find, misfit
from rigd_sim.fmu.process import FmuProcess


class FmuConfig(UnitOptions, PlantConfig):
    """Which FMU, and with which values it begins."""

    steps: Annotated[int, Ge(1), Le(1000)] = 1
    """Communication steps in a cycle."""

    def attachments(self) -> Mapping[str, str]:
        """Return what the FMU is, and its model description."""
        return self.explained(steps=self.steps)


class FmuPlant(Plant):
    """An FMU that is stepped on a grid: the cycle, or a whole fraction of it.

    Devices choose variables by :meth:`add_input` and :meth:`add_output`, set ``inputs`` and read
    :meth:`outputs_at`, both in the FMU's own units. The FMU runs in a process of its
    own. What it returns is held until the next step.

    Raises:
        ConfigError: the FMU cannot be set up, or its step does not fit the cycle.

    """

    Config: ClassVar[type[PlantConfig]] = FmuConfig
    seeded: ClassVar[bool] = False
    title: ClassVar[str] = "co-simulation unit (FMU) of FMI 2 or 3"
    config: FmuConfig

    def __init__(self, config: FmuConfig, *, period_ns: int, seed: int) -> None:
        super().__init__(config, period_ns=period_ns, seed=seed)
        self.fmu = config.fmu
        #: The communication step in ns.
        self.grid_ns = self._grid()
        #: What the FMU gets at the next step, in the order of :meth:`add_input`.
        self.inputs: list[float] = []
        #: What it returned at the last one, in the order of :meth:`add_output`.
        self.outputs: list[float] = []
        #: Steps taken.
        self.steps = 0
        self._inputs: list[Variable] = []
        self._outputs: list[Variable] = []
        self._wired = False
        try:
            self._process = FmuProcess(
                self.fmu,
                config.start_values(),
                step_ns=self.grid_ns,
                setup_s=config.set_up,
                deadline_s=config.deadline,
            )
        except DeviceError as error:
            raise ConfigError(str(error)) from error

    def _grid(self) -> int:
        grid_ns, rest = divmod(self.period_ns, self.config.steps)
        if rest:
            raise ConfigError(
                f"{self.fmu.path.name}: {self.config.steps} steps do not divide a cycle of "
                f"{self.period_ns} ns into whole nanoseconds",
                hint="change 'steps' of the plant",
            )
        if text := misfit(self.fmu, grid_ns):
            raise ConfigError(text, hint="change 'steps' of the plant, or 'cycle' of the rig")
        return grid_ns

    def add_input(self, name: str, number: float) -> int:
        """Choose an input, and its value until another is set; return its place in ``inputs``."""
        self._wired = False
        self._inputs.append(find(self.fmu, name))
        self.inputs.append(number)
        return len(self.inputs) - 1

    def add_output(self, name: str) -> int:
        """Choose a variable to be read; return its place in ``outputs``."""
        self._wired = False
        self._outputs.append(find(self.fmu, name))
        self.outputs.append(math.nan)
        return len(self.outputs) - 1

    def outputs_at(self, t_ns: int) -> list[float]:
        """Return the outputs at ``t_ns``, advancing to it if needed; raises as :meth:`evolve`."""
        self.advance(t_ns)
        if not self._wired:
            self._take(0)
        return self.outputs

    def evolve(self, t_ns: int, elapsed_ns: int) -> None:
        """Take the steps up to ``t_ns``; see :class:`rigd.sdk.Plant`.

        Raises:
            DeviceError: the FMU returned an error or no number, crashed, or did not return.
        """
        due = t_ns // self.grid_ns
        if due > self.steps or not self._wired:
            self._take(due - self.steps)

    def _take(self, count: int) -> None:
        if not self._wired:
            self._process.wire(
                Wires(
                    [(item.kind, item.reference) for item in self._inputs],
                    [(item.kind, item.reference) for item in self._outputs],
                )
            )
            self._wired = True
        self.outputs = self._process.take(self.steps, count, self.inputs)
        self.steps += count
        if not all(map(math.isfinite, self.outputs)):
            self._refuse_what_is_no_number()

    def close(self) -> None:
        """End the process of the FMU; a second call does nothing."""
        self._process.close()

    def _refuse_what_is_no_number(self) -> None:
        for item, number in zip(self._outputs, self.outputs, strict=True):
            if not math.isfinite(number):
                at_s = self.steps * self.grid_ns * 1e-9
                raise self._process.fail(f"{item.name!r} is {number} after {at_s:.9g} s")
