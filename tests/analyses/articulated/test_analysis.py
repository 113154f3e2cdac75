"""The contacts of the articulated robot are found in data of the plant, which shares no code."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from support.articulated.robots import Driven
from support.cases import FEW_EVALUATIONS

from rigd.analysis import DataError
from rigd.analysis.check import Case, SimulatedTrial, check_analysis
from rigd.analysis.fitting.fit import fit
from rigd.analysis.output_error.estimator import conclude
from rigd.analysis.output_error.pipeline import Identification, identify
from rigd.analysis.output_error.whitened_residuals import OutputErrorModel, noise_at
from rigd.analysis.result import FitOutcome
from rigd_analyses.articulated.analysis import ArticulatedAnalysis
from rigd_analyses.articulated.checks import check_hinge, check_markers, silences
from rigd_analyses.articulated.extensions import candidates
from rigd_analyses.articulated.family import RobotFamily, common_scale, robot_family
from rigd_analyses.articulated.kernel import DISTURBED, LANES, NAMES, simulate
from rigd_analyses.articulated.reading import RobotTrial
from rigd_analyses.articulated.result import (
    BY_LAW,
    error_of,
    kinematic_radius,
    mean_radius,
    result,
    value_of,
)
from rigd_analyses.articulated.search import RobotFit, check_way, find, fitted_from
from rigd_analyses.articulated.system import CONTACTS, INERTIA, LOCAL, RATIO, SHARED, RobotSystem

RATE_HZ = 100
LATENCY = 2  #: samples
CONSTANTS = {
    "wheel_radius": 0.04, "half_track": 0.445 / 3, "half_wheelbase": 0.0507, "hinge_distance": 0.2,
    "gear_ratio": 25.0, "rotor_inertia": 1e-6, "body_mass": 3.6, "body_inertia": 0.0302,
    "wheel_mass": 0.1, "wheel_inertia": 8e-5, "gravity": 9.81, "certain_grip": 0.7,
}  # fmt: skip
PARAMETERS = {
    **CONSTANTS, "k_lon": 120.0, "k_lat": 200.0, "k_roll": 8e-4, "hinge": 0.0, "mu_s": 0.9,
    "mu_d": 0.6,
}  # fmt: skip
#: What a straight way says nothing of.
SIDEWAYS = ("k_lat", "mu_s", "mu_d")
POINT = np.array([*(PARAMETERS[name] for name in NAMES), 0.0])


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
    noise = np.array([0.3, 0.3, 1e-3, 1e-3, *[2e-3, 2e-3, 8.7e-3] * 2])
    data += noise * np.random.default_rng(seed).standard_normal(data.shape)
    t_s = np.arange(len(data)) / RATE_HZ
    return SimulatedTrial(t_s, dict(zip(ArticulatedAnalysis.needs.signals, data.T, strict=True)))


@pytest.fixture(scope="module")
def straight() -> list[SimulatedTrial]:
    return [trial(100.0, 100.0, 3.0, 1), trial(250.0, 250.0, 3.0, 2)]


def test_analysis_finds_what_the_plant_has(straight: list[SimulatedTrial], tmp_path: Path) -> None:
    circles = [trial(200.0, 100.0, 12.0, 3), trial(100.0, 200.0, 12.0, 4)]
    sliding = [trial(500.0, 250.0, 8.0, 5), trial(400.0, 200.0, 8.0, 6)]
    truth = {"k_lon": 120.0, "k_lat": 200.0, "k_roll": 8e-4, "mu_d": 0.6}
    case = Case([*straight, *circles, *sliding], CONSTANTS, truth)
    rules = ("recovers the truth", "does not depend on the rate", "refuses what it cannot read")
    report = check_analysis(ArticulatedAnalysis, [case], tmp_path, only=rules)
    assert report.skipped == {}


def test_straight_runs_hold_no_lateral_number(
    straight: list[SimulatedTrial], tmp_path: Path
) -> None:
    case = Case(straight, CONSTANTS, {}, SIDEWAYS)
    check_analysis(ArticulatedAnalysis, [case], tmp_path, only=("recovers the truth",))


def test_analysis_keeps_every_rule(straight: list[SimulatedTrial], tmp_path: Path) -> None:
    case = Case(straight, CONSTANTS, {}, SIDEWAYS)
    check_analysis(ArticulatedAnalysis, [case], tmp_path, only=FEW_EVALUATIONS)


UNDISTURBED = np.zeros((0, DISTURBED, LANES))


def driven(
    point: NDArray[np.float64], right: float, left: float, seconds: float, *, moving: bool
) -> tuple[NDArray[np.float64], ...]:
    """Return what the robot does at motor speeds in rad/s that are reached within 0.3 s."""
    t_s = np.arange(0.0, seconds, 0.004)
    motors = np.minimum(t_s / 0.3, 1.0)[:, None] * np.array([right, left])
    lanes = np.eye(len(NAMES), LANES)
    frames = np.arange(0, len(t_s), 10)
    end = frames[-1] + 1
    return simulate(
        point, lanes, motors[:end] / 25.0, t_s[:end], frames, 0.0, UNDISTURBED, moving
    )  # fmt: skip


def test_circle_has_the_documented_figures() -> None:
    poses, rates, torques, *_ = driven(POINT, 200.0, 100.0, 20.0, moving=False)
    assert rates[-1][[2, 5]] == pytest.approx([0.495675, 0.495675], abs=2e-6)
    mean = (torques[-1] - torques[-2]) / 0.04 / 25
    assert mean == pytest.approx([6.587e-3, 1.615e-3], abs=1e-6)
    assert np.degrees(poses[-1, 2] - poses[-1, 5]) == pytest.approx(48.585, abs=2e-3)
    assert mean_radius(poses[-250:, :2])[0] == pytest.approx(0.46601, abs=2e-5)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("right", [200.0, 500.0])
def test_derivatives_are_those_of_differences(name: str, right: float) -> None:
    index, step = NAMES.index(name), 1e-6 * max(PARAMETERS[name], 1e-3)
    _, _, _, poses, torques, _, _ = driven(POINT, right, right / 2.0, 6.0, moving=True)
    aside = np.eye(len(POINT))[index] * step
    ends = [driven(POINT + sign * aside, right, right / 2.0, 6.0, moving=False) for sign in (1, -1)]
    for lane, part in ((poses, 0), (torques, 2)):
        differences = (ends[0][part] - ends[1][part]) / (2.0 * step)
        tolerance = 2e-3 * max(float(np.max(np.abs(differences))), 1e-9)
        assert lane[:, :, index] == pytest.approx(differences, rel=1e-4, abs=tolerance)


@pytest.mark.parametrize(("k_lon", "body_mass"), [(520.0, 3.6), (1000.0, 3.6), (120.0, 0.8)])
def test_stiff_contacts_are_simulated_in_stable_steps(k_lon: float, body_mass: float) -> None:
    constants = {**CONSTANTS, "body_mass": body_mass, "body_inertia": 0.0302 * body_mass / 3.6}
    shared = {**PARAMETERS, RATIO: 1.5, "scale_x": 0.0, "scale_y": 0.0, "latency": 0.0}
    shared |= {"k_lon": k_lon, **constants}
    poses = []
    for step_s in (0.004, 0.0002):
        grid = np.linspace(0.0, 2.0, round(2.0 / step_s) + 1)
        share = np.minimum(grid / 0.3, 1.0)[:, None]
        seen, none = np.ones((51, 6), np.bool_), np.zeros((51, 6))
        item = RobotTrial(
            "circle", "", 1, 0.04, grid, np.arange(0, len(grid), round(0.04 / step_s)),
            share * [200.0, 100.0], none[:, :2], none, seen, 1e-3, 1e-3,
        )  # fmt: skip
        system = RobotSystem((item,), {name: (x, 0.0) for name, x in constants.items()}, 25.0)
        run = system.run(0, np.array([shared[name] for name in SHARED]), np.zeros(len(LOCAL)))
        poses.append(run.pose)
    np.testing.assert_allclose(poses[0], poses[1], atol=2e-5)


def test_narrow_gradual_law_is_nearly_the_jump() -> None:
    jump, *_ = driven(POINT, 500.0, 250.0, 4.0, moving=False)
    apart = []
    for width in (0.05, 0.005):
        gradual, *_ = driven(np.append(POINT[:-1], width), 500.0, 250.0, 4.0, moving=False)
        apart.append(float(np.max(np.abs(gradual - jump)[:, :2])))
    assert apart[1] < 0.3 * apart[0]
    assert apart[1] < 1e-3 < apart[0]


def test_gradual_contacts_are_in_interval_of_mu_s() -> None:
    speeds = [(100.0, 200.0), (250.0, 250.0), (500.0, 250.0), (400.0, 200.0)]
    found = find(recorded(speeds, 11, width=0.05), 0.7, lambda _: None)
    sliding = result(identify(robot_family(found, 0.7)))
    entry = sliding.parameter("mu_s")
    assert entry.low is not None
    assert entry.high is not None
    assert entry.low < 0.9 < entry.high
    assert abs(entry.estimate / 0.9 - 1.0) > 0.01
    assert BY_LAW in sliding.warnings


def test_sliding_robot_moves_as_the_plant() -> None:
    robot = Driven()
    speeds, poses = [], []
    for index in range(2001):
        speeds.append(robot.state[robot.robot.first_spin :][robot.driven].copy())
        poses.append(np.column_stack([robot.centres, robot.headings]).ravel())
        share = min((index + 1) / 150.0, 1.0)
        robot.play(0.002, share * 500.0, share * 250.0, ramp_s=0.002)
    grid: NDArray[np.float64] = 0.002 * np.arange(len(speeds), dtype=np.float64)
    frames = np.arange(0, len(grid), 20)
    found = simulate(
        POINT, np.eye(len(NAMES), LANES), np.array(speeds), grid, frames, 0.0, UNDISTURBED, False
    )
    apart = (found[0] - found[0][0]) - (np.array(poses)[::20] - poses[0])
    assert np.max(np.abs(apart)) < 3e-4
    assert np.max(found[5][:, :, 2]) == 1.0


NOISE = np.array([1e-4, 1e-4, *[2e-3, 2e-3, 8e-3] * 2])
TRUTH = np.array(
    [{**PARAMETERS, RATIO: 1.5, "scale_x": 0.0, "scale_y": 0.01, "latency": 0.02}[name]
     for name in SHARED]
)  # fmt: skip
U = {"wheel_radius": 1e-4, "half_track": 5e-4, "half_wheelbase": 5e-4, "hinge_distance": 5e-4,
     "body_mass": 2e-3, "body_inertia": 1e-3, "wheel_mass": 1e-3, "wheel_inertia": 2.4e-6,
     "gravity": 0.01, "rotor_inertia": 1e-7}  # fmt: skip


def recorded(
    speeds: list[tuple[float, float]], seed: int, seconds: float = 8.0, width: float = 0.0,
    stiffer: float = 1.0,
) -> RobotSystem:  # fmt: skip
    """Return trials of the analysis' own robot, at motor speeds that are reached within 0.3 s.

    With a ``width`` its contacts let go gradually; k_lon is ``stiffer`` by this factor.
    """
    truth = TRUTH * np.where(np.array(SHARED) == "k_lon", stiffer, 1.0)
    random = np.random.default_rng(seed)
    period, sub = 0.04, 10
    trials = []
    for number, pair in enumerate(speeds, start=1):
        count = round(seconds / period)
        t_s: NDArray[np.float64] = period / sub * np.arange(count * sub - sub + 1, dtype=np.float64)
        motors = np.clip((t_s - 0.1) / 0.3, 0.0, 1.0)[:, None] * np.array(pair)
        empty = RobotTrial(
            f"trial {number}", "case", number, period, t_s, sub * np.arange(count), motors,
            np.zeros((count, 2)), np.zeros((count, 6)), np.ones((count, 6), np.bool_), 0.1, 1e-4,
        )  # fmt: skip
        alone = RobotSystem((empty,), {name: (CONSTANTS[name], u) for name, u in U.items()}, 25.0)
        local = np.zeros(5)
        local[INERTIA] = 1e-6
        seen = replace(alone, width=width).simulate(
            0, truth, local
        ) + NOISE * random.standard_normal((count, 8))
        trials.append(replace(empty, torques=seen[:, :2], poses=seen[:, 2:]))
    return RobotSystem(tuple(trials), alone.constants, 25.0)


@pytest.fixture(scope="module")
def recordings() -> RobotSystem:
    return recorded([(200.0, 100.0), (100.0, 200.0), (250.0, 250.0), (500.0, 250.0)], 7)


def altered(system: RobotSystem, **changes: float) -> RobotSystem:
    """Return ``system`` with other stated constants."""
    stated = {**system.constants}
    for name, factor in changes.items():
        stated[name] = (stated[name][0] * factor, stated[name][1])
    return replace(system, constants=stated)


def near(system: RobotSystem) -> Identification[RobotFamily]:
    """Return what the fit that begins at the truth shows."""
    start = np.concatenate([TRUTH, np.tile([0.0, 0.0, 0.0, 0.0, 1e-6], len(system.trials))])
    return identify(robot_family(RobotFit(system, fitted_from(system, start), (3,)), 0.7))


def numbers(system: RobotSystem) -> tuple[Any, dict[str, float], dict[str, float]]:
    """Return gate, and estimates with their standard errors (of logarithms) by name."""
    found = near(system)
    gate, fit = found.gate, found.whole
    sds = np.sqrt(np.diag(fit.covariance))
    return (
        gate,
        dict(zip(SHARED, fit.fit.theta, strict=False)),
        dict(zip(SHARED, sds, strict=False)),
    )


def test_right_robot_fits_within_its_intervals(recordings: RobotSystem) -> None:
    gate, found, sds = numbers(recordings)
    assert gate.findings == ()
    for name, true in zip(CONTACTS, TRUTH, strict=False):
        assert abs(np.log(found[name] / true)) < 4.0 * sds[name]


def test_scale_and_latency_of_camera_are_found() -> None:
    """A scale is free of the lengths only if these are known: their uncertainty is that of it."""
    circle, fast = recorded([(200.0, 100.0)], 7, 20.0), recorded([(500.0, 250.0)], 57, 10.0)
    steps = recorded([(v, v) for v in (100.0, 150.0, 200.0, 250.0, 300.0, 400.0, 500.0)], 107, 3.0)
    known = {name: (value, 1e-5 * value) for name, (value, _) in circle.constants.items()}
    trials = circle.trials + fast.trials + steps.trials
    found = near(RobotSystem(trials, known, 25.0)).theta
    assert found[SHARED.index("scale_x")] == pytest.approx(0.0, abs=1e-3)
    assert found[SHARED.index("scale_y")] == pytest.approx(0.01, abs=1e-3)
    assert found[SHARED.index("latency")] == pytest.approx(0.02, rel=0.05)


def test_number_of_mu_s_names_its_law(recordings: RobotSystem) -> None:
    found = near(recordings)
    sliding = result(found)
    assert sliding.parameter("mu_s").low is not None
    assert BY_LAW in sliding.warnings
    assert sliding.trials[0].track is not None
    found = near(recordings.of([0, 1, 2]))
    gripping = result(found)
    assert gripping.parameter("mu_s").low is None
    assert BY_LAW not in gripping.warnings


def test_recordings_of_other_contacts_disagree(recordings: RobotSystem) -> None:
    other = recorded([(200.0, 100.0), (250.0, 250.0)], 9, stiffer=1.03)
    second = [replace(item, recording="other") for item in other.trials]
    found = near(replace(recordings, trials=(*recordings.trials[:3], *second)))
    shown = result(found)
    assert found.gate.outcome is not FitOutcome.MISFIT
    (said,) = (text for text in shown.warnings if "disagree" in text)
    assert said.startswith("case, other disagree on the longitudinal stiffness")
    alike = [replace(item, recording=f"{k}") for k, item in enumerate(recordings.trials)]
    steady = near(replace(recordings, trials=tuple(alike)))
    assert all(test.passed for test in steady.tests)
    assert len(steady.tests) == 2


def test_single_trials_widen_what_is_corrected(recordings: RobotSystem) -> None:
    """The camera of one trial is off: noise alone does not move parameters as leaving it out."""
    found = near(each(recordings, stretched))
    assert found.gate.outcome is FitOutcome.CORRECTED
    assert len(found.without) == len(recordings.trials)
    alone = replace(found, without=found.without[:0])
    apart = replace(found, without=10.0 * found.without)
    assert error_of(apart, "k_lat") > error_of(found, "k_lat") >= error_of(alone, "k_lat")


@pytest.mark.parametrize(
    ("ratio", "words"),
    [(25.0 * 25.0, "compare wheel_radius"), (20.0, "gear_ratio"), (1.0, "gear ratio 25")],
)
def test_wrong_way_of_wheels_is_named(recordings: RobotSystem, ratio: float, words: str) -> None:
    speeds = [replace(item, speeds=item.speeds / 25.0) if ratio == 1.0 else item
              for item in recordings.trials]  # fmt: skip
    stated = 25.0 if ratio == 1.0 else ratio
    wrong = RobotSystem(tuple(speeds), recordings.constants, stated)
    with pytest.raises(DataError, match="times as far") as caught:
        check_way(wrong)
    assert words in f"{caught.value.hint}"


@pytest.mark.parametrize("seconds", [1.16, 1.2, 1.36])
def test_way_counts_to_the_last_frame(recordings: RobotSystem, seconds: float) -> None:
    check_way(replace(recordings, trials=(recordings.trials[2].first(seconds),)))


def ahead(trial: RobotTrial) -> RobotTrial:
    """Return ``trial`` with the front marker 5 mm ahead of its centre."""
    poses = trial.poses.copy()
    poses[:, 0] += 0.005 * np.cos(poses[:, 2])
    poses[:, 1] += 0.005 * np.sin(poses[:, 2])
    return replace(trial, poses=poses)


def turned(trial: RobotTrial) -> RobotTrial:
    """Return ``trial`` with the rear marker turned by 20 mrad."""
    poses = trial.poses.copy()
    poses[:, 5] += 0.02
    return replace(trial, poses=poses)


def hinged(trial: RobotTrial) -> RobotTrial:
    """Return ``trial`` with the hinge 10 mm to the left on the front module."""
    poses = trial.poses.copy()
    poses[:, 3] -= 0.01 * np.sin(poses[:, 2])
    poses[:, 4] += 0.01 * np.cos(poses[:, 2])
    return replace(trial, poses=poses)


@pytest.mark.parametrize(
    ("change", "size", "words"),
    [
        (ahead, 0.005, "front marker ahead"),
        (turned, 0.02, "rear marker that is turned"),
        (hinged, 0.01, "hinge aside of the middle of the front module"),
    ],
)
def test_part_off_its_place_is_named(
    recordings: RobotSystem, change: Any, size: float, words: str
) -> None:
    wrong = replace(recordings, trials=tuple(change(item) for item in recordings.trials))
    gate, found, sds = numbers(wrong)
    assert words in gate.sentence
    assert gate.explanations[0].size == pytest.approx(size, rel=0.2)
    assert abs(np.log(found["k_lat"] / 200.0)) < 4.0 * sds["k_lat"]


def quarter(trial: RobotTrial) -> RobotTrial:
    """Return ``trial`` in a frame of the camera that is turned by a quarter."""
    x, y, heading = trial.poses[:, ::3], trial.poses[:, 1::3], trial.poses[:, 2::3]
    turned = np.stack([-y, x, heading + 0.5 * np.pi], axis=2)
    return replace(trial, poses=turned.reshape(len(x), 6))


def test_marker_suspect_turns_with_the_robot(recordings: RobotSystem) -> None:
    theta = np.concatenate([TRUTH, [0.0, 0.0, 0.0, 0.0, 1e-6]])
    system = each(recordings.of([0]), quarter)
    suspects = {item.name: item for item in candidates(system, theta)}
    name = "a front marker ahead of the centre of its module"
    before = system.trials[0].poses
    expected = (ahead(system.trials[0]).poses - before) / 0.005
    shown = suspects[name].columns()[0][:, 2:, 0]
    assert np.corrcoef(shown.ravel(), expected.ravel())[0, 1] > 0.99


def test_gaining_clock_shows_along_the_way(recordings: RobotSystem) -> None:
    theta = np.concatenate([TRUTH, [0.0, 0.0, 0.0, 0.0, 1e-6]])
    system = each(recordings.of([2]), quarter)  # straight ahead, along y
    suspects = {item.name: item for item in candidates(system, theta)}
    shown = suspects["a clock of the camera that gains"].columns()[0][:, 2:, 0]
    assert np.max(np.abs(shown[:, 1])) > 100.0 * np.max(np.abs(shown[:, 0]))


@pytest.mark.parametrize(
    ("name", "factor"), [("body_mass", 1.1), ("half_track", 1.02), ("half_wheelbase", 1.1)]
)
def test_wrong_constant_is_named(recordings: RobotSystem, name: str, factor: float) -> None:
    gate, _, _ = numbers(altered(recordings, **{name: factor}))
    assert name.replace("_", " ") in " ".join(gate.findings)


def test_wrong_torque_is_named_and_widens(recordings: RobotSystem) -> None:
    trials = [replace(item, torques=1.05 * item.torques) for item in recordings.trials]
    system = replace(recordings, trials=tuple(trials))
    found = near(system)
    assert "scale of the torques" in f"{found.gate.findings} {found.gate.explanations}"
    off = abs(np.log(value_of(found.whole, "k_lon") / 120.0))
    assert off < 3.0 * error_of(found, "k_lon")


def each(system: RobotSystem, change: Callable[[RobotTrial], RobotTrial]) -> RobotSystem:
    return replace(system, trials=tuple(change(item) for item in system.trials))


def exchanged(trial: RobotTrial) -> RobotTrial:
    """Return ``trial`` with both markers taken for each other from 2 s on."""
    late = trial.t_s >= 2.0
    poses = np.where(late[:, None], trial.poses[:, [3, 4, 5, 0, 1, 2]], trial.poses)
    return replace(trial, poses=poses)


def mirrored(trial: RobotTrial) -> RobotTrial:
    return replace(trial, speeds=trial.speeds[:, ::-1])


def unseen_at_rest(trial: RobotTrial) -> RobotTrial:
    seen = trial.seen.copy()
    seen[:10, 3:] = False
    return replace(trial, seen=seen)


def cut_at_begin(trial: RobotTrial) -> RobotTrial:
    """Return ``trial`` from 1 s on."""
    return replace(trial, poses=trial.poses[25:], seen=trial.seen[25:],
                   torques=trial.torques[25:], speeds=trial.speeds[250:],
                   grid=trial.grid[250:] - trial.grid[250], at=trial.at[25:] - 250)  # fmt: skip


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (exchanged, "from 2.0 s on, in 150 of 200 frames, the front marker is behind"),
        (mirrored, "turn to the other side than its wheels"),
        (unseen_at_rest, "does not show the rear marker where the robot stands"),
        (cut_at_begin, "the motors turn when the camera's first frames come"),
    ],
)
def test_camera_that_shows_another_robot_is_named(
    recordings: RobotSystem, change: Callable[[RobotTrial], RobotTrial], words: str
) -> None:
    check_markers(recordings.trials)
    with pytest.raises(DataError, match=words):
        check_markers(each(recordings, change).trials)


def silent(trial: RobotTrial) -> RobotTrial:
    """Return ``trial`` whose front marker is not seen for 1 s, and stands meanwhile."""
    poses, seen = trial.poses.copy(), trial.seen.copy()
    poses[50:75, :3], seen[50:75, :3] = poses[50, :3], False
    return replace(trial, poses=poses, seen=seen)


def test_silent_marker_is_named_and_does_not_count(recordings: RobotSystem) -> None:
    wrong = each(recordings, silent)
    check_markers(wrong.trials)
    assert silences(recordings.trials) == []
    assert (
        "trial 1: the camera shows no front marker for 1.0 s, from 2.0 s on"
        in (silences(wrong.trials)[0])
    )
    found = near(wrong).whole
    sds = np.sqrt(np.diag(found.covariance))
    for name in ("k_lon", "k_lat", "k_roll", "mu_d"):
        off = np.log(value_of(found, name) / dict(zip(SHARED, TRUTH, strict=True))[name])
        assert abs(off) < 4.0 * sds[SHARED.index(name)]


def test_frames_without_a_marker_are_no_readings(recordings: RobotSystem) -> None:
    wrong = each(recordings, silent)
    point = np.array([item.parameter.start for item in wrong.shared])
    at = wrong.deviations(0, point, np.array([item.parameter.start for item in wrong.local]))
    assert np.array_equal(np.isfinite(at.variance[:, 2:]), wrong.trials[0].seen)


@pytest.mark.parametrize(
    ("sds", "common"),
    [((1e-3, 0.1), 0.05), ((0.1, 1e-3), -0.04), ((0.1, 0.1), 0.0)],
    ids=["x is known", "y is known", "neither is known"],
)
def test_scale_of_camera_is_that_of_known_axis(
    recordings: RobotSystem, sds: tuple[float, float], common: float
) -> None:
    point = np.array([item.parameter.start for item in recordings.shared])
    local = [item.parameter.start for item in recordings.local]
    theta = np.concatenate([point, np.tile(local, len(recordings.trials))])
    model = OutputErrorModel(recordings, noise_at(recordings, theta))
    places = [SHARED.index("scale_x"), SHARED.index("scale_y")]
    theta[places] = 0.05, -0.04
    begun = fit(model, theta, max_iterations=0)
    covariance = np.zeros((len(theta), len(theta)))
    covariance[places, places] = np.square(sds)
    found = replace(conclude(model, replace(begun, theta=theta), 10), covariance=covariance)
    assert common_scale(found) == pytest.approx(common, abs=2e-3)


def stopped(trial: RobotTrial) -> RobotTrial:
    """Return ``trial`` with a hinge that goes no farther than 40 degrees."""
    poses = trial.poses.copy()
    most = np.radians(40.0)
    poses[:, 5] = poses[:, 2] - np.clip(poses[:, 2] - poses[:, 5], -most, most)
    return replace(trial, poses=poses)


def test_hinge_at_its_stop_is_named(recordings: RobotSystem) -> None:
    check_hinge(recordings, 0.7)
    with pytest.raises(DataError, match="2 circles the hinge turns by 40 degrees") as caught:
        check_hinge(each(recordings, stopped), 0.7)
    assert f"{caught.value.hint}".startswith("look at its stop first")


def larger(trial: RobotTrial) -> RobotTrial:
    """Return ``trial`` of a robot whose right wheels are 2 % larger than the left."""
    return replace(trial, speeds=trial.speeds / [1.02, 1.0], torques=trial.torques * [1.02, 1.0])


def loud(trial: RobotTrial) -> RobotTrial:
    return replace(trial, torques=trial.torques * [1.05, 1.0])


@pytest.mark.parametrize(
    ("change", "words"),
    [(larger, "another radius of the right wheels"), (loud, "another scale of the right torque")],
)
def test_difference_of_both_sides_is_named(
    recordings: RobotSystem, change: Callable[[RobotTrial], RobotTrial], words: str
) -> None:
    gate, _, _ = numbers(each(recordings, change))
    assert words in gate.sentence


def test_loud_torque_names_the_trial_that_has_it(recordings: RobotSystem) -> None:
    """A trial too short for a mean of torques is none of them."""
    short, loud_one = recordings.trials[0].first(0.3), recordings.trials[2]
    noise = 2e-3 * np.random.default_rng(1).standard_normal((len(loud_one.torques), 1))
    loud_one = replace(loud_one, torques=loud_one.torques + noise * [1.0, 0.0])
    trials = (short, recordings.trials[1], loud_one, recordings.trials[3])
    gate = near(replace(recordings, trials=trials)).gate
    assert gate.outcome is FitOutcome.MISFIT
    assert "right torque" in gate.sentence
    assert "in trial trial 3" in gate.sentence


def test_measured_radius_counts_seen_frames_only() -> None:
    """A chord bridges what is not seen: it is nearer to the centre."""
    whole = recorded([(200.0, 100.0)], 7, 16.0)
    seen = whole.trials[0].seen.copy()
    seen[150:250] = False
    poses = whole.trials[0].poses.copy()
    poses[150:250] = np.linspace(poses[149], poses[250], 100)
    bridged = replace(whole, trials=(replace(whole.trials[0], poses=poses, seen=seen),))
    told = []
    for system in (whole, bridged):
        found = near(system)
        lines = result(found).preprocessing.statements
        (line,) = [text for text in lines if "mean radius of the front marker" in text]
        told.append(float(line.partition("front marker ")[2].partition(" ")[0]))
    assert told[1] == pytest.approx(told[0], abs=1e-3)
    kinematic = float(line.partition("simulated, ")[2].partition(" ")[0])
    assert kinematic == pytest.approx(0.445, abs=5e-4)


@pytest.mark.parametrize(("right", "left"), [(200.0, 100.0), (100.0, 200.0), (-200.0, -100.0)])
def test_kinematic_radius_is_that_of_paper(right: float, left: float) -> None:
    """Its section 3: 200 and 100 rad/s, about 0.445 m."""
    speeds = np.tile([right, left], (5, 1))
    assert kinematic_radius(speeds, 0.445 / 3.0) == pytest.approx(0.445, rel=1e-12)


def stretched(trial: RobotTrial) -> RobotTrial:
    return replace(trial, poses=trial.poses * [1.1, 1.1, 1.0, 1.1, 1.1, 1.0])


def test_camera_of_another_unit_is_named_and_widens(recordings: RobotSystem) -> None:
    found = near(each(recordings, stretched))
    assert "its unit of length, or all of these lengths" in " ".join(found.gate.findings)
    assert error_of(found, "k_lon") > 0.05


def test_freed_geometry_is_found(recordings: RobotSystem) -> None:
    """As `--set half_track="155.8 mm +- 30 mm"` frees it."""
    stated = {**recordings.constants, "half_track": (1.05 * CONSTANTS["half_track"], 0.03)}
    gate, found, sds = numbers(replace(recordings, constants=stated))
    assert gate.findings == ()
    assert found["half_track"] == pytest.approx(CONSTANTS["half_track"], rel=5e-3)
    assert abs(np.log(found["k_lat"] / 200.0)) < 4.0 * sds["k_lat"]
