"""Simulates the LuGre rig: holds its state, advances the state, and keeps the sensors' readings."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Final, Literal

from annotated_types import Ge, Le

from rigd.sdk import Energy, In, ParametersConfig, Plant, PlantConfig, Setting, shipped_configs
from rigd_sim.lugre import layout

if TYPE_CHECKING:  # the physics (numpy, numba) loads when a plant is built, not when checked
    import numpy as np
    from numpy.typing import NDArray

    from rigd_sim.lugre.parameters import LugreParameters

FLOORS: Final = ("stone", "pvc", "paperboard")
LIGHTEST_KG: Final = 0.5
HEAVIEST_KG: Final = 20.0


#: What people can change at the bench.
SETTINGS: Final = {
    "floor": Setting("the floor under the wheel", FLOORS),
    "mass": Setting(
        "mass of the quarter model with its weights", unit="kg", low=LIGHTEST_KG, high=HEAVIEST_KG
    ),
}


class LugreConfig(ParametersConfig):
    """Which rig is simulated, on which floor, and the errors of its sensors."""

    shipped_folder: ClassVar[Path] = shipped_configs() / "plants"

    parameters: str = "lugre.yaml"
    """File of physical parameters: beside the rig file, or a shipped name."""
    individual: Annotated[int, Ge(0)] = 0
    """Which individual rig: where wheel and carriage stand at the start, between which counts of
    their encoders, and the zeros of what is measured in volts, are drawn with this number; 0: all
    stand at zero."""
    floor: Literal["stone", "pvc", "paperboard"] = "stone"
    """The floor under the wheel at the start."""
    mass: Annotated[float, In("kg"), Ge(LIGHTEST_KG), Le(HEAVIEST_KG)] | None = None
    """Mass of the quarter model with its weights; by default that of the parameter file."""
    noise: bool = True
    """Whether sensors have noise, bias and finite resolution; false: ideal sensors."""
    vibration: bool = True
    """Whether the rollers' transitions shake the carriage and the accelerometer."""

    @classmethod
    def parameter_model(cls) -> type[LugreParameters]:
        """Return what the parameter file holds."""
        from rigd_sim.lugre.parameters import LugreParameters

        return LugreParameters

    def settings(self) -> Mapping[str, Setting]:
        """Return what people can change at the bench; see :meth:`PlantConfig.settings`."""
        return SETTINGS


class LugrePlant(Plant):
    """Physics and sensors of the LuGre rig, simulated in process.

    Devices write ``commands`` and read ``readings_at``.

    Deterministic: the same seed and the same commands at the same times give the same readings
    bit for bit. The noise depends on seed and time alone, not on how time is divided into cycles
    (the physics then differs by rounding). Until a device is armed, the wheel is without current
    and both belts are braked.

    Raises:
        ConfigError: the parameter file cannot be read or is not physical.

    """

    Config: ClassVar[type[PlantConfig]] = LugreConfig
    title: ClassVar[str] = "LuGre omni-wheel rig: wheel, guide, bridge, three floors"
    step_ns: ClassVar[int] = layout.STEP_NS
    order: ClassVar[int] = 2
    config: LugreConfig

    def __init__(self, config: LugreConfig, *, period_ns: int, seed: int) -> None:
        super().__init__(config, period_ns=period_ns, seed=seed % 2**63)
        import numpy as np

        from rigd_sim.lugre import draws, kernel, records

        self.parameters, start = draws.individual(config.read_parameters(), config.individual)
        self._advance = kernel.advance
        self._stored = kernel.stored
        self._pack = records.constants
        self._floor: str = config.floor
        self._mass = self.parameters.carriage.mass if config.mass is None else config.mass
        self._state = records.state_at_rest()
        self._state["theta"], self._state["x"] = start.wheel_rad, start.carriage_m
        self._commands = np.zeros(1, records.COMMANDS)
        self._readings = np.zeros(1, records.READINGS)
        self._shown: NDArray[np.float64] = self._readings.view(np.float64)
        #: Inputs in the order of ``layout.COMMANDS``, held until written again.
        self.commands: NDArray[np.float64] = self._commands.view(np.float64)
        self.commands[layout.BELT_COMMANDS + 1] = 1.0
        self.commands[layout.LATERAL_COMMANDS + 1] = 1.0
        #: What the sensors show, in the order of ``layout.READINGS``.
        self.readings: list[float] = []
        self._constants = self._packed()
        # Compiles, or loads what was compiled before: the first cycle must not wait for it.
        self.evolve(0, 0)

    def evolve(self, t_ns: int, elapsed_ns: int) -> None:
        """Integrate and take all readings; see :class:`rigd.sdk.Plant`."""
        self._advance(
            self._constants,
            self._state,
            self._commands,
            self._readings,
            self.seed,
            t_ns,
            elapsed_ns,
        )
        self.readings = self._shown.tolist()

    def energy(self) -> Energy:
        """Return where the energy is; it is counted from the first call on."""
        state = self._state[0]
        state["counting"] = 1.0
        stored = self._stored(self._constants, self._state)
        return Energy(stored, float(state["supplied"]), float(state["dissipated"]))

    @property
    def mass(self) -> float:
        """Mass of the quarter model with its weights, in kg."""
        return self._mass

    @property
    def floor(self) -> str:
        """The floor under the wheel."""
        return self._floor

    def readings_at(self, t_ns: int) -> list[float]:
        """Return what the sensors show at ``t_ns``, advancing to it if needed."""
        if t_ns != self.now_ns or not self.begun:
            self.advance(t_ns)
        return self.readings

    def apply(self, quantity: str, value: float | str) -> None:
        """Lay another ``floor`` or change the ``mass`` (kg) of the quarter model."""
        if quantity == "floor":
            self._floor = str(value)
            self._state["p"] = 0.0  # the contact is made again
        else:
            self._mass = float(value)
        self._constants = self._packed()

    def _packed(self) -> NDArray[np.void]:
        return self._pack(
            self.parameters,
            getattr(self.parameters.floors, self._floor),
            self._mass,
            noise=self.config.noise,
            vibration=self.config.vibration,
            step_ns=self.step_ns,
        )
