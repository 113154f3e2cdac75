"""The robot's trials as a system of the output-error estimator: motor speeds in; all else out."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final

import numpy as np
from scipy.interpolate import interp1d

from rigd.analysis.fitting.model import FitParameter, Scaling
from rigd.analysis.output_error.innovations import Deviations
from rigd.analysis.output_error.system import Output, Unknown
from rigd.analysis.result import FloatArray
from rigd_analyses.articulated.kernel import DISTURBED, LANES, NAMES, simulate
from rigd_analyses.articulated.needs import POSES, TORQUES
from rigd_analyses.articulated.reading import LATEST_S, TORQUE_FRAMES
from rigd_analyses.articulated.robot import CAMERA, RecordedRobot, finer, means

RATIO: Final = "mu_s / mu_d"  #: is fitted in place of mu_s, at 1 or above
CONTACTS: Final = ("k_lon", "k_lat", "k_roll", "mu_d", RATIO)
#: Constants that the simulation takes; then shared parameters outside of it.
CONSTANTS: Final = tuple(name for name in NAMES[3:] if name not in ("hinge", "mu_s", "mu_d"))
SHARED: Final = (*CONTACTS, *CONSTANTS, *CAMERA)
LOCAL: Final = ("x", "y", "heading", "hinge", "rotor_inertia")
INERTIA: Final = LOCAL.index("rotor_inertia")
LEAST_U: Final = 1e-5  #: relative: no constant is known better than this
FAR: Final = 4.0  #: a constant may move by this factor
UNITS: Final = {
    **{"k_lon": "N s/m", "k_lat": "N s/m", "k_roll": "m", "wheel_radius": "m", "half_track": "m"},
    **{"half_wheelbase": "m", "hinge_distance": "m", "body_mass": "kg", "wheel_mass": "kg"},
    **{"body_inertia": "kg m^2", "wheel_inertia": "kg m^2", "mu_d": "1", "mu_s": "1", RATIO: "1"},
    **{"gravity": "m/s^2", "scale_x": "1", "scale_y": "1", "latency": "s"},
}
#: low, high and first value of what is fitted freely; the step of the simulation is stable there.
FREE: Final = {
    "k_lon": (5.0, 1000.0, 80.0), "k_lat": (5.0, 500.0, 120.0), "k_roll": (1e-5, 1e-2, 1e-3),
    "mu_d": (0.05, 5.0, 0.6), RATIO: (1.0, 4.0, 1.5),
    "scale_x": (-0.2, 0.2, 0.0), "scale_y": (-0.2, 0.2, 0.0),
    "latency": (-LATEST_S, LATEST_S, 0.01),
}  # fmt: skip
#: Rate of the fastest motion times a step of the simulation, at most: beyond 2.7 it is unstable.
STABLE: Final = 1.3
UNDISTURBED: Final = np.zeros((0, DISTURBED, LANES))


@dataclass(frozen=True, eq=False)
class Run:
    """What a simulation returns for the frames of a trial, as :func:`.kernel.simulate` has it."""

    pose: FloatArray
    rate: FloatArray
    torque: FloatArray
    by_pose: FloatArray
    by_torque: FloatArray
    forces: FloatArray
    share: FloatArray


@dataclass(frozen=True, eq=False)
class RobotSystem(RecordedRobot):
    """The trials; a :class:`rigd.analysis.output_error.system.System`.

    With a ``width`` contacts let go over (1 +- width) mu_s times their load, not at once: without
    derivatives. Contacts that are ``known`` have a value and a relative standard uncertainty, as
    constants do.
    """

    gear_ratio: float
    width: float = 0.0
    known: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    @cached_property
    def shared(self) -> tuple[Unknown, ...]:
        """Return contacts, constants and camera, in the order of SHARED."""
        return tuple(self._unknown(name) for name in SHARED)

    @cached_property
    def local(self) -> tuple[Unknown, ...]:
        """Return by how much each trial begins off where its first frames show the robot."""
        return self.begin(("hinge",))

    @property
    def ratios(self) -> FloatArray:
        """Return the gear ratio of both motors, (2,)."""
        return np.full(2, self.gear_ratio)

    @property
    def outputs(self) -> tuple[Output, ...]:
        """Return torques and poses."""
        named = {name: "N m" for name in TORQUES}
        named |= {name: "rad" if name.endswith("heading") else "m" for name in POSES}
        return tuple(Output(name.replace("_", " "), unit) for name, unit in named.items())

    def simulate(self, trial: int, shared: FloatArray, local: FloatArray) -> FloatArray:
        """Return the outputs (n, 8) of one trial."""
        return self._outputs(trial, self.run(trial, shared, local), shared, local)

    def linearise(
        self, trial: int, shared: FloatArray, local: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the outputs (n, 8) and their derivatives to all parameters (n, 8, p + l)."""
        run = self.run(trial, shared, local, moving=True)
        outputs = self._outputs(trial, run, shared, local)
        found = dict(zip(SHARED, shared, strict=True))
        lanes = self.outputs_of(trial, run, shared, local)
        out = np.zeros((*outputs.shape, len(SHARED) + len(LOCAL)))
        for index, name in enumerate(SHARED):
            if name in NAMES:
                out[:, :, index] = lanes[:, :, NAMES.index(name)]
        by_static = lanes[:, :, NAMES.index("mu_s")]
        out[:, :, SHARED.index("mu_d")] += found[RATIO] * by_static
        out[:, :, SHARED.index(RATIO)] = found["mu_d"] * by_static
        gained = self.gained(trial)
        out[:, :2, SHARED.index("wheel_inertia")] += 2.0 * (gained / self.gear_ratio)
        self.linearise_camera(trial, run.pose, run.rate, shared, local, out)
        first = len(SHARED)
        out[:, :, first + 3] = lanes[:, :, NAMES.index("hinge")]
        out[:, :2, first + INERTIA] = self.gear_ratio * gained
        return outputs, out

    def share(self, trial: int, shared: FloatArray) -> float:
        """Return the largest force of a contact of one trial, without sliding, over its load."""
        run = self.run(trial, shared, np.zeros(len(LOCAL)))
        return float(np.max(run.share))

    def deviations(self, trial: int, shared: FloatArray, local: FloatArray) -> Deviations:
        """Return how noise of speeds and sensors moves the outputs of one trial."""
        item, found = self.trials[trial], dict(zip(SHARED, shared, strict=True))
        moved = found["wheel_radius"] * (item.speed_noise / self.gear_ratio) * item.period_s
        apart = 0.5 * (item.poses[:, :2] - item.poses[:, 3:5])
        return self.course(
            trial, moved / found["half_track"], moved, 0, np.hstack([apart, -apart]), np.zeros(2)
        )

    def _unknown(self, name: str) -> Unknown:
        if name in FREE:
            low, high, first = FREE[name]
            first, u = self.known.get(name, (first, math.inf))
            scaling = Scaling.LINEAR if name in CAMERA else Scaling.LOG
            return Unknown(FitParameter(name, UNITS[name], low, high, first, scaling), u)
        value, u = self.constants[name]
        parameter = FitParameter(name, UNITS[name], value / FAR, value * FAR, value)
        return Unknown(parameter, max(u / value, LEAST_U), name.replace("_", " "))

    def run(
        self, trial: int, shared: FloatArray, local: FloatArray, *, moving: bool = False,
        disturbed: FloatArray = UNDISTURBED,
    ) -> Run:  # fmt: skip
        """Return the simulation of one trial, ``moving`` with derivatives.

        They are those to the parameters in NAMES or, if given, for each unit of what is
        ``disturbed`` (m, DISTURBED, LANES).
        """
        item = self.trials[trial]
        standing = item.standing
        found = dict(zip(SHARED, shared, strict=True))
        found["hinge"] = local[LOCAL.index("hinge")] + standing[2] - standing[5]
        found["mu_s"] = found["mu_d"] * found[RATIO]
        parameters = np.array([*(found[name] for name in NAMES), self.width])
        by = np.zeros((len(NAMES), LANES))
        if len(disturbed) == 0:
            by[:, : len(NAMES)] = np.eye(len(NAMES))
        grid, at = finer(item.grid, item.at, STABLE / fastest(found))
        columns = [np.interp(grid, item.grid, column) for column in item.speeds.T]
        wheels = np.stack(columns, axis=1) / self.gear_ratio
        if len(disturbed):
            moved = interp1d(item.grid, disturbed, axis=0)(grid)
            disturbed = np.asarray(moved, dtype=np.float64)
        rows = simulate(parameters, by, wheels, grid, at, found["latency"], disturbed, moving)
        return Run(*rows)

    def outputs_of(self, trial: int, run: Run, shared: FloatArray, local: FloatArray) -> FloatArray:
        """Return the derivatives (n, 8, LANES) of the outputs that go along with ``run``."""
        out = self.seen(trial, run.by_pose, shared, local)
        out[:, :2] = self.mean_torque(trial, run.by_torque) / self.gear_ratio
        return out

    def _outputs(self, trial: int, run: Run, shared: FloatArray, local: FloatArray) -> FloatArray:
        """Return the outputs (n, 8) of a simulation."""
        found = dict(zip(SHARED, shared, strict=True))
        inertia = 2.0 * found["wheel_inertia"] + self.gear_ratio**2 * local[INERTIA]
        torques = self.mean_torque(trial, run.torque) + inertia * self.gained(trial)
        poses = self.shown(trial, run.pose, shared, local)
        return np.column_stack([torques / self.gear_ratio, poses])

    def mean_torque(self, trial: int, integrals: FloatArray) -> FloatArray:
        """Return the means over TORQUE_FRAMES before each frame of what ``integrals`` are of."""
        return means(integrals, TORQUE_FRAMES * self.trials[trial].period_s)


def fastest(found: Mapping[str, float]) -> float:
    """Return the rate in 1/s of the fastest motion that contacts which grip give a module."""
    mass = found["body_mass"] + 4.0 * found["wheel_mass"]
    b, d = found["half_track"], found["half_wheelbase"]
    inertia = found["body_inertia"] + 4.0 * found["wheel_mass"] * (b * b + d * d)
    turning = (found["k_lon"] * b * b + found["k_lat"] * d * d) / inertia
    return 4.0 * max(found["k_lon"] / mass, found["k_lat"] / mass, turning)
