"""Simulates the articulated robot: places it, advances its state, and keeps its past poses."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Final, Literal

from rigd.sdk import Energy, ParametersConfig, Plant, PlantConfig, Setting, shipped_configs
from rigd_sim.articulated import layout

if TYPE_CHECKING:  # the physics (numpy, numba) loads when a plant is built, not when checked
    import numpy as np
    from numpy.typing import NDArray

    from rigd_sim.articulated.parameters import ArticulatedParameters

#: What people can change at the bench.
SETTINGS: Final = {
    "robot": Setting("the robot, put back to its marks: stretched along x", ("start",), moves=True),
}
#: Added to the seed of a plant: the draws of placing, beside those of the drives' noise.
PLACING_SEED: Final = 1 << 41


class ArticulatedConfig(ParametersConfig):
    """Which robot is simulated, by which laws, and whether its sensors err."""

    shipped_folder: ClassVar[Path] = shipped_configs() / "plants"

    parameters: str = "articulated.yaml"
    """File of physical parameters: beside the rig file, or a shipped name."""
    law: Literal["paper", "smooth", "linear"] = "paper"
    """The contact law: that of the paper, which jumps from mu_s to mu_d; a smooth one, which is the
    paper's but within `friction.width` of the jump; or one without saturation."""
    loads: Literal["equal", "module", "transfer", "vertical"] = "equal"
    """The normal forces: equal on all wheels, as in the paper; each module's own weight; with
    load transfer by the forces along and across; or by heave, roll and pitch on the suspension."""
    noise: bool = True
    """Whether the drives' feedback has noise, the camera errs and loses markers, and the robot is
    placed by hand; false: exact. The camera's latency stays."""

    @classmethod
    def parameter_model(cls) -> type[ArticulatedParameters]:
        """Return what the parameter file holds."""
        from rigd_sim.articulated.parameters import ArticulatedParameters

        return ArticulatedParameters

    def settings(self) -> Mapping[str, Setting]:
        """Return what people can change at the bench; see :meth:`PlantConfig.settings`."""
        return SETTINGS


