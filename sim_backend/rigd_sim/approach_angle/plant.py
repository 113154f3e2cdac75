"""Simulates the approach-angle rig: sets it up, advances its state, and keeps its past signals."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Final, Literal

from annotated_types import Ge, Gt, Le
from pydantic import field_validator

from rigd.sdk import Energy, In, ParametersConfig, Plant, PlantConfig, Setting, shipped_configs
from rigd_sim.approach_angle import layout

if TYPE_CHECKING:  # the physics (numpy, numba) loads when a plant is built, not when checked
    import numpy as np
    from numpy.typing import NDArray

    from rigd_sim.approach_angle.parameters import AngleParameters

#: What the bolts can set, in kg, and the regulator, in V.
LIGHTEST_KG: Final = 1.0
HEAVIEST_KG: Final = 12.0
HIGHEST_V: Final = 12.0
#: How far a hand brings the platform: no farther than where runs stop by the shipped parameters.
FARTHEST_M: Final = 0.3
#: What people can change at the bench.
SETTINGS: Final = {
    "angle": Setting("approach angle, bearings mounted again", layout.MOUNTED_DEG, "deg"),
    "wheel": Setting("the wheel on the shaft", layout.WHEELS),
    "load": Setting("load that the bolts set", (), "kg", LIGHTEST_KG, HEAVIEST_KG),
    "voltage": Setting("voltage of the motor's regulator", (), "V", 0.0, HIGHEST_V),
    "platform": Setting(
        "the platform, pushed to where runs start or stop", ("start", "end"), moves=True
    ),
    "platform_at": Setting(
        "travel that the platform is pushed to", (), "m", 0.0, FARTHEST_M, moves=True
    ),
    "push": Setting("speed that a hand gives to the platform", (), "m/s", -2.0, 2.0),
    "wheel_lift": Setting("the wheel, off the platform or on it", ("lifted", "down")),
    "shaft": Setting("the shaft, for a calibration of torque", ("free", "clamped")),
    "arm_mass": Setting("weight on the arm of the clamped shaft", (), "kg", 0.0, 10.0),
    "scale_weight": Setting("weights laid on the scale", (), "kg", 0.0, 50.0),
    "rubbing": Setting("torque lost behind the gauges by bad clamping", (), "N m", 0.0, 2.0),
    "fault": Setting("what may go wrong with a run", tuple(layout.FAULTS)),
}
#: Readings of the scale that must agree before it calls them stable (2 s), how far they may lie
#: apart, and where overload begins beyond the capacity (OIML R 76-1, 4.2.3), both in divisions.
AGREEING: Final = 8
AGREEMENT: Final = 5.0
OVER_DIVISIONS: Final = 9.0
#: What of the state begins again with a run.
_MOVING: Final = (
    *("i", "rotor_speed", "wheel", "w", "x", "v", "vy"),
    *("closed", "was_closed", "command_at", "started", "relaxed", "awake", "spike"),
)


class AngleConfig(ParametersConfig):
    """Which rig is simulated, its set-up at the start, and the errors of its sensors."""

    shipped_folder: ClassVar[Path] = shipped_configs() / "plants"

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
        return float(SETTINGS["angle"].accepted("angle", angle))

    @classmethod
    def parameter_model(cls) -> type[AngleParameters]:
        """Return what the parameter file holds."""
        from rigd_sim.approach_angle.parameters import AngleParameters

        return AngleParameters

    def settings(self) -> Mapping[str, Setting]:
        """Return what people can change at the bench; see :meth:`PlantConfig.settings`."""
        return SETTINGS


class AnglePlant(Plant):
    """Physics of the approach-angle rig, and the history of its sensors' inputs.

    Time goes in steps of 1/19200 s from the first call of :meth:`advance`; how it is divided into
    calls changes nothing, bit for bit. While everything rests and the relay is open, waiting costs
    next to nothing. The relay is commanded by :meth:`command`.

    The wheel has been turned, and the platform pushed, back to the start when the plant is made;
    every ``change("platform", "start")`` begins a new run, with a scatter of its own.

    Raises:
        ConfigError: the parameter file cannot be read or is not physical.

    """

    Config: ClassVar[type[PlantConfig]] = AngleConfig
    title: ClassVar[str] = "approach-angle rig: relay, motor, wheel and platform"
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

        from rigd_sim.approach_angle import draws, kernel, records

        #: Those of the file that ``config`` names, if they are not given.
        self.parameters: AngleParameters = parameters or config.read_parameters()
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
        #: Steps taken.
        self.steps = 0

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

    def evolve(self, t_ns: int, elapsed_ns: int) -> None:
        """Take the steps up to ``t_ns``; see :class:`rigd.sdk.Plant`."""
        last = t_ns * layout.STEPS_PER_S // 1_000_000_000
        if last > self.steps:
            self._step_to(last)

    def _step_to(self, last: int) -> None:
        self._kernel.advance(
            self._constants, self._state, self.history, self._scale, self.seed,
            self.steps, last, 1.0 / layout.STEPS_PER_S,
        )  # fmt: skip
        self.steps = last

    def begin_trial(self, seed: int) -> None:
        """Draw load, scatter and noise from ``seed`` from now on, counted anew."""
        super().begin_trial(seed)
        self._loads = self._runs = 0

    def command(self, closed: bool) -> None:
        """Command the relay to close or to open, from now on.

        Raises:
            ValueError: it is to close, and the friction of what is set up is not known.

        """
        if closed:
            self._limit_known()
        state = self._state[0]
        if closed == (state["command"] > 0.5):
            return
        state["command"] = float(closed)
        state["command_at"] = (self.now_ns - self.origin_ns) * 1e-9
        state["was_closed"] = state["closed"]

    def energy(self) -> Energy:
        """Return where the energy is; it is counted from the first call on."""
        state = self._state[0]
        state["counting"] = 1.0
        stored = self._kernel.stored(self._constants, self._state)
        return Energy(stored, float(state["supplied"]), float(state["dissipated"]))

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

    def apply(self, quantity: str, value: float | str) -> None:
        """Do one of ``SETTINGS`` at the bench, from now on.

        ``platform`` at ``start`` begins a new run: pushed back, and the wheel turned back.
        ``rubbing`` and ``fault`` spoil runs.

        Raises:
            ValueError: the bench does not allow it now.

        """
        if isinstance(value, str):
            self._words[quantity](value)
        else:
            self._numbers[quantity](value)
        self._show_first()

    @property
    def _words(self) -> Mapping[str, Callable[[str], None]]:
        return {
            "wheel": self._fit_wheel,
            "platform": self._push_platform,
            "wheel_lift": self._lift_wheel,
            "shaft": self._clamp_shaft,
            "fault": lambda fault: self._set(fault=fault),
        }

    @property
    def _numbers(self) -> Mapping[str, Callable[[float], None]]:
        return {
            "angle": self._set_angle,
            "load": self._set_load,
            "voltage": lambda voltage: self._set(voltage=voltage),
            "platform_at": self._bring_platform,
            "push": self._push,
            "arm_mass": self._load_arm,
            "scale_weight": lambda mass: self._set(known_mass=mass),
            "rubbing": lambda torque: self._set(rubbing=torque),
        }

    # What people do at the bench.

    def _set_angle(self, angle: float) -> None:
        self._angle = float(round(math.degrees(angle)))
        self._surface()

    def _fit_wheel(self, wheel: str) -> None:
        self._wheel = wheel
        self._surface()

    def _surface(self) -> None:
        limit = self.parameters.limits.of(self._angle, self._wheel)
        self._set(angle=math.radians(self._angle), limit=math.nan if limit is None else limit)
        self._touch_anew()

    def _set_load(self, mass: float) -> None:
        scatter = (
            self._draws.load_scatter(self.parameters, self.seed, self._loads) if self.noise else 1.0
        )
        self._loads += 1
        self._set(load_n=mass * self.parameters.gravity * scatter)

    def _push_platform(self, place: str) -> None:
        if place == "end":
            self._bring_platform(float(self._constants["stop"][0]))
            return
        self._check_can_be_pushed()
        self._limit_known()
        self._begin_run()

    def _check_can_be_pushed(self) -> None:
        if self._state["command"][0] > 0.5:
            raise ValueError("the relay is closed: the platform cannot be pushed now")
        if self._bench.clamped:
            raise ValueError("the shaft is clamped: the wheel cannot turn along; free it first")

    def _bring_platform(self, travel_m: float) -> None:
        """Bring the platform to rest there; the wheel, and the motor with it, rolls along."""
        self._check_can_be_pushed()
        state, c = self._state, self._constants
        if not self._bench.lifted:
            turned = (travel_m - state["x"]) * c["cosine"] / c["effective_radius"]
            state["wheel"] += turned
            state["rotor"] += turned
        state["x"] = travel_m
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

    def _push(self, speed: float) -> None:
        self._state["v"] = speed
        self._state["awake"] = 1.0

    def _lift_wheel(self, place: str) -> None:
        self._set(lifted=place == "lifted")
        self._touch_anew()

    def _clamp_shaft(self, state: str) -> None:
        clamped = state == "clamped"
        if clamped:
            for name in ("rotor_speed", "w"):
                self._state[name] = 0.0
        self._set(clamped=clamped, arm_mass=self._bench.arm_mass if clamped else 0.0)

    def _load_arm(self, mass: float) -> None:
        if mass > 0.0 and not self._bench.clamped:
            raise ValueError("the arm holds no weight on a free shaft; clamp the shaft first")
        self._set(arm_mass=mass)

    # What follows from it.

    def _set(self, **changed: Any) -> None:
        self._bench = replace(self._bench, **changed)
        self._constants = self._records.constants(
            self.parameters, self.individual, self._run, self._bench,
            noise=self.noise, drag=self.config.drag,
        )  # fmt: skip

    def _touch_anew(self) -> None:
        """Lay the wheel on the surface: bristles straight, breakaway surplus there."""
        self._kernel.touch(self._constants, self._state)

    def _show_first(self) -> None:
        """Let the sensors see what is set up before the first step."""
        if not self.begun:
            self._kernel.show_now(self._constants, self._state, self.history[0])

    def _limit_known(self) -> None:
        if math.isnan(self._bench.limit) and self._bench.fault != "no_sliding":
            raise ValueError(
                f"no friction is published for the {self._wheel} wheel at {self._angle:g} deg; "
                f"known are {', '.join(layout.SETS)}"
            )
