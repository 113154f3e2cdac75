"""What is read of a recorded robot: its frames, the noise of its sensors, its hinge."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from rigd.analysis import DataError, Options
from rigd.analysis.recordings.source import RecordedSweep, open_sweep
from rigd.model.channels import STALE, Channel, Stream
from rigd.model.constants import Uncertainty
from rigd.model.rows import row_dtype
from rigd.record import RecordingWriter
from rigd_analyses.articulated.analysis import ArticulatedAnalysis
from rigd_analyses.articulated.checks import check_markers
from rigd_analyses.articulated.evaluation import constants_of, unused
from rigd_analyses.articulated.reading import RobotTrial, noise_of_seen, robot_trials

Floats = NDArray[np.float64]
Rows = NDArray[np.void]
START_NS = 1_790_000_000_000_000_000
SECONDS = 8.0
SIGNALS = ArticulatedAnalysis.needs.signals


def stream(name: str, *signals: str) -> Stream:
    channels = tuple(Channel(signal, SIGNALS[signal]) for signal in signals)
    return Stream(name, channels, has_status=True)


RIGHT = stream("right", "right_speed", "right_torque")
LEFT = stream("left", "left_speed", "left_torque")
CAMERA = stream("camera", *(name for name in SIGNALS if name[-7:] == "heading" or name[-2] == "_"))
NOISE = {"speed": 0.3, "torque": 1e-3, "heading": 8e-3}


def played(device: Stream, t_s: Floats, seed: int) -> Rows:
    """Return rows of a robot that stands for 0.5 s and then goes ahead at a steady speed."""
    random = np.random.default_rng(seed)
    rows = np.zeros(len(t_s), row_dtype(device))
    rows["t_ns"] = START_NS + np.rint(t_s * 1e9).astype(np.int64)
    way = 0.3 * np.maximum(t_s - 0.5, 0.0)
    for channel in device.channels:
        part, kind = channel.name.split("_")
        value = {"speed": 180.0 * (t_s > 0.5), "x": way - 0.4 * (part == "rear")}
        sd = NOISE.get(kind, 2e-3)
        rows[channel.name] = value.get(kind, 0.0) + sd * random.standard_normal(len(t_s))
    return rows


class Robot:
    """A recording of one trial, whose rows a test may change before it is read."""

    def __init__(self, path: Path, camera_s: Floats | None = None, right_hz: float = 1000.0):
        frames = np.arange(0.0, SECONDS, 0.04) if camera_s is None else camera_s
        self.path = path
        self.right = played(RIGHT, np.arange(0.0, SECONDS, 1.0 / right_hz), 1)
        self.left = played(LEFT, np.arange(0.0, SECONDS, 1e-3), 2)
        self.camera = played(CAMERA, frames, 3)

    def write(self) -> RecordedSweep:
        rows = {RIGHT: self.right, LEFT: self.left, CAMERA: self.camera}
        signals = {c.name: f"{s.name}.{c.name}" for s in rows for c in s.channels}
        plan = {"model": "articulated", "signals": dumped(signals), "constants": "{}"}
        run = {"procedure": "played", "rig": "case", "seed": "1", "trials": "1",
               "started": "2026-11-01T00:00:00+00:00"}  # fmt: skip
        with RecordingWriter.create(
            self.path / "run.mcap", streams=list(rows), start_ns=START_NS, sync_interval_s=None,
            metadata={"run": run, "parameters": {}, "identify": {**plan, "group_by": "[]"}},
            attachments=(),
        ) as writer:  # fmt: skip
            about = {"number": 1, "repeat": 1, "parameters": {}, "units": {}}
            writer.event(START_NS, "trial_start", 1, about)
            for device, values in rows.items():
                writer.write(device.name, values)
            end_ns = START_NS + round(SECONDS * 1e9)
            writer.event(end_ns, "trial_end", 1, {"complete": True, "reason": ""})
            writer.event(end_ns, "run_end", -1, {"state": "complete", "reason": ""})
        return open_sweep(self.path / "run.mcap")

    def read(self) -> RobotTrial:
        sweep = self.write()
        return robot_trials([(sweep, sweep.trials[0])])[0]


def dumped(values: dict[str, str]) -> str:
    inside = ", ".join(f'"{name}": "{value}"' for name, value in values.items())
    return f"{{{inside}}}"


def test_rounded_frame_times_give_their_mean_period(tmp_path: Path) -> None:
    stamps = np.ceil(1000.0 * np.arange(round(SECONDS * 30)) / 30.0) / 1000.0
    trial = Robot(tmp_path, stamps[stamps < SECONDS]).read()
    assert trial.period_s == pytest.approx(1 / 30, rel=1e-4)
    assert np.all(trial.seen)


def test_rows_that_repeat_another_are_dropped(tmp_path: Path) -> None:
    whole, robot = Robot(tmp_path / "a"), Robot(tmp_path / "b")
    for part in (whole, robot):
        part.path.mkdir()
    for rows in (robot.right, robot.left, robot.camera):
        rows["status"][1::2] = STALE
        for name in (rows.dtype.names or ())[1:-1]:
            rows[name][1::2] = rows[name][: len(rows) // 2 * 2 : 2]
    trial, expected = robot.read(), whole.read()
    assert len(trial.poses) == len(expected.poses) // 2
    assert trial.poses[:, 0] == pytest.approx(expected.poses[1::2, 0], abs=1e-12)
    assert trial.speed_noise == pytest.approx(expected.speed_noise, rel=0.1)


def test_torque_noise_counts_its_own_samples(tmp_path: Path) -> None:
    """The left motor comes ten times as often: its mean is not what makes the noise."""
    trial = Robot(tmp_path, right_hz=100.0).read()
    assert trial.torque_noise == pytest.approx(1e-3 / np.sqrt(10 * 4), rel=0.1)
    assert trial.speed_noise == pytest.approx(0.3 / np.sqrt(4), rel=0.1)


def test_torque_of_fast_left_motor_is_averaged(tmp_path: Path) -> None:
    robot = Robot(tmp_path, right_hz=100.0)
    robot.right["right_torque"] *= 0.1
    assert robot.read().torque_noise == pytest.approx(1e-3 / np.sqrt(10 * 40), rel=0.1)


def test_reading_without_noise_has_its_rounding(tmp_path: Path) -> None:
    robot = Robot(tmp_path)
    for rows, side in ((robot.right, "right"), (robot.left, "left")):
        rows[f"{side}_torque"] = 0.01 * np.rint(0.05 * np.sin(np.arange(len(rows)) / 50.0) / 0.01)
    assert robot.read().torque_noise == pytest.approx(0.01 / np.sqrt(12.0))


def test_robot_that_faces_back_has_straight_hinge(tmp_path: Path) -> None:
    robot = Robot(tmp_path)
    for name, heading in (("front_heading", 3.13), ("rear_heading", -3.13)):
        robot.camera[name] = heading + 1e-3 * robot.camera[name]
    trial = robot.read()
    assert trial.standing[2] - trial.standing[5] == pytest.approx(-0.0232, abs=1e-3)


@pytest.mark.parametrize("lost", [0.0, 0.2, 0.4])
def test_lost_frames_leave_noise_of_camera(lost: float) -> None:
    random = np.random.default_rng(5)
    parts, seen = [], []
    for _ in range(20):
        there = random.random(1500) >= lost
        at = np.flatnonzero(there)
        parts.append(np.interp(np.arange(1500), at, 2e-3 * random.standard_normal(len(at))))
        seen.append(there)
    assert noise_of_seen(parts, seen) == pytest.approx(2e-3, rel=0.03)


def test_camera_that_rounds_has_its_rounding() -> None:
    way = 1e-3 * np.rint(0.1 * np.arange(400))
    assert noise_of_seen([way], [np.ones(400, np.bool_)]) == pytest.approx(1e-3 / np.sqrt(12.0))


@pytest.mark.parametrize(("column", "module"), [(0, "front"), (3, "rear")])
def test_marker_of_single_frames_is_refused(column: int, module: str, tmp_path: Path) -> None:
    trial = Robot(tmp_path).read()
    seen = trial.seen.copy()
    seen[1::2, column : column + 3] = False
    with pytest.raises(DataError, match=f"never shows the {module} marker in three frames"):
        check_markers([replace(trial, seen=seen)])


def test_trials_of_two_recordings_have_labels_apart(tmp_path: Path) -> None:
    trials = []
    for name in ("first", "second"):
        (tmp_path / name).mkdir()
        sweep = Robot(tmp_path / name).write()
        trials.append((sweep, sweep.trials[0]))
    first, second = (item.label for item in robot_trials(trials))
    assert str(tmp_path / "first") in first
    assert str(tmp_path / "second") in second
    assert "of" not in robot_trials(trials[:1])[0].label


def test_largest_uncertainty_of_all_recordings_counts(tmp_path: Path) -> None:
    sweep = Robot(tmp_path).write()
    trials = []
    for u in (1e-4, 5e-4, 2e-4):
        stated = {"wheel_radius": Uncertainty(u)}
        plan = replace(sweep.plan, constants={"wheel_radius": 0.04}, uncertainties=stated)
        trials.append((replace(sweep, plan=plan), sweep.trials[0]))
    assert constants_of(trials) == {"wheel_radius": (0.04, 5e-4)}


@pytest.mark.parametrize("ratio", [0.0, -25.0])
def test_gear_ratio_that_is_not_positive_is_refused(ratio: float, tmp_path: Path) -> None:
    sweep = Robot(tmp_path).write()
    sweep = replace(sweep, plan=replace(sweep.plan, constants={"gear_ratio": ratio}))
    with pytest.raises(DataError, match=f"gear_ratio is {ratio:g}, must be a positive number"):
        ArticulatedAnalysis().evaluate([sweep], Options(), lambda _: None)


def test_uncertain_gear_ratio_is_warned_of(tmp_path: Path) -> None:
    sweep = Robot(tmp_path).write()
    for u, count in ((0.0, 0), (0.1, 1)):
        stated = {"gear_ratio": Uncertainty(u)}
        plan = replace(sweep.plan, constants={"gear_ratio": 25.0}, uncertainties=stated)
        warnings = unused([(replace(sweep, plan=plan), sweep.trials[0])])
        assert len(warnings) == count
        assert all("gear_ratio enters no interval" in text for text in warnings)
