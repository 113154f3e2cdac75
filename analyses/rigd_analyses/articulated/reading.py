"""Converts recordings of the robot to arrays on the frames of its camera."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rigd.analysis import DataError
from rigd.analysis.parameters import Trials
from rigd.analysis.recordings.noise import noise_of_differences
from rigd.analysis.recordings.source import (
    STATUS_FIELD,
    RecordedSweep,
    TrialInfo,
    period_ns,
    stale_rows,
)
from rigd.analysis.result import FloatArray
from rigd_analyses.articulated.needs import MODULES, MOTORS, POSES, TORQUES

STEP_S = 0.004  #: longest step of the simulation: 1e-8 m and 1e-8 of yaw rate off 1 ms on a circle
#: Step in a frame in which a speed is not straight: the wheels give way as a contact grips again,
#: and a speed that is smoothed over 4 ms there lets it grip 0.5 ms early: 0.4 mm of way.
FINE_STEP_S = 0.0005
#: A speed is smoothed over as long as it is straight: by the widest mean, up to this half width in
#: s, that agrees with all narrower ones within AGREE of their standard deviations.
WIDEST_S = 0.128
AGREE = 3.0
SURE = 0.01  #: rad/s: no speed of a motor is known better
EDGE_S = 0.002  #: half width below which a speed is taken as not straight
EDGES = 2  #: samples like that in a frame that make it one of FINE_STEP_S
EXCHANGED_M = 0.1  #: a marker does not jump so far off its neighbours within a frame
#: Frames to either side that show where a marker is; at an end the five that are there.
AROUND = 2
LATEST_S = 0.2  #: no frame comes later: those that come earlier in a trial may be of before it
#: Frames that a torque is the mean of. The robot follows its wheels within a frame: noise of the
#: measured speeds, which would pull k_lon down by 1 % at one frame, is out of a longer mean.
TORQUE_FRAMES = 10
FEWEST = 20  #: frames of a trial
REST_FRAMES = 5  #: frames before the start, whose median is where the robot stands
SAME = 1e-9  #: of the largest: smaller differences are of the arithmetic
NS = 1e-9


@dataclass(frozen=True, eq=False)
class RobotTrial:
    """A trial on n frames, ``period_s`` apart, and the steps of its simulation.

    ``speeds`` (m, motors) in rad/s, of two modules right and left, are at the times ``grid`` (m,)
    in s after the first frame; frames are ``at`` (n,) of them. ``torques`` (n, motors) are means in
    N m over TORQUE_FRAMES before a frame; ``poses`` (n, 3 modules) as in POSES, headings unwrapped,
    and ``seen`` which of them the camera has; ``modules`` are their names, from the first.
    ``speed_noise`` is the standard deviation in rad/s of a mean of the speed between frames,
    ``torque_noise`` in N m that of a mean of the torque.
    """

    label: str
    recording: str
    number: int
    period_s: float
    grid: FloatArray
    at: NDArray[np.int64]
    speeds: FloatArray
    torques: FloatArray
    poses: FloatArray
    seen: NDArray[np.bool_]
    speed_noise: float
    torque_noise: float
    modules: tuple[str, ...] = MODULES

    def first(self, seconds: float) -> RobotTrial:
        """Return the begin of the trial."""
        count = min(len(self.poses), 1 + math.ceil(min(seconds, 1e6) / self.period_s))
        end = int(self.at[count - 1]) + 1
        return replace(
            self, grid=self.grid[:end], at=self.at[:count], speeds=self.speeds[:end],
            torques=self.torques[:count], poses=self.poses[:count], seen=self.seen[:count],
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
        """Return the poses (3 modules,) at the begin."""
        return np.asarray(np.median(self.poses[:REST_FRAMES], axis=0))


@dataclass(frozen=True)
class RobotSignals:
    """The names of what is read of a robot, from its first module to the last."""

    motors: tuple[str, ...] = MOTORS
    torques: tuple[str, ...] = TORQUES
    poses: tuple[str, ...] = POSES
    modules: tuple[str, ...] = MODULES


TWO_MODULES: Final = RobotSignals()


def robot_trials(trials: Trials, signals: RobotSignals = TWO_MODULES) -> list[RobotTrial]:
    """Return ``trials`` as arrays.

    Raises:
        DataError: a signal is missing, a sample is not finite, or a trial is too short.
    """
    several = len({sweep.path for sweep, _ in trials}) > 1
    return [
        _trial(sweep, info, signals, f" of {sweep.path}" if several else "")
        for sweep, info in trials
    ]


def _trial(sweep: RecordedSweep, info: TrialInfo, signals: RobotSignals, file: str) -> RobotTrial:
    where = f"{sweep.path}: trial {info.number}"
    names = (*signals.motors, *signals.torques, *signals.poses)
    read = {name: _signal(sweep, info, name, name in signals.poses) for name in names}
    frames = np.unique(np.concatenate([read[name][0] for name in signals.poses]))
    if len(frames) < FEWEST:
        raise DataError(f"{where} has {len(frames)} frames of the camera, needs {FEWEST}")
    period = NS * period_ns(np.rint(frames / NS).astype(np.int64))
    count = 1 + round(float(frames[-1] - frames[0]) / period)
    times = frames[0] + period * np.arange(count)
    width = len(signals.poses)
    poses, seen = np.zeros((count, width)), np.zeros((count, width), dtype=np.bool_)
    for column, name in enumerate(signals.poses):
        t, values = read[name]
        at = np.rint((t - times[0]) / period).astype(int)
        seen[at, column] = True
        poses[at, column] = values
    for first in range(0, width, 3):
        module = slice(first, first + 3)
        clean(poses[:, module], seen[:, module], times)
    for column in range(5, width, 3):
        front, rear = (np.median(poses[:REST_FRAMES, at]) for at in (column - 3, column))
        poses[:, column] += 2.0 * np.pi * np.rint((front - rear) / (2.0 * np.pi))  # unwrapped alone
    grid, at, speeds = steps(
        [(read[name][0] - times[0], read[name][1]) for name in signals.motors], period, count
    )
    torques = np.stack(
        [_mean(*read[name], times - TORQUE_FRAMES * period, times) for name in signals.torques]
    )
    speed, torque = (
        max(_noise_of_mean(*read[name], period, over) for name in names)
        for names, over in ((signals.motors, 1), (signals.torques, TORQUE_FRAMES))
    )
    words = [f"{sweep.parameter(info, name)}" for name in info.parameters]
    return RobotTrial(
        f"{sweep.info.procedure} {info.number} ({', '.join(words)}){file}", str(sweep.path),
        info.number, period, grid, at, speeds, np.ascontiguousarray(torques.T), poses, seen,
        speed, torque, signals.modules,
    )  # fmt: skip


def steps(
    motors: Sequence[tuple[FloatArray, FloatArray]], period_s: float, count: int
) -> tuple[FloatArray, NDArray[np.int64], FloatArray]:
    """Return the steps (m,) in s of ``count`` frames, which of them these are, and the speeds.

    ``motors`` are times in s after the first frame, and values.
    """
    narrow, speeds = np.zeros(count, np.int64), []
    for t, values in motors:
        smooth, half = smoothed(t, values)
        speeds.append((t, smooth))
        edges = np.floor(t[half < EDGE_S] / period_s).astype(np.int64)
        np.add.at(narrow, edges[(edges >= 0) & (edges < count)], 1)
    few, many = (math.ceil(period_s / step - 1e-6) for step in (STEP_S, FINE_STEP_S))
    each = np.where(narrow >= EDGES, many, few)[:-1]
    at = np.append(0, np.cumsum(each))
    frame = np.repeat(np.arange(count - 1), each)
    grid = period_s * np.append(frame + (np.arange(at[-1]) - at[frame]) / each[frame], count - 1.0)
    columns = [np.interp(grid, t, smooth) for t, smooth in speeds]
    return grid, at, np.ascontiguousarray(np.stack(columns, axis=1))


def smoothed(t: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return a signal (n,) with white noise, smooth but for its own edges, and half widths in s.

    Each value is a mean around its time over as long as the signal is straight within its noise:
    the intersection of confidence intervals (Goldenshluger and Nemirovski, Math. Methods of
    Statistics 6, 1997). The noise itself would let contacts slide that do not, and would be in the
    torques; a mean of one width would round off the edges that sliding contacts leave.
    """
    count, sd, dt = len(t), max(white_noise(values), SURE), float(np.median(np.diff(t)))
    total = np.append(0.0, np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(t)))
    index, room = np.arange(count), np.minimum(np.arange(count), np.arange(count)[::-1])
    best, widths, agree = values.copy(), np.zeros(count), np.ones(count, np.bool_)
    low, high = values - AGREE * sd, values + AGREE * sd
    half = 1
    while half * dt <= WIDEST_S:
        inside = np.minimum(half, room)
        first, last = index - inside, index + inside
        span = np.where(inside > 0, t[last] - t[first], 1.0)
        mean = np.where(inside > 0, (total[last] - total[first]) / span, values)
        reach = AGREE * sd / np.sqrt(np.maximum(2.0 * inside, 1.0))
        low, high = np.maximum(low, mean - reach), np.minimum(high, mean + reach)
        agree &= low <= high
        best, widths = np.where(agree, mean, best), np.where(agree, half * dt, widths)
        half *= 2
    return best, widths


