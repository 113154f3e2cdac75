"""Contacts of each module of a chain are found in data of the plant, which shares no code."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from copy import deepcopy
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from support.articulated.chains import GEAR, GENTLE, Chain, Recorded, Trial, drawn, played, recorded
from support.cases import FEW_EVALUATIONS

from rigd.analysis import DataError, Options
from rigd.analysis.check import Case, SimulatedTrial, check_analysis
from rigd.analysis.evaluation import evaluate
from rigd.analysis.parameters import ParameterEvaluation
from rigd.analysis.result import FitOutcome, IdentificationResult, Verdict
from rigd.analysis.validation.evaluation import validate
from rigd.analysis.validation.result import GroupValidation, ModelOutcome
from rigd.model.errors import ConfigError
from rigd_analyses.articulated.chain.analysis import ChainAnalysis

Array = NDArray[np.float64]
#: Of a robot of one module, in the order of what is played.
SIGNALS = (
    "module_1_right_speed", "module_1_left_speed", "module_1_right_torque", "module_1_left_torque",
    "module_1_x", "module_1_y", "module_1_heading",
)  # fmt: skip
#: A robot of three modules whose ends drive, and trials that show its contacts.
ENDS = ("all", "none", "all")
FEW = (*GENTLE[:2], GENTLE[3], GENTLE[6])


@pytest.fixture(scope="module")
def robot() -> Chain:
    return drawn(0, ENDS)


@pytest.fixture(scope="module")
def sensed(robot: Chain) -> Recorded:
    return recorded(robot, FEW)


def identified(content: Recorded, folder: Path) -> IdentificationResult:
    found = evaluate([content.write(folder / "run.mcap")], Options())
    assert isinstance(found, ParameterEvaluation)
    return found.sections[0].result


def misses(found: IdentificationResult, truth: dict[str, float]) -> dict[str, float]:
    """Return how many half widths the truth is off, of intervals that do not hold it."""
    off = {}
    for name, true in truth.items():
        entry = found.parameter(name)
        if entry.low is not None and entry.high is not None:
            ratio = abs(entry.estimate - true) / (0.5 * (entry.high - entry.low))
            if ratio > 1.0:
                off[name] = ratio
    return off


@pytest.mark.parametrize(
    "driven",
    [ENDS, ("all",), ("front", "none", "rear"), ("all", "all"), ("all", "none", "all", "none")],
)
def test_contacts_of_each_module_are_found(driven: tuple[str, ...], tmp_path: Path) -> None:
    chain = drawn(1, driven)
    found = identified(recorded(chain), tmp_path)
    assert found.gate is not None
    assert found.gate.outcome is FitOutcome.FITS, found.gate.sentence
    assert {item.name for item in found.parameters} == set(chain.truth)
    assert all(item.low is not None for item in found.parameters)
    off = misses(found, chain.truth)
    assert len(off) <= 1, off
    assert all(ratio < 1.5 for ratio in off.values()), off


def test_straight_runs_give_mean_of_modules(tmp_path: Path) -> None:
    """Which of the pulled modules rolls harder does not show, nor any lateral force."""
    pulled = drawn(0, ("all", "none", "none"))
    found = identified(recorded(pulled, GENTLE[:3]), tmp_path)
    mean = found.parameter("k_roll")
    assert mean.low is not None
    assert mean.high is not None
    assert mean.low < np.mean(pulled.contacts["k_roll"]) < mean.high
    assert "do not tell them apart" in mean.meaning
    assert found.parameter("k_roll_2").verdict is Verdict.UNIDENTIFIABLE
    assert found.parameter("k_lat_1").low is None


def test_trials_that_slide_are_left_out(robot: Chain, tmp_path: Path) -> None:
    fast = Trial(480.0, 480.0, 2.0, 1.0, 0.01)
    found = identified(recorded(robot, [*FEW, fast]), tmp_path)
    assert len(found.trials) == len(FEW)
    (left,) = found.preprocessing.rejected
    assert "a contact may slide" in left.reason
    assert misses(found, robot.truth) == {}


def test_recordings_that_all_slide_are_refused(robot: Chain, tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"more than 0\.7 times its load in each trial"):
        identified(recorded(robot, [Trial(480.0, 480.0, 1.5, 1.0, 0.01)]), tmp_path)


def test_robot_that_folds_is_refused(tmp_path: Path) -> None:
    """A module in the middle pushes the first one, which swings to its stop."""
    pushed = drawn(0, ("none", "all", "none"))
    with pytest.raises(DataError, match="the robot folds in each trial") as caught:
        identified(recorded(pushed, [GENTLE[3]]), tmp_path)
    assert "hinge behind the first module is bent" in caught.value.message
    assert "pushes" in f"{caught.value.hint}"


def moved(
    module: int, along: float, across: float, turned: float = 0.0
) -> Callable[[Array], Array]:
    """Return what moves the marker of a module on it."""

    def change(poses: Array) -> Array:
        poses, first = poses.copy(), 3 * module
        c, s = np.cos(poses[:, first + 2]), np.sin(poses[:, first + 2])
        poses[:, first] += along * c - across * s
        poses[:, first + 1] += along * s + across * c
        poses[:, first + 2] += turned
        return poses

    return change


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (moved(1, 0.008, 0.0), "the marker of the second module ahead"),
        (moved(2, 0.0, 0.008), "the marker of the third module aside"),
        (moved(1, 0.0, 0.0, 0.02), "the marker of the second module, turned"),
    ],
)
def test_marker_off_its_place_is_named(
    robot: Chain, change: Callable[[Array], Array], words: str, tmp_path: Path
) -> None:
    found = identified(recorded(robot, FEW, seen=change), tmp_path)
    assert found.gate is not None
    assert words in found.gate.sentence
    assert misses(found, robot.truth) == {}


@pytest.mark.parametrize(
    ("name", "factor"),
    [("module_2_hinge_distance", 1.05), ("half_track", 1.02)],
)
def test_wrong_constant_is_named(
    sensed: Recorded, name: str, factor: float, tmp_path: Path
) -> None:
    content = deepcopy(sensed)
    content.constants[name] *= factor
    found = identified(content, tmp_path)
    assert found.gate is not None
    assert found.gate.outcome is not FitOutcome.FITS
    assert name.replace("_", " ") in " ".join([found.gate.sentence, *found.gate.findings])


def test_wrong_mass_is_in_its_k_roll_alone(sensed: Recorded, robot: Chain, tmp_path: Path) -> None:
    content = deepcopy(sensed)
    content.constants["module_2_body_mass"] *= 1.1
    found = identified(content, tmp_path)
    total = 1.1 * robot.masses[1] + 0.4
    as_stated = robot.truth["k_roll_2"] * (robot.masses[1] + 0.4) / total
    assert misses(found, {**robot.truth, "k_roll_2": as_stated}) == {}
    assert any("as much too small as its stated mass" in x for x in found.preprocessing.statements)


def test_wrong_torque_of_a_module_is_named(sensed: Recorded, robot: Chain, tmp_path: Path) -> None:
    content = deepcopy(sensed)
    for stream, rows in content.rows.items():
        if stream.name.startswith("motor_3"):
            rows["torque"] *= 1.05
    found = identified(content, tmp_path)
    assert found.gate is not None
    assert "torques of the third module" in f"{found.gate.sentence} {found.gate.explanations}"
    assert misses(found, robot.truth) == {}


def without(*names: str) -> Callable[[Recorded], None]:
    """Return what leaves signals, and their streams, out of a recording."""

    def change(content: Recorded) -> None:
        streams = {content.signals[name].partition(".")[0] for name in names}
        content.rows = {k: v for k, v in content.rows.items() if k.name not in streams}

    return change


def stated(**constants: float) -> Callable[[Recorded], None]:
    def change(content: Recorded) -> None:
        content.constants |= constants

    return change


def undriven(content: Recorded) -> None:
    content.signals = {k: v for k, v in content.signals.items() if not v.startswith("motor")}
    content.constants["motors"] = 0


def nameless(content: Recorded) -> None:
    content.constants = {k: v for k, v in content.constants.items() if "hinge" not in k}


@pytest.mark.parametrize(
    ("change", "words", "advice"),
    [
        (without("module_3_x"), "`modules` is 3, but the recording has no module_3_x", "record"),
        (stated(modules=2), "`modules` is 2, but there are signals of more: module_3_x", "correct"),
        (stated(modules=2.5), "`modules` is 2.5, must be a whole number", "correct"),
        (stated(modules=9), "`modules` is 9, must be 1 to 8", "correct"),
        (without("module_3_left_speed"), "`motors` is 4, but the recording has the speeds of 3",
         "record"),
        (undriven, "`motors` is 0: no module is driven", "speeds and torques"),
        (nameless, "'hinge_distance' is not known", "identify: constants"),
        (stated(gear_ratio=20.0), "times as far as its wheels turn", "gear_ratio"),
        (stated(module_2_body_mass=-1.0), "module_2_body_mass is -1, must be a positive", "--set"),
    ],
)  # fmt: skip
def test_plan_that_contradicts_recording_is_refused(
    sensed: Recorded, change: Callable[[Recorded], None], words: str, advice: str, tmp_path: Path
) -> None:
    content = deepcopy(sensed)
    change(content)
    with pytest.raises(DataError, match=re.escape(words)) as caught:
        identified(content, tmp_path)
    assert advice in f"{caught.value.hint}"
    assert "run.mcap" in caught.value.message or "camera" in caught.value.message


def test_marker_that_is_rarely_seen_is_refused(sensed: Recorded, tmp_path: Path) -> None:
    content = deepcopy(sensed)
    content.rows = {
        stream: rows[::3] if stream.name == "marker_2" else rows
        for stream, rows in content.rows.items()
    }
    with pytest.raises(DataError, match=r"shows the second marker in 3[34] % of the frames"):
        identified(content, tmp_path)


@pytest.fixture(scope="module")
def fresh(robot: Chain, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("fresh") / "run.mcap"
    return recorded(robot, FEW, noise_seed=1).write(path)


def tried(robot: Chain, recording: Path, folder: Path, **changes: float) -> GroupValidation:
    """Return the verdict on the true contacts, known to 1 %, each times its change."""
    units = {"k_lon": "N s/m", "k_lat": "N s/m", "k_roll": "m"}
    parameters = {
        name: {
            "estimate": value * changes.get(name, 1.0), "unit": units[name[:-2]],
            "low": value * changes.get(name, 1.0) * 0.99,
            "high": value * changes.get(name, 1.0) * 1.01,
        }
        for name, value in robot.truth.items()
    }  # fmt: skip
    path = folder / "model.json"
    path.write_text(json.dumps({"model": "articulated-chain", "parameters": parameters}), "utf-8")
    (group,) = validate(path, [recording]).result.groups
    return group


def test_true_contacts_are_confirmed(robot: Chain, fresh: Path, tmp_path: Path) -> None:
    group = tried(robot, fresh, tmp_path)
    assert group.outcome is ModelOutcome.CONFIRMED, (group.sentence, group.findings)
    assert len(group.trials) == len(FEW)


@pytest.mark.parametrize("name", ["k_lon_3", "k_lat_2", "k_roll_1"])
def test_contact_of_a_module_off_is_named(
    robot: Chain, fresh: Path, name: str, tmp_path: Path
) -> None:
    group = tried(robot, fresh, tmp_path, **{name: 1.1})
    assert group.outcome is ModelOutcome.REJECTED
    assert f"{name} would have to be -" in " ".join([group.sentence, *group.findings])


def test_model_of_other_modules_is_refused(fresh: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="recordings are of 3 modules, of which 1, 3 drive"):
        tried(drawn(0, ("all", "none")), fresh, tmp_path)


def test_analysis_keeps_every_rule(tmp_path: Path) -> None:
    alone, trials = drawn(1, ("all",)), []
    for number, trial in enumerate(GENTLE[:2]):
        t_s, *parts = (part[::5] for part in played(alone, trial, None))
        noise = np.array([0.3, 0.3, 1e-3, 1e-3, 2e-3, 2e-3, 8.7e-3])
        random = np.random.default_rng(number)
        rows = np.column_stack(parts) + noise * random.standard_normal((len(t_s), len(noise)))
        signals = dict(zip(SIGNALS, rows.T, strict=True))
        trials.append(SimulatedTrial(t_s, signals))
    constants = {**alone.true, "body_mass": alone.masses[0], "gear_ratio": GEAR, "modules": 1.0,
                 "motors": 2.0, "certain_grip": 0.7}  # fmt: skip
    case = Case(trials, constants, {}, ("k_lat_1",))
    check_analysis(ChainAnalysis, [case], tmp_path, only=FEW_EVALUATIONS)
