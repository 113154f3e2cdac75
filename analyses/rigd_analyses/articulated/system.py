"""The robot's trials as a system of the output-error estimator: motor speeds in; all else out."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import interp1d

from rigd.analysis.fitting.model import FitParameter, Scaling
from rigd.analysis.output_error.innovations import Deviations
from rigd.analysis.output_error.system import Output, Unknown
from rigd.analysis.result import FloatArray
from rigd_analyses.articulated.kernel import DISTURBED, LANES, NAMES, W0, simulate
from rigd_analyses.articulated.needs import POSES, TORQUES
from rigd_analyses.articulated.reading import LATEST_S, TORQUE_FRAMES, RobotTrial, noise_of_seen

RATIO: Final = "mu_s / mu_d"  #: is fitted in place of mu_s, at 1 or above
CONTACTS: Final = ("k_lon", "k_lat", "k_roll", "mu_d", RATIO)
#: Constants that the simulation takes; then shared parameters outside of it.
CONSTANTS: Final = tuple(name for name in NAMES[3:] if name not in ("hinge", "mu_s", "mu_d"))
CAMERA: Final = ("scale_x", "scale_y", "latency")
SHARED: Final = (*CONTACTS, *CONSTANTS, *CAMERA)
LOCAL: Final = ("x", "y", "heading", "hinge", "rotor_inertia")
INERTIA: Final = LOCAL.index("rotor_inertia")
LEAST_U: Final = 1e-5  #: relative: no constant is known better than this
FAR: Final = 4.0  #: a constant may move by this factor
#: Times the noise: what a frame counts for whose torque is none. Most are so, and few count.
NO_TORQUE: Final = 1e8
#: Share of the rotors' inertia by which what is missed of a torque may differ within a trial: that
#: of a step differs from that of a ramp by 0.13.
MISSED: Final = 0.15
TURNING: Final = 2.0  #: times W0 from which a wheel turns: its rolling resistance is then all there
FLOOR: Final = np.array([1e-7, 1e-7, *[1e-6] * 6])  #: N m, m and rad; no sensor is better
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
class RobotSystem:
    """The trials; a :class:`rigd.analysis.output_error.system.System`.

    ``constants`` are values with standard uncertainties, in SI, by name. With a ``width`` contacts
    let go over (1 +- width) mu_s times their load, not at once: without derivatives. Contacts that
    are ``known`` have a value and a relative standard uncertainty, as constants do.
    """

    trials: tuple[RobotTrial, ...]
    constants: Mapping[str, tuple[float, float]]
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
        units = ("m", "m", "rad", "rad")
        placed = tuple(
            Unknown(FitParameter(name, unit, -0.3, 0.3, 0.0, Scaling.LINEAR))
            for name, unit in zip(LOCAL[:INERTIA], units, strict=True)
        )
        # Torque is sampled between setpoints, when part of what a ramp asks for has passed.
        stated = self.constants["rotor_inertia"][0]
        at = FitParameter(
            "rotor_inertia", "kg m^2", -9 * stated, 11 * stated, stated, Scaling.LINEAR
        )
        return (*placed, Unknown(at))

    @property
    def outputs(self) -> tuple[Output, ...]:
        """Return torques and poses."""
        named = {name: "N m" for name in TORQUES}
        named |= {name: "rad" if name.endswith("heading") else "m" for name in POSES}
        return tuple(Output(name.replace("_", " "), unit) for name, unit in named.items())

    @cached_property
    def measured(self) -> tuple[FloatArray, ...]:
        """Return the measured outputs of each trial, (n, 8)."""
        return tuple(np.column_stack([item.torques, item.poses]) for item in self.trials)

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
        gained = self._gained(trial) / self.gear_ratio
        out[:, :2, SHARED.index("wheel_inertia")] += 2.0 * gained
        placed, turn, stretch = self._placed(trial, run, shared, local)
        rates = self._turned(run.rate[:, :, None], turn, stretch)[:, :, 0]
        out[:, 2:, SHARED.index("latency")] = -rates
        first = len(SHARED)
        for j, column in enumerate((2, 3)):
            scale = SHARED.index(CAMERA[j])
            for k in (0, 3):
                out[:, column + k, scale] = placed[:, j + k] / stretch[j]
                out[:, column + k, first + j] = 1.0
        for k in (0, 3):
            out[:, 2 + k, first + 2] = -placed[:, 1 + k] * stretch[0] / stretch[1]
            out[:, 3 + k, first + 2] = placed[:, k] * stretch[1] / stretch[0]
            out[:, 4 + k, first + 2] = 1.0
        out[:, :, first + 3] = lanes[:, :, NAMES.index("hinge")]
        out[:, :2, first + INERTIA] = self.gear_ratio * self._gained(trial)
        return outputs, out

    def of(self, trials: Sequence[int]) -> RobotSystem:
        """Return the system of some of the trials."""
        return replace(self, trials=tuple(self.trials[k] for k in trials))

    def share(self, trial: int, shared: FloatArray) -> float:
        """Return the largest force of a contact of one trial, without sliding, over its load."""
        run = self.run(trial, shared, np.zeros(len(LOCAL)))
        return float(np.max(run.share))

    def torque_counts(self, trial: int) -> NDArray[np.bool_]:
        """Return at which frames (n,) of one trial a torque counts.

        Its mean shares no sample with another, and the wheels turn all the while: the torque of one
        that stands may be any up to its rolling resistance.
        """
        item = self.trials[trial]
        turns = np.min(np.abs(item.speeds), axis=1) > TURNING * W0 * self.gear_ratio
        stood = np.append(0, np.cumsum(~turns))[item.at]
        counts = item.torque_seen
        counts[TORQUE_FRAMES:] &= stood[TORQUE_FRAMES:] == stood[:-TORQUE_FRAMES]
        return counts

    def deviations(self, trial: int, shared: FloatArray, local: FloatArray) -> Deviations:
        """Return how noise of the motor speeds and of the sensors moves the outputs of one trial.

        Noise of the wheels' speeds turns the robot a little off its course, and what follows turns
        about where it is then: three states, heading and place. It also moves it along. Both act in
        turn, each on every other frame, with twice the variance.
        """
        item = self.trials[trial]
        count = len(item.poses)
        found = dict(zip(SHARED, shared, strict=True))
        wheel = item.speed_noise / self.gear_ratio
        forward = np.tile(np.eye(3), (count, 1, 1))
        centre = 0.5 * (item.poses[:, :2] + item.poses[:, 3:5])
        way = np.diff(centre, axis=0, append=centre[-1:])
        forward[:, 1, 0], forward[:, 2, 0] = -way[:, 1], way[:, 0]
        driven = np.zeros((count, 3))
        moved = found["wheel_radius"] * wheel * item.period_s
        driven[::2, 0] = moved / found["half_track"]
        heading = item.poses[1::2, 2]
        driven[1::2, 1:] = moved * np.column_stack([np.cos(heading), np.sin(heading)])
        seen = np.zeros((count, 8, 3))
        seen[:, 4, 0] = seen[:, 7, 0] = 1.0
        seen[:, 2, 1] = seen[:, 5, 1] = seen[:, 3, 2] = seen[:, 6, 2] = 1.0
        apart = 0.5 * (item.poses[:, :2] - item.poses[:, 3:5])  # a turn moves both markers
        seen[:, 2, 0], seen[:, 5, 0] = -apart[:, 1], apart[:, 1]
        seen[:, 3, 0], seen[:, 6, 0] = apart[:, 0], -apart[:, 0]
        variance = np.tile(self._noise**2, (count, 1))
        missed = MISSED * self.constants["rotor_inertia"][0] * self.gear_ratio * self._gained(trial)
        variance[:, :2] += missed**2
        variance[:, :2] *= np.where(self.torque_counts(trial), 1.0, NO_TORQUE**2)[:, None]
        variance[:, 2:][~item.seen] = np.inf
        return Deviations(forward, driven, seen, variance, np.zeros(3), np.eye(8))

    @cached_property
    def _noise(self) -> FloatArray:
        """Return the standard deviations (8,) of the outputs' noise, which they show themselves."""
        torque = float(np.median([item.torque_noise for item in self.trials]))
        poses = [
            noise_of_seen(
                [item.poses[:, k] for item in self.trials],
                [item.seen[:, k] for item in self.trials],
            )
            for k in range(6)
        ]
        return np.asarray(np.maximum(np.array([torque, torque, *poses]), FLOOR))

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

    def seen(
        self, trial: int, changes: FloatArray, shared: FloatArray, local: FloatArray
    ) -> FloatArray:
        """Return the outputs (n, 8, c) of changes (n, 6, c) of the simulated poses."""
        stretch = self._stretch(shared)
        out = np.zeros((len(changes), 8, changes.shape[2]))
        out[:, 2:] = self._turned(changes, self.turn(trial, local), stretch)
        return out

    def turn(self, trial: int, local: FloatArray) -> float:
        """Return the heading in rad at the begin of one trial, in the frame of the camera."""
        return float(self.trials[trial].standing[2] + local[LOCAL.index("heading")])

    def _outputs(self, trial: int, run: Run, shared: FloatArray, local: FloatArray) -> FloatArray:
        """Return the outputs (n, 8) of a simulation."""
        found = dict(zip(SHARED, shared, strict=True))
        inertia = 2.0 * found["wheel_inertia"] + self.gear_ratio**2 * local[INERTIA]
        torques = self.mean_torque(trial, run.torque) + inertia * self._gained(trial)
        placed, _, _ = self._placed(trial, run, shared, local)
        standing = self.trials[trial].standing
        placed[:, [0, 3]] += standing[0] + local[0]
        placed[:, [1, 4]] += standing[1] + local[1]
        return np.column_stack([torques / self.gear_ratio, placed])

    def mean_torque(self, trial: int, integrals: FloatArray) -> FloatArray:
        """Return the means over TORQUE_FRAMES before each frame of what ``integrals`` are of."""
        out = np.zeros_like(integrals)
        means = integrals[TORQUE_FRAMES:] - integrals[:-TORQUE_FRAMES]
        out[TORQUE_FRAMES:] = means / (TORQUE_FRAMES * self.trials[trial].period_s)
        return out

    def _gained(self, trial: int) -> FloatArray:
        """Return the mean accelerations (n, 2) of the wheels over TORQUE_FRAMES."""
        item = self.trials[trial]
        return self.mean_torque(trial, item.speeds[item.at] / self.gear_ratio)

    def _placed(
        self, trial: int, run: Run, shared: FloatArray, local: FloatArray
    ) -> tuple[FloatArray, float, tuple[float, float]]:
        """Return the poses (n, 6) from the start, the heading there, and both scales."""
        turn, stretch = self.turn(trial, local), self._stretch(shared)
        placed = self._turned(run.pose[:, :, None], turn, stretch)[:, :, 0]
        placed[:, [2, 5]] += turn
        return placed, turn, stretch

    @staticmethod
    def _stretch(shared: FloatArray) -> tuple[float, float]:
        """Return both scales of the camera."""
        x, y = (1.0 + float(shared[SHARED.index(name)]) for name in ("scale_x", "scale_y"))
        return x, y

    @staticmethod
    def _turned(poses: FloatArray, turn: float, stretch: tuple[float, float]) -> FloatArray:
        """Return changes of poses (n, 6, c) as the camera sees them."""
        c, s = math.cos(turn), math.sin(turn)
        out = poses.copy()
        for k in (0, 3):
            out[:, k] = stretch[0] * (c * poses[:, k] - s * poses[:, k + 1])
            out[:, k + 1] = stretch[1] * (s * poses[:, k] + c * poses[:, k + 1])
        return out


def fastest(found: Mapping[str, float]) -> float:
    """Return the rate in 1/s of the fastest motion that contacts which grip give a module."""
    mass = found["body_mass"] + 4.0 * found["wheel_mass"]
    b, d = found["half_track"], found["half_wheelbase"]
    inertia = found["body_inertia"] + 4.0 * found["wheel_mass"] * (b * b + d * d)
    turning = (found["k_lon"] * b * b + found["k_lat"] * d * d) / inertia
    return 4.0 * max(found["k_lon"] / mass, found["k_lat"] / mass, turning)


def finer(
    grid: FloatArray, at: NDArray[np.int64], longest_s: float
) -> tuple[FloatArray, NDArray[np.int64]]:
    """Return ``grid`` (n,) in s without steps above ``longest_s``, and where ``at`` is in it."""
    each = np.ceil(np.diff(grid) / longest_s - 1e-6).astype(np.int64)
    if np.all(each <= 1):
        return grid, at
    first = np.append(0, np.cumsum(each))
    return np.interp(np.arange(first[-1] + 1), first, grid), first[at]
