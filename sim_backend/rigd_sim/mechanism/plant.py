"""Simulates a mechanism that a file describes."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from rigd.sdk import Energy, ParametersConfig, Plant, PlantConfig, Setting, shipped_configs
from rigd_sim.mechanism.network import STEP_NS, Kind, Mechanism

if TYPE_CHECKING:  # the physics (numpy, numba) loads when a plant is built, not when checked
    from rigd_sim.mechanism.assembly import MechanismDescription


class MechanismConfig(ParametersConfig):
    """Which mechanism is simulated, and whether its sensors have errors."""

    shipped_folder: ClassVar[Path] = shipped_configs() / "plants"

    parameters: str = "pin_on_disk.yaml"
    """File that describes it: beside the rig file, or a shipped name."""
    noise: bool = True
    """Whether sensors have noise, zeros and finite resolution; false: ideal sensors."""

    @classmethod
    def parameter_model(cls) -> type[MechanismDescription]:
        """Return what the file holds."""
        from rigd_sim.mechanism.assembly import MechanismDescription

        return MechanismDescription

    def mechanism(self) -> Mechanism:
        """Return what the file describes.

        Raises:
            ConfigError: see :meth:`ParametersConfig.read_parameters`.
        """
        described: MechanismDescription = self.read_parameters()
        return described.mechanism

    def settings(self) -> Mapping[str, Setting]:
        """Return the loads that people can put on; see :meth:`PlantConfig.settings`."""
        return {
            f"{item.name}_load": Setting(
                f"the load on {item.name}", unit=item.load_unit, low=0.0, high=item.most_load
            )
            for item in self.mechanism().elements
            if item.most_load > 0.0
        }


class MechanismPlant(Plant):
    """Bodies, what connects them, drives and sensors, simulated in process.

    Devices write :meth:`command` and read :meth:`readings_at`. Deterministic: the same seed and the
    same commands at the same times give the same readings bit for bit. Until a drive is enabled,
    it gives no force.

    Raises:
        ConfigError: the file cannot be read or describes no mechanism.

    """

    Config: ClassVar[type[PlantConfig]] = MechanismConfig
    title: ClassVar[str] = "mechanism in a file: bodies, springs, friction, drives, sensors"
    step_ns: ClassVar[int] = STEP_NS
    #: Of the method it is 4; kinks of friction laws and limits of drives leave 2.
    order: ClassVar[int] = 2
    config: MechanismConfig

    def __init__(self, config: MechanismConfig, *, period_ns: int, seed: int) -> None:
        super().__init__(config, period_ns=period_ns, seed=seed % 2**63)
        from rigd_sim.mechanism import kernel, records

        self.mechanism = config.mechanism()
        self._kernel = kernel
        self.memory = records.memory(self.mechanism, noise=config.noise)
        self._step_ns = self.step_ns / self.mechanism.parts
        self._drives = [item.name for item in self.mechanism.drives]
        #: What the sensors show, in the order of the file; then the true temperatures.
        self.readings: list[float] = []
        # Compiles, or loads what was compiled before: the first cycle must not wait for it.
        self.evolve(0, 0)
        self.memory.tally["begun"] = 0.0

    def command(self, drive: int, value: float, *, enabled: bool) -> None:
        """Give a drive a setpoint in SI, held until the next one."""
        self.memory.commands[drive, 0] = value
        self.memory.commands[drive, 1] = float(enabled)

    def resting(self, drive: int) -> float:
        """Return the setpoint at which a drive does nothing: where it is, if it takes positions."""
        item = self.mechanism.drives[drive]
        if item.kind != Kind.POSITION:
            return 0.0
        (end,) = item.ends
        return item.offset + end.lever * float(self.memory.state[end.dof])

    def evolve(self, t_ns: int, elapsed_ns: int) -> None:
        """Integrate and take all readings; see :class:`rigd.sdk.Plant`."""
        m = self.memory
        self._kernel.advance(
            m.masses, m.elements, m.sensors, m.warm, m.heat, m.ambient, m.commands, m.state,
            m.terms, m.again, m.work, m.filters, m.tally, m.readings,
            self.seed, t_ns, elapsed_ns, self._step_ns,
        )  # fmt: skip
        self.readings = m.readings.tolist()

    def readings_at(self, t_ns: int) -> list[float]:
        """Return what the sensors show at ``t_ns``, advancing to it if needed."""
        if t_ns != self.now_ns or not self.begun:
            self.advance(t_ns)
        return self.readings

    def truth(self) -> list[float]:
        """Return the hidden state in the order of :meth:`truth_names`."""
        m, bodies = self.memory, len(self.mechanism.masses)
        state = m.state.tolist()
        values = []
        for axis in self.mechanism.axes.values():
            values.append(axis.start + axis.factor * state[axis.dof])
            values.append(axis.factor * state[bodies + 1 + axis.dof])
        values += m.terms["f"].tolist()
        return values + self.readings[len(self.mechanism.instruments) :]

    def energy(self) -> Energy:
        """Return where the energy is; it is counted from the first call on."""
        m = self.memory
        if m.tally["counting"][0] == 0.0:
            m.tally["counting"] = 1.0
        stored = self._kernel.stored(m.masses, m.terms, m.state)
        return Energy(stored, float(m.tally["supplied"][0]), float(m.tally["dissipated"][0]))

    def apply(self, quantity: str, value: float | str) -> None:
        """Put another load, in N or kg, on a friction element."""
        name = quantity.removesuffix("_load")
        element = self.mechanism.element(name)
        factor = self.mechanism.gravity if element.load_unit == "kg" else 1.0
        self.memory.elements["load"][self.mechanism.index[name]] = float(value) * factor


def truth_of(mechanism: Mechanism) -> tuple[tuple[str, str, str], ...]:
    """Return name, unit and meaning of the hidden state, in the order of ``truth()``."""
    found = []
    for name, axis in mechanism.axes.items():
        what = "angle" if axis.turns else "position"
        found.append((f"{name}_position", axis.unit, f"{what} of {name}"))
        found.append((f"{name}_speed", f"{axis.unit}/s", f"speed of {name}"))
    for item in mechanism.elements:
        what = "torque" if item.force_unit == "N m" else "force"
        name = item.name.replace(".", "_")
        found.append((f"{name}_force", item.force_unit, f"{what} in {item.name}"))
    found += [(f"{part.name}_temperature", "K", f"of {part.name}") for part in mechanism.warm]
    return tuple(found)