def _signal(
    sweep: RecordedSweep, info: TrialInfo, name: str, seen: bool
) -> tuple[FloatArray, FloatArray]:
    """Return times in s and values of a signal as recorded, without rows that repeat another.

    If it is ``seen`` by the camera, its first frames are left out.

    Raises:
        DataError: it is not there, has no sample, or one that is not finite.
    """
    stream, field = sweep.field(name)
    rows = sweep.recording.read(stream.name, info.start_ns, info.end_ns)
    if stream.has_status:
        rows = rows[~stale_rows(rows[STATUS_FIELD])]
    values = np.asarray(rows[field], dtype=np.float64)
    if len(values) < FEWEST or not np.all(np.isfinite(values)):
        raise DataError(
            f"{sweep.path}: in trial {info.number} signal {name!r} has {len(values)} samples "
            "that do not repeat another, "
            f"{np.count_nonzero(~np.isfinite(values))} of them not finite",
            hint="`rigd report FILE` draws the recording",
        )
    t_s = (rows["t_ns"] - info.start_ns) * NS
    kept = t_s >= (LATEST_S if seen else 0.0)
    return t_s[kept], values[kept]


def clean(poses: FloatArray, seen: NDArray[np.bool_], times: FloatArray) -> None:
    """Drop frames in which a marker was taken for another; bridge what is missing; unwrap."""
    known = np.flatnonzero(seen[:, 0])
    last = len(known) - 1
    begin = np.clip(np.arange(len(known)) - AROUND, 0, max(last - 2 * AROUND, 0))
    windows = np.minimum(begin[:, None] + np.arange(2 * AROUND + 1), last)
    for axis in (0, 1):
        places = poses[known, axis]
        off = np.abs(places - np.median(places[windows], axis=1)) > EXCHANGED_M
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


