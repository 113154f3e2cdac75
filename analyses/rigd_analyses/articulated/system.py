"""The robot's trials as a system of the output-error estimator: motor speeds in; all else out."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from rigd.analysis.innovations import Deviations
from rigd.analysis.model import FitParameter, Scaling
from rigd.analysis.result import FloatArray
from rigd.analysis.system import Output, Unknown
from rigd_analyses.articulated.analysis import POSES, TORQUES
from rigd_analyses.articulated.kernel import NAMES, POSE, RATE, SHARE, TORQUE, simulate
from rigd_analyses.articulated.reading import LATEST_S, TORQUE_FRAMES, RobotTrial, white_noise

CONTACTS: Final = ("k_lon", "k_lat", "k_roll")
HINGE: Final = NAMES.index("hinge")
#: Shared parameters that the simulation takes, in the order of NAMES; then those outside of it.
SIMULATED: Final = tuple(name for name in NAMES if name != "hinge")
CAMERA: Final = ("scale_x", "scale_y", "latency")
SHARED: Final = (*SIMULATED, "rotor_inertia", *CAMERA)
LOCAL: Final = ("x", "y", "heading", "hinge")
LEAST_U: Final = 1e-5  #: relative: no constant is known better than this
FAR: Final = 4.0  #: a constant may move by this factor
TINY: Final = 1e-30  #: imaginary step: no difference is taken, so that nothing is lost
UNSEEN: Final = 1e8  #: times the noise: what a frame without a marker counts for
FLOOR: Final = np.array([1e-7, 1e-7, *[1e-6] * 6])  #: N m, m and rad; no sensor is better
UNITS: Final = {
    **{"k_lon": "N s/m", "k_lat": "N s/m", "k_roll": "m", "wheel_radius": "m", "half_track": "m"},
    **{"half_wheelbase": "m", "hinge_distance": "m", "body_mass": "kg", "wheel_mass": "kg"},
    **{"body_inertia": "kg m^2", "wheel_inertia": "kg m^2", "rotor_inertia": "kg m^2"},
    **{"gravity": "m/s^2", "scale_x": "1", "scale_y": "1", "latency": "s"},
}
#: low, high and first value of what is fitted freely; the step of the simulation is stable there.
FREE: Final = {
    "k_lon": (5.0, 1000.0, 80.0), "k_lat": (5.0, 500.0, 120.0), "k_roll": (1e-5, 1e-2, 1e-3),
    "scale_x": (-0.2, 0.2, 0.0), "scale_y": (-0.2, 0.2, 0.0),
    "latency": (-LATEST_S, LATEST_S, 0.01),
}  # fmt: skip

Array = NDArray[Any]


@dataclass(frozen=True, eq=False)
class RobotSystem:
    """The trials; a :class:`rigd.analysis.system.System`.

    ``constants`` are values with standard uncertainties, in SI, by name.
    """

    trials: tuple[RobotTrial, ...]
    constants: Mapping[str, tuple[float, float]]
    gear_ratio: float

    @property
    def shared(self) -> tuple[Unknown, ...]:
        """Return contacts, constants and camera, in the order of SHARED."""
        return tuple(self._unknown(name) for name in SHARED)

    @property
    def local(self) -> tuple[Unknown, ...]:
        """Return by how much each trial begins off where its first frames show the robot."""
        units = ("m", "m", "rad", "rad")
        return tuple(
            Unknown(FitParameter(name, unit, -0.3, 0.3, 0.0, Scaling.LINEAR))
            for name, unit in zip(LOCAL, units, strict=True)
        )

    @property
    def outputs(self) -> tuple[Output, ...]:
        """Return torques and poses."""
        named = {name: "N m" for name in TORQUES}
        named |= {name: "rad" if name.endswith("heading") else "m" for name in POSES}
        return tuple(Output(name.replace("_", " "), unit) for name, unit in named.items())

    @property
    def measured(self) -> tuple[FloatArray, ...]:
        """Return the measured outputs of each trial, (n, 8)."""
        return tuple(np.column_stack([item.torques, item.poses]) for item in self.trials)

    def simulate(self, trial: int, shared: FloatArray, local: FloatArray) -> FloatArray:
        """Return the outputs (n, 8) of one trial."""
        rows = self._rows(trial, shared, local)
        return np.asarray(self._outputs(trial, rows, shared, local).real)

    def linearise(
        self, trial: int, shared: FloatArray, local: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the outputs (n, 8) and their derivatives to all parameters (n, 8, p + l)."""
        rows = self._rows(trial, shared, local)
        outputs = self._outputs(trial, rows, shared, local)
        out = np.zeros((*outputs.shape, len(SHARED) + len(LOCAL)))
        for index in range(out.shape[2]):
            both = np.concatenate([shared, local]).astype(np.complex128)
            both[index] += 1j * TINY
            a, b = both[: len(SHARED)], both[len(SHARED) :]
            again = index < len(SIMULATED) or index == len(SHARED) + LOCAL.index("hinge")
            moved = self._rows(trial, a, b) if again else rows
            out[:, :, index] = self._outputs(trial, moved, a, b).imag / TINY
        return outputs, out

    def of(self, trials: Sequence[int]) -> RobotSystem:
        """Return the system of some of the trials."""
        return replace(self, trials=tuple(self.trials[k] for k in trials))

    def share(self, trial: int, shared: FloatArray) -> float:
        """Return the largest contact force of one trial over the load of a wheel."""
        rows = self._rows(trial, shared, np.zeros(len(LOCAL)))
        return float(np.max(rows[:, SHARE].real))

    def deviations(self, trial: int, shared: FloatArray, local: FloatArray) -> Deviations:
        """Return how noise of the motor speeds and of the sensors moves the outputs of one trial.

        Noise of the wheels' speeds turns the robot a little off its course, and what follows turns
        about where it is then: three states, heading and place.
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
        turned = found["wheel_radius"] * wheel * item.period_s / math.sqrt(2.0)
        driven[:, 0] = turned / found["half_track"]
        seen = np.zeros((count, 8, 3))
        seen[:, 4, 0] = seen[:, 7, 0] = 1.0
        seen[:, 2, 1] = seen[:, 5, 1] = seen[:, 3, 2] = seen[:, 6, 2] = 1.0
        variance = np.tile(self._noise() ** 2, (count, 1))
        variance[:, :2] *= np.where(item.torque_seen, 1.0, UNSEEN**2)[:, None]
        variance[:, 2:][~item.seen] *= UNSEEN**2
        return Deviations(forward, driven, seen, variance, np.zeros(3), np.eye(8))

    def _noise(self) -> FloatArray:
        """Return the standard deviations (8,) of the outputs' noise, which they show themselves."""
        torque = float(np.median([item.torque_noise for item in self.trials]))
        poses = [white_noise(*(item.poses[:, k] for item in self.trials)) for k in range(6)]
        return np.asarray(np.maximum(np.array([torque, torque, *poses]), FLOOR))

    def _unknown(self, name: str) -> Unknown:
        if name in FREE:
            scaling = Scaling.LINEAR if name in CAMERA else Scaling.LOG
            return Unknown(FitParameter(name, UNITS[name], *FREE[name], scaling))
        value, u = self.constants[name]
        if name == "rotor_inertia":
            # Torque is sampled between setpoints, when part of what a ramp asks for has passed.
            u = math.inf
        parameter = FitParameter(name, UNITS[name], value / FAR, value * FAR, value)
        return Unknown(parameter, max(u / value, LEAST_U), name.replace("_", " "))

    def _rows(self, trial: int, shared: Array, local: Array) -> Array:
        """Return the rows of the simulation of one trial."""
        item = self.trials[trial]
        standing = item.standing
        found = dict(zip(SHARED, shared, strict=True))
        found["hinge"] = local[LOCAL.index("hinge")] + standing[2] - standing[5]
        parameters = np.array([found[name] for name in NAMES])
        rows: Array = simulate(parameters, item.speeds / self.gear_ratio, item.period_s / item.sub)
        return rows

    def _outputs(self, trial: int, rows: Array, shared: Array, local: Array) -> Array:
        """Return the outputs (n, 8) from the rows of a simulation."""
        item = self.trials[trial]
        found = dict(zip(SHARED, shared, strict=True))
        step, sub, n = item.period_s / item.sub, item.sub, self.gear_ratio
        wheels = item.speeds / n
        inertia = 2.0 * found["wheel_inertia"] + n**2 * found["rotor_inertia"]
        between = 0.5 * (rows[1:, TORQUE] + rows[:-1, TORQUE]).reshape(-1, sub, 2).mean(axis=1)
        total = np.cumsum(np.concatenate([np.zeros((1, 2)), between]), axis=0)
        torques = np.zeros((len(item.poses), 2), np.result_type(rows, shared))
        means = (total[TORQUE_FRAMES:] - total[:-TORQUE_FRAMES]) / TORQUE_FRAMES
        gained = wheels[sub * TORQUE_FRAMES :: sub] - wheels[: -sub * TORQUE_FRAMES : sub]
        torques[TORQUE_FRAMES:] = means + inertia * gained / (TORQUE_FRAMES * item.period_s)
        torques /= n
        at = np.arange(0, len(rows), sub) - found["latency"] / step
        begin = np.clip(np.floor(at.real).astype(int), 0, len(rows) - 2)
        s = np.where(at.real < 0.0, 0.0, at - begin)[:, None]
        p0, p1 = rows[begin, POSE], rows[begin + 1, POSE]
        v0, v1 = step * rows[begin, RATE], step * rows[begin + 1, RATE]
        rest = p1 - p0
        poses = p0 + s * (v0 + s * (3 * rest - 2 * v0 - v1 + s * (v0 + v1 - 2 * rest)))
        standing = item.standing
        turn = standing[2] + local[2]
        c, sin = np.cos(turn), np.sin(turn)
        placed = []
        for j in (0, 3):
            x, y = poses[:, j], poses[:, j + 1]
            # The rear heading is in the frame of the front one at the start.
            placed += [
                standing[0] + local[0] + (1.0 + found["scale_x"]) * (c * x - sin * y),
                standing[1] + local[1] + (1.0 + found["scale_y"]) * (sin * x + c * y),
                poses[:, j + 2] + turn,
            ]
        return np.column_stack([torques, *placed])
