"""The contacts of the articulated robot are found in data of the plant, which shares no code."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from support.articulated_robots import Driven

from rigd.analysis.check import Case, SimulatedTrial, check_analysis
from rigd_analyses.articulated.analysis import ArticulatedAnalysis
from rigd_analyses.articulated.kernel import NAMES, POSE, RATE, TORQUE, simulate

RATE_HZ = 100
LATENCY = 2  #: samples
CONSTANTS = {
    "wheel_radius": 0.04, "half_track": 0.445 / 3, "half_wheelbase": 0.0507, "hinge_distance": 0.2,
    "gear_ratio": 25.0, "rotor_inertia": 1e-6, "body_mass": 3.6, "body_inertia": 0.0302,
    "wheel_mass": 0.1, "wheel_inertia": 8e-5, "gravity": 9.81, "certain_grip": 0.7,
}  # fmt: skip
PARAMETERS = {**CONSTANTS, "k_lon": 120.0, "k_lat": 200.0, "k_roll": 8e-4, "hinge": 0.0}
POINT = np.array([PARAMETERS[name] for name in NAMES])


def trial(right: float, left: float, seconds: float, seed: int) -> SimulatedTrial:
    """Return a trial of the plant: 0.5 s of rest, a ramp of 0.3 s, the speeds held."""
    robot, rows = Driven(), []
    for index in range(round(seconds * RATE_HZ)):
        share = min(max(((index + 1) / RATE_HZ - 0.5) / 0.3, 0.0), 1.0)
        motors = robot.state[robot.robot.first_spin :][robot.driven] * 25.0
        poses = np.column_stack([robot.centres, robot.headings]).ravel()
        rows.append([*motors, *robot.torques(), *poses])
        robot.play(1 / RATE_HZ, share * right, share * left, ramp_s=1 / RATE_HZ)
    data = np.array(rows)
    data[LATENCY:, 4:] = data[:-LATENCY, 4:].copy()
    data[:, [5, 8]] *= 1.01
    noise = np.array([0.1, 0.1, 1e-4, 1e-4, *[1e-3, 1e-3, 5e-3] * 2])
    data += noise * np.random.default_rng(seed).standard_normal(data.shape)
    t_s = np.arange(len(data)) / RATE_HZ
    return SimulatedTrial(t_s, dict(zip(ArticulatedAnalysis.needs.signals, data.T, strict=True)))


@pytest.fixture(scope="module")
def straight() -> list[SimulatedTrial]:
    return [trial(100.0, 100.0, 3.0, 1), trial(250.0, 250.0, 3.0, 2)]


def test_analysis_finds_what_the_plant_has(straight: list[SimulatedTrial], tmp_path: Path) -> None:
    circles = [trial(200.0, 100.0, 12.0, 3), trial(100.0, 200.0, 12.0, 4)]
    sliding = [trial(500.0, 250.0, 4.0, 5)]
    truth = {"k_lon": 120.0, "k_lat": 200.0, "k_roll": 8e-4}
    case = Case([*straight, *circles, *sliding], CONSTANTS, truth, ("mu_s", "mu_d"))
    report = check_analysis(ArticulatedAnalysis, [case], tmp_path)
    assert report.skipped == {}


def test_straight_runs_hold_no_lateral_number(
    straight: list[SimulatedTrial], tmp_path: Path
) -> None:
    case = Case(straight, CONSTANTS, {}, ("k_lat", "mu_s", "mu_d"))
    check_analysis(ArticulatedAnalysis, [case], tmp_path)


def circle(point: NDArray[np.float64] | NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Return the last row of a circle at 200 and 100 rad/s that is driven for 20 s."""
    t_s = np.arange(0.0, 20.0, 0.004)
    motors = np.minimum(t_s / 0.3, 1.0)[:, None] * np.array([200.0, 100.0])
    return np.asarray(simulate(point, motors / 25.0, 0.004)[-1])


def test_circle_has_the_documented_figures() -> None:
    row = circle(POINT)
    assert row[RATE][[2, 5]] == pytest.approx([0.495675, 0.495675], abs=2e-6)
    assert row[TORQUE] / 25 == pytest.approx([6.587e-3, 1.615e-3], abs=1e-6)
    assert np.degrees(row[POSE][2] - row[POSE][5]) == pytest.approx(48.585, abs=2e-3)


@pytest.mark.parametrize("name", NAMES)
def test_complex_step_is_the_derivative(name: str) -> None:
    index, step = NAMES.index(name), 1e-6 * max(PARAMETERS[name], 1e-3)
    turned = POINT.astype(np.complex128)
    turned[index] += 1e-30j
    exact = circle(turned)[:14].imag / 1e-30
    aside = np.eye(len(NAMES))[index] * step
    differences = (circle(POINT + aside)[:14] - circle(POINT - aside)[:14]) / (2.0 * step)
    assert exact == pytest.approx(differences, rel=1e-4, abs=1e-4 * np.max(np.abs(exact)))