class ArticulatedPlant(Plant):
    """Physics of the articulated robot, its drives, and the poses that a camera sees.

    Time goes in steps of ``step_ns`` from the first call of :meth:`advance`; between two points of
    that grid the state is that of the first, and the division of time into calls changes nothing.
    Devices write ``commands`` and read ``motors_at``.

    Raises:
        ConfigError: the parameter file cannot be read or is not physical.

    """

    Config: ClassVar[type[PlantConfig]] = ArticulatedConfig
    title: ClassVar[str] = "articulated robot: modules on slipping wheels, drives, camera"
    step_ns: int = layout.STEP_NS  # type: ignore[misc]  # of an instance, it depends on the loads
    order: ClassVar[int] = 4
    config: ArticulatedConfig

    def __init__(self, config: ArticulatedConfig, *, period_ns: int, seed: int) -> None:
        super().__init__(config, period_ns=period_ns, seed=seed % 2**40)
        import numpy as np

        from rigd_sim.articulated import kernel, records

        if config.loads in ("transfer", "vertical"):  # a wheel that carries twice is twice as fast
            self.step_ns //= 2
        #: Those of the file that ``config`` names.
        self.parameters: ArticulatedParameters = config.read_parameters()
        #: The contact law and the normal forces, by name: results depend on them.
        self.laws = f"contact law {config.law}, loads {config.loads}"
        self._advance, self._show = kernel.advance, kernel.show
        self._robot = records.robot(
            self.parameters, law=config.law, loads=config.loads, noise=config.noise
        )
        #: Names of the modules from first to last.
        self.modules: tuple[str, ...] = tuple(self.parameters.modules)
        #: Motor speed in rad/s and whether enabled, a row for each spin; held until written again.
        self.commands: NDArray[np.float64] = self._robot.commands()
        #: Steps taken, and how often the robot was put to its start in this trial.
        self.steps = self.placed = 0
        self._slides, self._scratch = self._robot.slides(), self._robot.scratch()
        self._aside = self._robot.scratch()  # what is shown leaves the steps as they are
        self._held = b""  #: Commands of the last step; none if the robot was placed since.
        self._track = np.zeros((layout.HISTORY_STEPS, 3 * len(self.modules)))
        self._motors = np.zeros((len(self.commands), 2))
        self._shown = np.zeros(len(layout.TRUTH))
        #: Index of the energy supplied in the state; that dissipated is behind it.
        self._energies = self._robot.first_spin + 3 * len(self.commands)
        self._state = self._robot.at_rest()
        self._put_to_start()
        # Compiles, or loads what was compiled before: the first cycle must not wait for it.
        self.evolve(0, 0)
        self.truth(0)

    def evolve(self, t_ns: int, elapsed_ns: int) -> None:
        """Take the steps up to ``t_ns``; see :class:`rigd.sdk.Plant`."""
        steps = t_ns // self.step_ns - self.steps
        held = self.commands.tobytes()
        self._advance(
            self._robot, self.commands, self._state, self._slides, self._scratch, self._track,
            self.steps, self.step_ns * 1e-9, steps, held != self._held, self._motors, self.seed,
            t_ns,
        )  # fmt: skip
        if steps > 0:
            self._held = held
        self.steps += steps

    def begin_trial(self, seed: int) -> None:
        """Draw noise and placing from ``seed`` from now on, counted anew."""
        super().begin_trial(seed)
        self.placed = 0

    def energy(self) -> Energy:
        """Return where the energy is."""
        supplied, dissipated = self._state[self._energies : self._energies + 2].tolist()
        return Energy(self._robot.stored(self._state), supplied, dissipated)

    def number(self, module: str) -> int:
        """Return the place of a module in the chain, from 0.

        Raises:
            ValueError: there is none of this name.

        """
        if module not in self.modules:
            raise ValueError(
                f"the robot has no module '{module}'; it has {', '.join(self.modules)}"
            )
        return self.modules.index(module)

    def spin_of(self, module: str, wheel: str) -> int:
        """Return the row of ``commands`` of the motor that turns a wheel (layout.WHEELS).

        Raises:
            ValueError: there is no such module, or no motor at the wheel.

        """
        place = int(self._robot.wheel_spin[self.number(module), layout.WHEELS.index(wheel)])
        if not self._robot.spins["driven"][place]:
            raise ValueError(
                f"the {wheel.replace('_', ' ')} wheel of module '{module}' has no motor"
            )
        return place

    def motors_at(self, t_ns: int) -> NDArray[np.float64]:
        """Return motor speed in rad/s and torque in N m of every spin at ``t_ns``, shape (m, 2)."""
        self.advance(t_ns)
        return self._motors

    def angle_of(self, spin: int) -> float:
        """Return the angle in rad by which the motor of a spin has turned since the origin."""
        place = self._robot.first_spin + 2 * len(self.commands) + spin
        return float(self._state[place] * self._robot.spins["ratio"][spin])

    def torque_limit(self, spin: int) -> float:
        """Return the largest torque in N m of the motor of a spin."""
        return float(self._robot.spins["torque_limit"][spin])

    def truth(self, module: int) -> list[float]:
        """Return the hidden state of a module, in the order of ``layout.TRUTH``."""
        self._show(
            self._robot, self.commands, self._state, self._slides, self._aside, module,
            self._shown,
        )  # fmt: skip
        shown: list[float] = self._shown.tolist()
        return shown

    def pose(self, module: int, t_s: float) -> tuple[float, float, float] | None:
        """Return centre (m) and heading (rad) of a module ``t_s`` after the origin of time.

        Between two steps it is on the straight line. None if it is later than the last step, or
        longer ago than ``layout.HISTORY_STEPS``.
        """
        at = t_s / (self.step_ns * 1e-9)
        before = math.floor(at + 1e-6)
        after = before if at - before < 1e-6 else before + 1
        if after > self.steps or before <= self.steps - layout.HISTORY_STEPS:
            return None
        column = slice(3 * module, 3 * module + 3)
        first = self._track[before % layout.HISTORY_STEPS, column]
        last = self._track[after % layout.HISTORY_STEPS, column]
        x, y, heading = (first + (at - before) * (last - first)).tolist()
        return x, y, heading

    def apply(self, quantity: str, value: float | str) -> None:
        """Put the robot back to its start, at rest.

        Raises:
            ValueError: a drive is enabled and the wheels turn.

        """
        first = self._robot.first_spin
        turning = self._state[first : first + len(self.commands)]
        if max(abs(turning)) > 1.0 and self.commands[:, 1].any():
            raise ValueError("the wheels turn: stop the robot before you pick it up")
        self._put_to_start()

    def _put_to_start(self) -> None:
        import numpy as np

        from rigd.sdk.noise import normal_pair

        count, placing = len(self.modules), self.parameters.placing
        scatter = np.zeros(2 + count)
        if self.config.noise:
            draws = range(16 * self.placed, 16 * self.placed + 2 + count)
            scatter[:] = [normal_pair(self.seed + PLACING_SEED, draw)[0] for draw in draws]
        self.placed += 1
        x, y = (placing.position * scatter[:2]).tolist()
        state = self._robot.placed(x, y, placing.heading * scatter[2:])
        # The motors have turned as far as before, and their energies are spent.
        counted = slice(self._energies - len(self.commands), self._energies + 2)
        state[counted] = self._state[counted]
        self._state, self._held = state, b""
        centres = self._robot.centres(state)
        row = np.column_stack([centres, state[2 : 2 + count]]).ravel()
        self._track[self.steps % layout.HISTORY_STEPS] = row
