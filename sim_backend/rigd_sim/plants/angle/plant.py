"""The plant of the approach-angle rig: set-up, state, history of signals."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Final, Literal

from annotated_types import Ge, Gt, Le
from pydantic import ValidationInfo, field_validator

from rigd.sdk import In, Plant, PlantConfig
from rigd_sim.plants.angle import layout
from rigd_sim.plants.angle.answers import choice, mounted_deg, number
from rigd_sim.plants.angle.files import find_parameters, load_parameters

if TYPE_CHECKING:  # the physics (numpy, numba) loads when a plant is built, not when checked
    import numpy as np
    from numpy.typing import NDArray

    from rigd_sim.plants.angle.parameters import AngleParameters

#: What the bolts can set, in kg, and the regulator, in V.
LIGHTEST_KG: Final = 1.0
HEAVIEST_KG: Final = 12.0
HIGHEST_V: Final = 12.0
#: Readings of the scale that must agree before it calls them stable (2 s), how far they may lie
#: apart, and where overload begins beyond the capacity (OIML R 76-1, 4.2.3), both in divisions.
AGREEING: Final = 8
AGREEMENT: Final = 5.0
OVER_DIVISIONS: Final = 9.0
#: What of the state begins anew with a run.
_MOVING: Final = (
    *("i", "rotor_speed", "wheel", "w", "x", "v", "vy"),
    *("closed", "was_closed", "command_at", "started", "relaxed", "awake", "spike"),
)


class AngleConfig(PlantConfig):
    """Which rig is simulated, how it is set up at the start, and how honest its sensors are."""

    parameters: str = "approach_angle.yaml"
    """File of physical parameters: beside the rig file, or a shipped name."""
    individual: Annotated[int, Ge(0)] = 1
    """Which individual rig: its deviations are drawn from the tolerances with this number."""
    angle: Annotated[float, In("rad")] = 0.0
    """Approach angle at the start."""
    wheel: Literal["clean", "coated"] = "clean"
    """The wheel on the shaft at the start."""
    load: Annotated[float, In("kg"), Ge(LIGHTEST_KG), Le(HEAVIEST_KG)] = 4.0
    """Load that the bolts set at the start."""
    voltage: Annotated[float, In("V"), Gt(0), Le(HIGHEST_V)] = 4.0
    """Voltage of the motor's regulator at the start."""
    noise: bool = True
    """Whether sensors err, loads and surfaces scatter and the normal force varies; false: as in a
    drawing."""
    drag: bool = True
    """Whether bearings, rollers, rolling and rails resist and the rolling radius differs from the
    nominal one; false: only the contact, the motor and its gearbox do."""

    @field_validator("angle")
    @classmethod
    def _angle_can_be_mounted(cls, angle: float) -> float:
        return math.radians(mounted_deg(angle))

    @field_validator("parameters")
    @classmethod
    def _parameters_exist(cls, name: str, info: ValidationInfo) -> str:
        """Resolve the file; ``folder`` in the validation context is where the rig file stands."""
        folder = (info.context or {}).get("folder")
        return str(find_parameters(name, None if folder is None else Path(folder)))