def _noise_of_mean(t: FloatArray, values: FloatArray, period_s: float, frames: int) -> float:
    """Return the standard deviation of the noise of a signal's mean over some frames."""
    noise = white_noise(values)
    if noise == 0.0:  # what a step rounds off is the same all through a mean
        return _rounding(np.diff(values, 2))
    per_frame = max(1.0, period_s / float(np.median(np.diff(t))))
    return noise / math.sqrt(frames * per_frame)


def white_noise(values: FloatArray) -> float:
    """Return the standard deviation of white noise on a smooth signal; 0 if most steps are even."""
    return _spread(np.diff(values, 2))


def noise_of_seen(parts: Sequence[FloatArray], seen: Sequence[NDArray[np.bool_]]) -> float:
    """Return the standard deviation of noise on smooth signals at the frames that are ``seen``.

    Frames that are bridged have none: only three in succession that are seen show it.
    """
    second = np.concatenate([
        np.diff(part, 2)[in_succession(there)] for part, there in zip(parts, seen, strict=True)
    ])  # fmt: skip
    return _spread(second) or _rounding(second)


def in_succession(seen: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return at which frames but the last two (n - 2,) a marker is seen in three in succession."""
    return np.asarray(seen[2:] & seen[1:-1] & seen[:-2], dtype=np.bool_)


def _spread(second: FloatArray) -> float:
    return noise_of_differences(_sizes(second), 2, jump=0.0)


def _rounding(second: FloatArray) -> float:
    """Return the standard deviation by which a reading is rounded that shows no noise."""
    sizes = _sizes(second)
    return float(np.median(sizes[sizes > 0.0])) / math.sqrt(12.0) if np.any(sizes) else 0.0


def _sizes(second: FloatArray) -> FloatArray:
    """Return the sizes of second differences; those of rounded arithmetic are 0."""
    sizes = np.abs(second)
    return np.where(sizes > SAME * np.max(sizes), sizes, 0.0)
