"""`rigd identify` on robots of a second author, whose physics is held to the reference."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[3] / "benchmarks"))
from blind.judge import ROBOT, run, verdict
from blind.robot import CONSTANTS, Robot, Trial, draw, drive
from blind.robot_worlds import robot_kinds, robot_world

from rigd_analyses.articulated.result import mean_radius

KINDS = robot_kinds()


def reference() -> Robot:
    """Return the robot of docs/physics/articulated.md, section 5.1."""
    robot = draw(0)
    robot.true |= dict.fromkeys(CONSTANTS[CONSTANTS.index("slope_x") :], 0.0)
    robot.true |= {"kp": 5e-4, "ki": 5e-3, "mu_s": 0.9, "mu_d": 0.6, "hinge_stop": 2.0}
    robot.true |= {"warming_time": 1.0, "torque_limit": 0.05}
    for name, value in {
        "mass": 3.6, "inertia": 0.03, "half_track": 0.445 / 3, "half_wheelbase": 0.0507,
        "wheel_mass": 0.1, "wheel_yaw": 5e-5,
    }.items():  # fmt: skip
        robot.module(name)[:] = value
    robot.module("behind")[0] = robot.module("ahead")[1] = 0.2
    for name, value in {
        "radius": 0.04, "k_lon": 120.0, "k_lat": 200.0, "k_roll": 8e-4, "load": 9.81,
    }.items():  # fmt: skip
        robot.wheel(name)[:] = value
    robot.unit("wheel_inertia")[:], robot.unit("gear")[:] = 8e-5, 25.0
    robot.unit("rotor")[:2] = 1e-6
    robot.trials = [Trial(200.0, 100.0, 0.3, 11.5), Trial(250.0, 250.0, 1e-6, 3.0)]
    return robot


def test_second_robot_gives_the_reference_numbers() -> None:
    circle, stepped = (drive(reference(), number) for number in (0, 1))
    radius, _ = mean_radius(circle[10_000:12_000, 1:3])
    rate = (circle[11_999, 3] - circle[10_999, 3]) / 1.0
    assert radius == pytest.approx(0.46601, abs=2e-5)
    assert rate == pytest.approx(0.495675, abs=5e-6)
    assert np.degrees(circle[11_999, 3] - circle[11_999, 6]) == pytest.approx(48.585, abs=0.005)
    assert stepped[3_500, 1] == pytest.approx(1.17021, abs=1e-4)


def test_every_wrong_robot_differs_from_its_own() -> None:
    for number, kind in enumerate(KINDS.values()):
        for size in range(len(kind.sizes)):
            right, wrong = draw(1000 + 10 * number), robot_world(kind.name, size, 0)
            same = all(
                np.array_equal(getattr(right, part), getattr(wrong, part))
                for part in ("modules", "wheels", "units")
            )
            parts = ("true", "stated", "camera", "motors", "trials")
            same &= all(getattr(right, part) == getattr(wrong, part) for part in parts)
            assert not same, kind.name


@pytest.mark.parametrize("number", [0, 2])  # the fit of all of 2 leaves the truth
def test_right_robot_of_second_author_fits(number: int, tmp_path: Path) -> None:
    found = run("right", 0, number, tmp_path, ROBOT)
    assert verdict(found, KINDS) == "right"
    assert len(found["misses"]) == 5
