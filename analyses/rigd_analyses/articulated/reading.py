"""Converts recordings of the robot to arrays on the frames of its camera."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rigd.analysis import DataError
from rigd.analysis.parameters import Trials
from rigd.analysis.result import FloatArray
from rigd.analysis.source import RecordedSweep, TrialInfo
from rigd_analyses.articulated.analysis import MOTORS, POSES, TORQUES

STEP_S = 0.004  #: longest step of the simulation: 1e-8 m and 1e-8 of yaw rate off 1 ms on a circle
#: Step for a trial in which contacts may slide: 0.1 mm off 0.5 ms, where 4 ms are 0.3 mm. Speeds
#: are means over 4 ms all the same: noise would move the instants at which contacts change.
FINE_STEP_S = 0.002
EXCHANGED_M = 0.1  #: a marker does not jump so far off its neighbours within a frame
AROUND = 2  #: frames to either side that show where a marker is
LATEST_S = 0.2  #: no frame comes later: those that come earlier in a trial may be of before it
#: Frames that a torque is the mean of. The robot follows its wheels within a frame: noise of the
#: measured speeds, which would pull k_lon down by 1 % at one frame, is out of a longer mean.
TORQUE_FRAMES = 10
FEWEST = 20  #: frames of a trial
REST_FRAMES = 5  #: frames before the start, whose median is where the robot stands
NS = 1e-9


@dataclass(frozen=True, eq=False)
class RobotTrial:
    """A trial on n frames, ``period_s`` apart, and ``sub`` steps of simulation in each.

    ``speeds`` (m, 2) are those of the motors at the steps in rad/s, right and left, made of
    ``samples`` (times in s after the first frame, and values, of each); ``torques`` (n, 2) means in
    N m over TORQUE_FRAMES before a frame; ``poses`` (n, 6) as in POSES, headings unwrapped, and
    ``seen`` (n, 6) which of them the camera has. ``speed_noise`` is the standard deviation in rad/s
    of a mean of the speed between frames, ``torque_noise`` in N m that of a mean of the torque.
    """

    label: str
    recording: str
    number: int
    period_s: float
    sub: int
    speeds: FloatArray
    torques: FloatArray
    poses: FloatArray
    seen: NDArray[np.bool_]
    speed_noise: float
    torque_noise: float
    samples: tuple[tuple[FloatArray, FloatArray], ...]

    @property
    def finer(self) -> RobotTrial:
        """Return the trial with the steps that sliding contacts need."""
        sub = math.ceil(self.period_s / FINE_STEP_S - 1e-6)
        return replace(
            self, sub=sub, speeds=_speeds(self.samples, self.period_s, len(self.poses), sub)
        )

    def first(self, seconds: float) -> RobotTrial:
        """Return the begin of the trial."""
        count = min(len(self.poses), 1 + math.ceil(seconds / self.period_s))
        return replace(
            self, speeds=self.speeds[: (count - 1) * self.sub + 1], torques=self.torques[:count],
            poses=self.poses[:count], seen=self.seen[:count],
        )  # fmt: skip

    @property
    def t_s(self) -> FloatArray:
        """Return the times of the frames (n,)."""
        return np.arange(len(self.poses), dtype=np.float64) * self.period_s

    @property
    def torque_seen(self) -> NDArray[np.bool_]:
        """Return at which frames (n,) a torque counts: its mean shares no sample with another."""
        at = np.arange(len(self.poses))
        return np.asarray((at > 0) & (at % TORQUE_FRAMES == 0), dtype=np.bool_)

    @cached_property
    def standing(self) -> FloatArray:
        """Return the poses (6,) at the begin."""
        return np.asarray(np.median(self.poses[:REST_FRAMES], axis=0))


def robot_trials(trials: Trials) -> list[RobotTrial]:
    """Return ``trials`` as arrays.

    Raises:
        DataError: a signal is missing, a sample is not finite, or a trial is too short.
    """
    return [_trial(sweep, info) for sweep, info in trials]


def _trial(sweep: RecordedSweep, info: TrialInfo) -> RobotTrial:
    where = f"{sweep.path}: trial {info.number}"
    read = {name: _signal(sweep, info, name) for name in (*MOTORS, *TORQUES, *POSES)}
    frames = np.unique(np.concatenate([read[name][0] for name in POSES]))
    if len(frames) < FEWEST:
        raise DataError(f"{where} has {len(frames)} frames of the camera, needs {FEWEST}")
    period = float(np.median(np.diff(frames)))
    count = 1 + round(float(frames[-1] - frames[0]) / period)
    times = frames[0] + period * np.arange(count)
    poses, seen = np.zeros((count, 6)), np.zeros((count, 6), dtype=np.bool_)
    for column, name in enumerate(POSES):
        t, values = read[name]
        at = np.rint((t - times[0]) / period).astype(int)
        seen[at, column] = True
        poses[at, column] = values
    for module in (slice(0, 3), slice(3, 6)):
        _clean(poses[:, module], seen[:, module], times)
    sub = math.ceil(period / STEP_S - 1e-6)
    samples = tuple((read[name][0] - times[0], read[name][1]) for name in MOTORS)
    speeds = _speeds(samples, period, count, sub)
    torques = np.stack(
        [_mean(*read[name], times - TORQUE_FRAMES * period, times) for name in TORQUES]
    )
    speed, torque = (
        max(white_noise(read[name][1]) for name in names) for names in (MOTORS, TORQUES)
    )
    per_frame = max(1.0, period / float(np.median(np.diff(read[MOTORS[0]][0]))))
    words = [f"{sweep.parameter(info, name)}" for name in info.parameters]
    return RobotTrial(
        f"{sweep.info.procedure} {info.number} ({', '.join(words)})", str(sweep.path), info.number,
        period, sub, speeds, np.ascontiguousarray(torques.T), poses, seen,
        speed / math.sqrt(per_frame), torque / math.sqrt(TORQUE_FRAMES * per_frame), samples,
    )  # fmt: skip


def _speeds(
    samples: Sequence[tuple[FloatArray, FloatArray]], period_s: float, count: int, sub: int
) -> FloatArray:
    """Return the means (n, 2) of both speeds around the steps of ``count`` frames."""
    nodes: FloatArray = period_s / sub * np.arange((count - 1) * sub + 1, dtype=np.float64)
    half = 0.5 * max(period_s / sub, STEP_S)
    means = [_mean(t, values, nodes - half, nodes + half) for t, values in samples]
    return np.ascontiguousarray(np.stack(means, axis=1))


def _signal(sweep: RecordedSweep, info: TrialInfo, name: str) -> tuple[FloatArray, FloatArray]:
    """Return times in s and values of a signal, as recorded.

    Raises:
        DataError: it is not there, has no sample, or one that is not finite.
    """
    stream, field = sweep.field(name)
    rows = sweep.recording.read(stream.name, info.start_ns, info.end_ns)
    values = np.asarray(rows[field], dtype=np.float64)
    if len(values) < FEWEST or not np.all(np.isfinite(values)):
        raise DataError(
            f"{sweep.path}: in trial {info.number} signal {name!r} has {len(values)} samples, "
            f"{np.count_nonzero(~np.isfinite(values))} of them not finite",
            hint="`rigd report FILE` draws the recording",
        )
    t_s = (rows["t_ns"] - info.start_ns) * NS
    kept = t_s >= (LATEST_S if name in POSES else 0.0)
    return t_s[kept], values[kept]


def _clean(poses: FloatArray, seen: NDArray[np.bool_], times: FloatArray) -> None:
    """Drop frames in which a marker was taken for another; bridge what is missing; unwrap."""
    known = np.flatnonzero(seen[:, 0])
    for axis in (0, 1):
        padded = np.pad(poses[known, axis], AROUND, mode="edge")
        windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * AROUND + 1)
        off = np.abs(poses[known, axis] - np.median(windows, axis=1)) > EXCHANGED_M
        seen[known[off]] = False
    known = np.flatnonzero(seen[:, 0])
    poses[known, 2] = np.unwrap(poses[known, 2])
    for axis in range(3):
        poses[:, axis] = np.interp(times, times[known], poses[known, axis])


def _mean(t: FloatArray, values: FloatArray, begin: FloatArray, end: FloatArray) -> FloatArray:
    """Return the means of a signal from each ``begin`` to each ``end``, both (n,)."""
    areas = 0.5 * (values[1:] + values[:-1]) * np.diff(t)
    lead, t = 1.0, np.concatenate([[t[0] - 1.0], t, [t[-1] + 1.0]])
    total = np.cumsum(np.concatenate([[0.0, lead * values[0]], areas, [values[-1]]]))
    return np.asarray((np.interp(end, t, total) - np.interp(begin, t, total)) / (end - begin))


def white_noise(*parts: FloatArray) -> float:
    """Return the standard deviation of white noise on smooth signals, from second differences."""
    second = np.concatenate([np.diff(part, 2, axis=0).ravel() for part in parts])
    return float(1.4826 * np.median(np.abs(second)) / math.sqrt(6.0))
