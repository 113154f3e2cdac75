"""What the systems of all robots have in common: torques of the motors, then poses of the modules.

A system adds its simulation, its parameters and what they do to the torques.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from rigd.analysis.fitting.model import FitParameter, Scaling
from rigd.analysis.output_error.innovations import Deviations
from rigd.analysis.output_error.system import Output, Unknown
from rigd.analysis.result import FloatArray
from rigd_analyses.articulated.kernel import W0
from rigd_analyses.articulated.reading import TORQUE_FRAMES, RobotTrial, noise_of_seen

CAMERA: Final = ("scale_x", "scale_y", "latency")
#: Times the noise: what a frame counts for whose torque is none. Most are so, and few count.
NO_TORQUE: Final = 1e8
#: Share of the rotors' inertia by which what is missed of a torque may differ within a trial: that
#: of a step differs from that of a ramp by 0.13.
MISSED: Final = 0.15
TURNING: Final = 2.0  #: times W0 from which a wheel turns: its rolling resistance is then all there
LEAST_NOISE: Final = {"N m": 1e-7, "m": 1e-6, "rad": 1e-6}  #: no sensor is better


@dataclass(frozen=True, eq=False)
class RecordedRobot(ABC):
    """The trials, and ``constants``: values with standard uncertainties, in SI, by name."""

    trials: tuple[RobotTrial, ...]
    constants: Mapping[str, tuple[float, float]]

    @property
    @abstractmethod
    def shared(self) -> tuple[Unknown, ...]:
        """Return contacts, constants and camera."""

    @property
    @abstractmethod
    def local(self) -> tuple[Unknown, ...]:
        """Return by how much each trial begins off where its first frames show the robot."""

    @property
    @abstractmethod
    def outputs(self) -> tuple[Output, ...]:
        """Return torques and poses."""

    @abstractmethod
    def simulate(self, trial: int, shared: FloatArray, local: FloatArray) -> FloatArray:
        """Return the outputs of one trial, (n, motors + 3 modules)."""

    @property
    @abstractmethod
    def ratios(self) -> FloatArray:
        """Return the gear ratio of each motor, (motors,)."""

    @property
    def motors(self) -> int:
        """Return how many motors there are: the first outputs are their torques."""
        return len(self.ratios)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Return the names of :attr:`shared`."""
        return tuple(item.parameter.name for item in self.shared)

    @cached_property
    def measured(self) -> tuple[FloatArray, ...]:
        """Return the measured outputs of each trial, (n, motors + 3 modules)."""
        return tuple(np.column_stack([item.torques, item.poses]) for item in self.trials)

    def of(self, trials: Sequence[int]) -> Self:
        """Return the system of some of the trials."""
        return replace(self, trials=tuple(self.trials[k] for k in trials))

    def begin(self, hinges: Sequence[str]) -> tuple[Unknown, ...]:
        """Return :attr:`local` of a robot with ``hinges``: place, heading, their angles, rotors."""
        units = {"x": "m", "y": "m", "heading": "rad", **dict.fromkeys(hinges, "rad")}
        placed = tuple(
            Unknown(FitParameter(name, unit, -0.3, 0.3, 0.0, Scaling.LINEAR))
            for name, unit in units.items()
        )
        # Torque is sampled between setpoints, when part of what a ramp asks for has passed.
        stated = self.constants["rotor_inertia"][0]
        at = FitParameter(
            "rotor_inertia", "kg m^2", -9 * stated, 11 * stated, stated, Scaling.LINEAR
        )
        return (*placed, Unknown(at))

    def turn(self, trial: int, local: FloatArray) -> float:
        """Return the heading in rad at the begin of one trial, in the frame of the camera."""
        return float(self.trials[trial].standing[2] + local[2])

    def stretch(self, shared: FloatArray) -> tuple[float, float]:
        """Return both scales of the camera."""
        x, y = (1.0 + float(shared[self.names.index(name)]) for name in CAMERA[:2])
        return x, y

    def seen(
        self, trial: int, changes: FloatArray, shared: FloatArray, local: FloatArray
    ) -> FloatArray:
        """Return the outputs (n, motors + 3 modules, c) of changes of the simulated poses."""
        m = self.motors
        out = np.zeros((len(changes), m + changes.shape[1], changes.shape[2]))
        out[:, m:] = turned(changes, self.turn(trial, local), self.stretch(shared))
        return out

    def shown(
        self, trial: int, pose: FloatArray, shared: FloatArray, local: FloatArray
    ) -> FloatArray:
        """Return the poses (n, 3 modules) that the camera shows of simulated ones."""
        turn, standing = self.turn(trial, local), self.trials[trial].standing
        out = turned(pose[:, :, None], turn, self.stretch(shared))[:, :, 0]
        out[:, 0::3] += standing[0] + local[0]
        out[:, 1::3] += standing[1] + local[1]
        out[:, 2::3] += turn
        return out

    def linearise_camera(
        self, trial: int, pose: FloatArray, rate: FloatArray, shared: FloatArray,
        local: FloatArray, out: FloatArray,
    ) -> None:  # fmt: skip
        """Set in ``out`` the derivatives of the poses to camera, place and heading of the begin.

        ``pose`` and ``rate`` (n, 3 modules) are those of the simulation.
        """
        m, first = self.motors, len(shared)
        turn, stretch = self.turn(trial, local), self.stretch(shared)
        rates = turned(rate[:, :, None], turn, stretch)[:, :, 0]
        out[:, m:, self.names.index("latency")] = -rates
        placed = turned(pose[:, :, None], turn, stretch)[:, :, 0]
        scales = [self.names.index(name) for name in CAMERA[:2]]
        for k in range(m, out.shape[1], 3):
            x, y = placed[:, k - m], placed[:, k - m + 1]
            out[:, k, scales[0]], out[:, k + 1, scales[1]] = x / stretch[0], y / stretch[1]
            out[:, k, first] = out[:, k + 1, first + 1] = out[:, k + 2, first + 2] = 1.0
            out[:, k, first + 2] = -y * stretch[0] / stretch[1]
            out[:, k + 1, first + 2] = x * stretch[1] / stretch[0]

    def gained(self, trial: int) -> FloatArray:
        """Return the mean accelerations (n, motors) of the wheels over TORQUE_FRAMES."""
        item = self.trials[trial]
        return means(item.speeds[item.at] / self.ratios, TORQUE_FRAMES * item.period_s)

    def torque_counts(self, trial: int) -> NDArray[np.bool_]:
        """Return at which frames (n,) of one trial a torque counts.

        Its mean shares no sample with another, and the wheels turn all the while: the torque of one
        that stands may be any up to its rolling resistance.
        """
        item = self.trials[trial]
        turns = np.all(np.abs(item.speeds) > TURNING * W0 * self.ratios, axis=1)
        stood = np.append(0, np.cumsum(~turns))[item.at]
        counts = item.torque_seen
        counts[TORQUE_FRAMES:] &= stood[TORQUE_FRAMES:] == stood[:-TORQUE_FRAMES]
        return counts

    def course(
        self, trial: int, turning: FloatArray, moved: FloatArray, module: int, apart: FloatArray,
        driving: FloatArray,
    ) -> Deviations:  # fmt: skip
        """Return how noise of the motor speeds and of the sensors moves the outputs of one trial.

        Noise of the wheels' speeds turns the robot a little off its course, and what follows turns
        about where it is then: three states, heading and place. It also moves it along. Both act in
        turn, each on every other frame, with twice the variance.

        Args:
            trial: place of the trial.
            turning: by how much it turns a module, in rad.
            moved: by how much it moves it along, in m.
            module: the module that drives.
            apart: place (n, 2 modules) in m of each marker from the centre of all.
            driving: variance (motors,) of what one motor would do alone, in its torque.
        """
        item, m = self.trials[trial], self.motors
        count = len(item.poses)
        forward = np.tile(np.eye(3), (count, 1, 1))
        centre = np.stack([item.poses[:, 0::3].mean(axis=1), item.poses[:, 1::3].mean(axis=1)], 1)
        way = np.diff(centre, axis=0, append=centre[-1:])
        forward[:, 1, 0], forward[:, 2, 0] = -way[:, 1], way[:, 0]
        driven = np.zeros((count, 3))
        driven[::2, 0] = turning
        heading = item.poses[1::2, 3 * module + 2]
        driven[1::2, 1:] = moved * np.column_stack([np.cos(heading), np.sin(heading)])
        seen = np.zeros((count, len(self.outputs), 3))
        for k in range(apart.shape[1] // 2):
            at = m + 3 * k
            seen[:, at + 2, 0] = seen[:, at, 1] = seen[:, at + 1, 2] = 1.0
            # A turn moves all markers.
            seen[:, at, 0], seen[:, at + 1, 0] = -apart[:, 2 * k + 1], apart[:, 2 * k]
        variance = np.tile(self._noise**2, (count, 1))
        missed = MISSED * self.constants["rotor_inertia"][0] * self.ratios * self.gained(trial)
        variance[:, :m] += missed**2
        variance[:, :m] += driving
        variance[:, :m] *= np.where(self.torque_counts(trial), 1.0, NO_TORQUE**2)[:, None]
        variance[:, m:][~item.seen] = np.inf
        return Deviations(forward, driven, seen, variance, np.zeros(3), np.eye(len(self.outputs)))

    @cached_property
    def _noise(self) -> FloatArray:
        """Return the standard deviations of the outputs' noise, which they show themselves."""
        torque = float(np.median([item.torque_noise for item in self.trials]))
        poses = [
            noise_of_seen(
                [item.poses[:, k] for item in self.trials],
                [item.seen[:, k] for item in self.trials],
            )
            for k in range(len(self.outputs) - self.motors)
        ]
        least = [LEAST_NOISE[item.unit] for item in self.outputs]
        return np.asarray(np.maximum([*[torque] * self.motors, *poses], least))


def means(integrals: FloatArray, span_s: float) -> FloatArray:
    """Return the means over TORQUE_FRAMES before each frame of what ``integrals`` (n, ...) are of.

    The first ones, which have no such frames, are 0.
    """
    out = np.zeros_like(integrals)
    out[TORQUE_FRAMES:] = (integrals[TORQUE_FRAMES:] - integrals[:-TORQUE_FRAMES]) / span_s
    return out


def turned(poses: FloatArray, turn: float, stretch: tuple[float, float]) -> FloatArray:
    """Return changes of poses (n, 3 modules, c) as the camera sees them."""
    c, s = math.cos(turn), math.sin(turn)
    x, y, out = poses[:, 0::3], poses[:, 1::3], poses.copy()
    out[:, 0::3] = stretch[0] * (c * x - s * y)
    out[:, 1::3] = stretch[1] * (s * x + c * y)
    return out


def finer(
    grid: FloatArray, at: NDArray[np.int64], longest_s: float
) -> tuple[FloatArray, NDArray[np.int64]]:
    """Return ``grid`` (n,) in s without steps above ``longest_s``, and where ``at`` is in it."""
    each = np.ceil(np.diff(grid) / longest_s - 1e-6).astype(np.int64)
    if np.all(each <= 1):
        return grid, at
    first = np.append(0, np.cumsum(each))
    return np.interp(np.arange(first[-1] + 1), first, grid), first[at]
