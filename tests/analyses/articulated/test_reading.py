"""What the motors' speeds are made of: smooth without their noise, exact where contacts change."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from support.articulated.robots import Driven

from rigd_analyses.articulated.kernel import DISTURBED, LANES, NAMES, simulate
from rigd_analyses.articulated.reading import FINE_STEP_S, RobotTrial, clean, smoothed, steps
from rigd_analyses.articulated.system import LOCAL, SHARED, RobotSystem

Floats = NDArray[np.float64]
NOISE = 1.5  #: rad/s
POINT = np.array(
    [{"k_lon": 120.0, "k_lat": 200.0, "k_roll": 8e-4, "wheel_radius": 0.04, "half_track": 0.445 / 3,
      "half_wheelbase": 0.0507, "hinge_distance": 0.2, "body_mass": 3.6, "body_inertia": 0.0302,
      "wheel_inertia": 8e-5, "gravity": 9.81, "hinge": 0.0, "wheel_mass": 0.1, "mu_s": 0.9,
      "mu_d": 0.6}[name] for name in NAMES] + [0.0]
)  # fmt: skip


def started(target: float, seconds: float = 1.6) -> tuple[Floats, Floats, Floats]:
    """Return times, motor speeds and front x of the plant at 1 kHz: a step after 0.4 s of rest."""
    robot, rows = Driven(), []
    for index in range(round(1000 * seconds)):
        motors = robot.state[robot.robot.first_spin :][robot.driven] * 25.0
        rows.append([*motors, robot.centres[0, 0]])
        robot.play(0.001, *(2 * [target if index >= 400 else 0.0]))
    data = np.array(rows)
    t_s: Floats = 0.001 * np.arange(len(data), dtype=np.float64)
    return t_s, data[:, :2], data[:, 2] - data[0, 2]


@pytest.mark.parametrize("target", [235.0, 440.0])
def test_sliding_start_is_simulated_to_a_tenth_millimetre(target: float) -> None:
    """As a contact grips again the wheels give way: a speed that is smoothed there grips early."""
    t_s, motors, x = started(target)
    count = 1 + int(t_s[-1] / 0.04)
    grid, at, speeds = steps([(t_s, motors[:, k]) for k in (0, 1)], 0.04, count)
    lanes, none = np.eye(len(NAMES), LANES), np.zeros((0, DISTURBED, LANES))
    found = simulate(POINT, lanes, speeds / 25.0, grid, at, 0.0, none, False)
    assert np.max(found[5][:, :, 2]) == 1.0
    assert found[0][:, 0] == pytest.approx(x[::40][:count], abs=1e-4)


def test_noise_leaves_steady_speed_but_no_edge() -> None:
    t_s: Floats = 0.001 * np.arange(4000, dtype=np.float64)
    true = np.clip((t_s - 1.0) / 0.3, 0.0, 1.0) * 200.0
    true[2500:] -= 20.0 * np.exp(-(t_s[2500:] - 2.5) / 0.05)
    noisy = true + NOISE * np.random.default_rng(1).standard_normal(len(true))
    smooth, half = smoothed(t_s, noisy)
    steady = (t_s > 1.5) & (t_s < 2.3)
    assert np.std(smooth[steady] - true[steady]) < 0.15 * NOISE
    assert np.max(np.abs(smooth - true)[2450:2550]) < 5.0 * NOISE
    assert np.median(half[steady]) > 0.1
    assert np.min(half[2495:2505]) < 0.002


def test_frames_with_an_edge_have_short_steps() -> None:
    t_s: Floats = 0.001 * np.arange(2000, dtype=np.float64)
    speed = np.where(t_s < 1.0, 0.0, 300.0)
    grid, at, speeds = steps([(t_s, speed), (t_s, speed)], 0.04, 50)
    each = np.diff(grid)[at[:-1]]
    assert np.min(each) == pytest.approx(FINE_STEP_S)
    assert np.count_nonzero(each < 0.002) <= 3
    assert grid[at] == pytest.approx(0.04 * np.arange(50))
    assert speeds[at[10]].tolist() == [0.0, 0.0]
    assert speeds[at[40]] == pytest.approx([300.0, 300.0])


def standing(speeds: Floats, torque_noise: float) -> RobotSystem:
    """Return a trial of 4 s whose motors have ``speeds`` (n, 2) at its frames."""
    count = len(speeds)
    grid: Floats = 0.04 * np.arange(count, dtype=np.float64)
    empty = RobotTrial(
        "trial 1", "case", 1, 0.04, grid, np.arange(count), speeds,
        np.zeros((count, 2)), np.zeros((count, 6)), np.ones((count, 6), np.bool_), 0.1,
        torque_noise,
    )  # fmt: skip
    values = dict(zip(NAMES, POINT, strict=False))
    constants = {name: (values.get(name, 1e-6), 0.0) for name in (*SHARED, "rotor_inertia")}
    return RobotSystem((empty,), constants, 25.0)


def test_torque_of_standing_wheels_does_not_count() -> None:
    turning = np.repeat(np.where(np.arange(100) < 25, 0.0, 200.0)[:, None], 2, axis=1)
    system = standing(turning, 1e-5)
    assert np.flatnonzero(system.torque_counts(0)).tolist() == [40, 50, 60, 70, 80, 90]
    left = replace(system.trials[0], speeds=turning * [1.0, 0.0])
    assert not np.any(replace(system, trials=(left,)).torque_counts(0))


def test_torque_of_a_ramp_counts_for_less() -> None:
    rising = np.repeat(np.clip(50.0 + 8.0 * np.arange(100), 50.0, 400.0)[:, None], 2, axis=1)
    system = standing(rising, 1e-5)
    point = np.array([item.parameter.start for item in system.shared])
    sd = np.sqrt(system.deviations(0, point, np.zeros(len(LOCAL))).variance[:, 0])
    assert sd[90] == pytest.approx(1e-5, rel=1e-3)
    assert sd[20] > 2.5 * sd[90]


def test_heading_off_course_moves_both_markers() -> None:
    """Else the places of both markers would count as if noise of the wheels did not turn them."""
    system = standing(np.full((50, 2), 200.0), 1e-5)
    poses = np.tile([0.3, 0.2, 0.7, 0.1, -0.1, 0.4], (50, 1))
    system = replace(system, trials=(replace(system.trials[0], poses=poses),))
    point = np.array([item.parameter.start for item in system.shared])
    seen = system.deviations(0, point, np.zeros(len(LOCAL))).seen[0, 2:, 0]
    centre, turn = 0.5 * (poses[0, :2] + poses[0, 3:5]), 1e-6
    for k in (0, 3):
        x, y = poses[0, k : k + 2] - centre
        assert seen[k : k + 3] == pytest.approx([-y, x, 1.0])
    assert np.hypot(*seen[:2]) * turn == pytest.approx(np.hypot(*seen[3:5]) * turn)


@pytest.mark.parametrize("wrong", [[0], [59], [58, 59], [30]])
def test_exchanged_markers_are_dropped_at_ends_too(wrong: list[int]) -> None:
    times: Floats = 0.04 * np.arange(60, dtype=np.float64)
    true = np.column_stack([0.2 * times, 0.0 * times, 0.0 * times])
    poses, seen = true.copy(), np.ones((60, 3), np.bool_)
    poses[wrong, 0] -= 0.38
    clean(poses, seen, times)
    assert np.flatnonzero(~seen[:, 0]).tolist() == wrong
    assert poses[1:57] == pytest.approx(true[1:57], abs=1e-9)