class AnglePlant(Plant):
    """Physics of the approach-angle rig, and the history of what its sensors are given.

    Time goes in steps of 1/19200 s from the first call of :meth:`advance`; how it is divided into
    calls changes nothing, bit for bit. While everything rests and the relay is open, waiting costs
    next to nothing. The relay is commanded by :meth:`command`.

    The wheel has been turned, and the platform pushed, back to the start when the plant is made;
    every ``change("platform", "start")`` begins a new run, with a scatter of its own.

    Raises:
        ConfigError: the parameter file cannot be read or is not physical.

    """

    Config: ClassVar[type[PlantConfig]] = AngleConfig
    config: AngleConfig

    def __init__(
        self,
        config: AngleConfig,
        *,
        period_ns: int,
        seed: int,
        parameters: AngleParameters | None = None,
    ) -> None:
        super().__init__(config, period_ns=period_ns, seed=seed % 2**40)
        import numpy as np

        from rigd_sim.plants.angle import draws, kernel, records

        #: Those of the file that ``config`` names, where they are not given.
        self.parameters = parameters or load_parameters(find_parameters(config.parameters))
        self.noise = config.noise
        self.individual = (
            draws.individual(self.parameters, config.individual)
            if config.noise
            else draws.Individual()
        )
        self._draws, self._kernel, self._records = draws, kernel, records
        self._loads = self._runs = 0
        self._angle = 0.0
        self._wheel: str = config.wheel
        self._state = np.zeros(1, records.STATE)
        self._scale = np.full(AGREEING, math.nan)
        #: What the sensors are given and the truth, a row (layout.HISTORY) per step, in a ring.
        self.history: NDArray[np.float64] = np.zeros((layout.HISTORY_ROWS, len(layout.HISTORY)))
        #: When step 0 was, and the time that the plant stands at.
        self.origin_ns = self.now_ns = 0
        #: Steps taken.
        self.steps = 0
        self._begun = False

        self._bench = records.Bench(angle=0.0, limit=math.nan, load_n=0.0, voltage=config.voltage)
        self._run = draws.Run()
        self._set()
        self._set_angle(config.angle)
        self._set_load(config.load)
        self._begin_run()
        self._state["shown_load"] = self._bench.load_n
        self._show_first()
        # Compiles, or loads what was compiled before: the first cycle must not wait for it.
        self._step_to(0)

    @classmethod
    def files(cls, config: AngleConfig) -> Mapping[Path, str]:
        """Return the file of physical parameters.

        Raises:
            ConfigError: it is not physical, or cannot be read.

        """
        path = find_parameters(config.parameters)
        load_parameters(path)
        return {path: path.read_text("utf-8")}

    def advance(self, t_ns: int) -> None:
        """Take the steps up to ``t_ns``; see :class:`rigd.sdk.Plant`.

        Raises:
            ValueError: ``t_ns`` lies before the last call.

        """
        if not self._begun:
            self.origin_ns = self.now_ns = t_ns
            self._begun = True
        if t_ns < self.now_ns:
            raise ValueError(f"the plant stands at {self.now_ns} ns and cannot go back to {t_ns}")
        last = (t_ns - self.origin_ns) * layout.STEPS_PER_S // 1_000_000_000
        if last > self.steps:
            self._step_to(last)
        self.now_ns = t_ns

    def _step_to(self, last: int) -> None:
        self._kernel.advance(
            self._constants, self._state, self.history, self._scale, self.seed,
            self.steps, last, 1.0 / layout.STEPS_PER_S,
        )  # fmt: skip
        self.steps = last

    def command(self, closed: bool) -> None:
        """Command the relay to close or to open, from now on.

        Raises:
            ValueError: it is to close, and nobody knows the friction of what is set up.

        """
        if closed:
            self._limit_known()
        state = self._state[0]
        if closed == (state["command"] > 0.5):
            return
        state["command"] = float(closed)
        state["command_at"] = (self.now_ns - self.origin_ns) * 1e-9
        state["was_closed"] = state["closed"]

    @property
    def closed(self) -> bool:
        """Whether the relay's contact conducts."""
        return bool(self._state["closed"][0] > 0.5)

    @property
    def truth(self) -> list[float]:
        """The hidden state at the last step, in the order of ``layout.TRUTH``."""
        row: list[float] = self.history[self.steps % layout.HISTORY_ROWS].tolist()
        return row[layout.FIRST_TRUTH :]

    @property
    def torque_scale(self) -> float:
        """N m per V of (gauge a - gauge b), found with a weight on the arm's nominal length."""
        c, arm = self._constants[0], self.parameters.calibration_arm
        strains = c["gain_a"] * c["shear_a"] - c["gain_b"] * c["shear_b"]
        volts_per_torque = c["gauge_sensitivity"] * c["shear_per_torque"] * strains
        true_arm = arm.length + self.individual.arm_deviation_m
        return float(arm.length / (true_arm * volts_per_torque))

    @property
    def resting(self) -> bool:
        """Whether everything stands still."""
        return not self._state["awake"][0]

    @property
    def scale_readings(self) -> int:
        """How many readings the scale has taken."""
        return int(self._state["readings"][0])

    def scale(self) -> tuple[float, int]:
        """Return mass in kg and status word (layout.STABLE, ...) of the scale's last reading.

        The mass is NaN before the first reading.
        """
        scale, shown = self.parameters.scale, self._scale
        spread = float(shown.max() - shown.min())  # NaN until there are enough
        status = layout.STABLE if spread <= (AGREEMENT + 1e-6) * scale.division else 0
        mass = round(float(shown[0]), 9)  # a display shows 5.02, not 5.0200000000000005
        if mass > scale.capacity + OVER_DIVISIONS * scale.division:
            status = layout.OVERLOAD
        return mass, status

    def change(self, quantity: str, value: float | str) -> None:
        """Change what a person would change at the bench, from now on.

        For a run: ``angle`` (rad: 0, 15, 30, 45 deg), ``wheel`` (clean, coated), ``load`` (kg),
        ``voltage`` (V), ``platform`` (start: pushed back, and the wheel turned back). For a
        calibration: ``shaft`` (free, clamped), ``arm_mass`` (kg, on the arm of the clamped shaft),
        ``wheel_lift`` (lifted, down), ``push`` (m/s, given to the platform), ``platform`` (end:
        pushed to where runs stop), ``scale_weight`` (kg, laid on the scale). To spoil runs:
        ``rubbing`` (N m, downstream of the gauges) and ``fault`` (``layout.FAULTS``).

        Raises:
            ValueError: no such quantity, or a value that cannot be.

        """
        changes: dict[str, Callable[[float | str], None]] = {
            "angle": self._set_angle,
            "wheel": self._fit_wheel,
            "load": self._set_load,
            "voltage": self._set_voltage,
            "platform": self._push_platform,
            "push": self._push,
            "wheel_lift": self._lift_wheel,
            "shaft": self._clamp_shaft,
            "arm_mass": self._load_arm,
            "scale_weight": self._load_scale,
            "rubbing": self._rub,
            "fault": self._spoil,
        }
        if quantity not in changes:
            raise ValueError(f"this plant has no {quantity!r}; it can change {', '.join(changes)}")
        changes[quantity](value)
        self._show_first()

    # What people do at the bench.

    def _set_angle(self, value: float | str) -> None:
        self._angle = mounted_deg(number("angle", value, "rad", -math.pi, math.pi))
        self._surface()

    def _fit_wheel(self, value: float | str) -> None:
        self._wheel = choice("wheel", value, layout.WHEELS)
        self._surface()

    def _surface(self) -> None:
        limit = self.parameters.limits.of(self._angle, self._wheel)
        self._set(angle=math.radians(self._angle), limit=math.nan if limit is None else limit)
        self._touch_anew()

    def _set_load(self, value: float | str) -> None:
        mass = number("load", value, "kg", LIGHTEST_KG, HEAVIEST_KG)
        scatter = (
            self._draws.load_scatter(self.parameters, self.seed, self._loads) if self.noise else 1.0
        )
        self._loads += 1
        self._set(load_n=mass * self.parameters.gravity * scatter)

    def _set_voltage(self, value: float | str) -> None:
        self._set(voltage=number("voltage", value, "V", 0.0, HIGHEST_V))

    def _push_platform(self, value: float | str) -> None:
        place = choice("platform", value, ("start", "end"))
        if self._state["command"][0] > 0.5:
            raise ValueError("the relay is closed: nobody pushes the platform now")
        if self._bench.clamped:
            raise ValueError("the shaft is clamped: the wheel cannot turn along; free it first")
        if place == "end":
            self._push_to_end()
        else:
            self._limit_known()
            self._begin_run()

    def _push_to_end(self) -> None:
        """Bring the platform to where runs stop; the wheel, and the motor with it, rolls along."""
        state, c = self._state, self._constants
        if not self._bench.lifted:
            turned = (c["stop"] - state["x"]) * c["cosine"] / c["effective_radius"]
            state["wheel"] += turned
            state["rotor"] += turned
        state["x"] = c["stop"]
        for name in ("i", "rotor_speed", "w", "v", "awake"):
            state[name] = 0.0
        self._touch_anew()

    def _begin_run(self) -> None:
        if self.noise:
            self._run = self._draws.run(self.parameters, self.seed, self._runs)
        self._runs += 1
        state = self._state
        for name in _MOVING:
            state[name] = 0.0
        state["rotor"] = self._run.gap * self.parameters.shaft.backlash
        self._set()
        self._touch_anew()

    def _push(self, value: float | str) -> None:
        self._state["v"] = number("push", value, "m/s", -2.0, 2.0)
        self._state["awake"] = 1.0

    def _lift_wheel(self, value: float | str) -> None:
        self._set(lifted=choice("wheel_lift", value, ("lifted", "down")) == "lifted")
        self._touch_anew()

    def _clamp_shaft(self, value: float | str) -> None:
        clamped = choice("shaft", value, ("free", "clamped")) == "clamped"
        if clamped:
            for name in ("rotor_speed", "w"):
                self._state[name] = 0.0
        self._set(clamped=clamped, arm_mass=self._bench.arm_mass if clamped else 0.0)

    def _load_arm(self, value: float | str) -> None:
        mass = number("arm_mass", value, "kg", 0.0, 10.0)
        if mass > 0.0 and not self._bench.clamped:
            raise ValueError("the arm holds no weight on a free shaft; clamp the shaft first")
        self._set(arm_mass=mass)

    def _load_scale(self, value: float | str) -> None:
        self._set(known_mass=number("scale_weight", value, "kg", 0.0, 50.0))

    def _rub(self, value: float | str) -> None:
        self._set(rubbing=number("rubbing", value, "N m", 0.0, 2.0))

    def _spoil(self, value: float | str) -> None:
        self._set(fault=choice("fault", value, tuple(layout.FAULTS)))

    # What follows from it.

    def _set(self, **changed: float | str) -> None:
        self._bench = replace(self._bench, **changed)  # type: ignore[arg-type] # by name
        self._constants = self._records.constants(
            self.parameters, self.individual, self._run, self._bench,
            noise=self.noise, drag=self.config.drag,
        )  # fmt: skip

    def _touch_anew(self) -> None:
        """Lay the wheel on the surface: bristles straight, breakaway surplus there."""
        self._kernel.touch(self._constants, self._state)

    def _show_first(self) -> None:
        """Let the sensors see what is set up before the first step."""
        if not self._begun:
            self._kernel.show_now(self._constants, self._state, self.history[0])

    def _limit_known(self) -> None:
        if math.isnan(self._bench.limit) and self._bench.fault != "no_sliding":
            raise ValueError(
                f"no friction is published for the {self._wheel} wheel at {self._angle:g} deg; "
                f"known are {', '.join(layout.SETS)}"
            )
