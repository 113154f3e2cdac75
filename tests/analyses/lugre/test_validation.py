"""A model of friction is confirmed or rejected by trials of an independent simulator."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.cases import some
from support.lugre.bench import Floor, known_rig

from rigd.analysis.result import FloatArray, TrialRejection
from rigd.analysis.validation.result import GroupValidation, ModelOutcome, pooled
from rigd.analysis.validation.saved_models import SavedModel
from rigd_analyses.lugre.trials.known_constants import Known, RigConstants
from rigd_analyses.lugre.trials.trial import LugreTrial
from rigd_analyses.lugre.validation.friction import Friction
from rigd_analyses.lugre.validation.judge import judged
from rigd_analyses.lugre.validation.motion import DrivenMotion, driven_motion
from rigd_analyses.lugre.validation.paper import (
    CURRENTS_A,
    FLOORS,
    MASSES_KG,
    published_speed_rms,
)
from rigd_analyses.lugre.validation.validate import shared_out

Bench = Callable[..., Any]
Spoil = Callable[[LugreTrial], LugreTrial]
CURRENTS = (0.45, 0.9, 1.5)
MASSES = (3.9593, 1.9593)
#: Acceptance of lugre.md section 7, item 6, in m/s.
SPEED_RMS, SLIP_RMS, WRONG_SLIP_RMS = 0.005, 0.002, 0.004


def friction(floor: Floor, u: float = 0.002) -> Friction:
    """Return the true friction, each parameter with the relative uncertainty ``u``."""
    ratio = math.log(floor.mu_s / floor.mu_c)
    theta = np.array([floor.v_s, floor.mu_c, ratio, floor.s0, floor.s1, floor.s2])
    return Friction(theta, np.diag(u * theta), np.zeros((0, 6)), (0.002, 0.12), uncertain=True)


def motions(
    bench: Bench,
    floor: str,
    spoil: Spoil = lambda trial: trial,
    *,
    masses: tuple[float, ...] = MASSES,
    currents: tuple[float, ...] = CURRENTS,
    changed: Callable[[RigConstants], RigConstants] = lambda rig: rig,
    seed: int = 1,
) -> list[DrivenMotion]:
    """Return trials of ``floor``, each spoilt, with constants that a rig file states."""
    found = []
    for mass in masses:
        rig = bench(floor, mass)
        for trial in rig.sweep(seed, currents):
            conditions = {"floor": floor, "mass": f"{mass} kg", "current": trial.label}
            stated = changed(known_rig(rig.constants))
            motion = driven_motion(spoil(trial), stated, conditions)
            assert isinstance(motion, DrivenMotion)
            found.append(motion)
    return found


def verdict(trials: list[DrivenMotion], model: Friction) -> GroupValidation:
    return judged("trials", "model", trials, model, (), ())


def rms(group: GroupValidation, output: str) -> float:
    return pooled([trial.deviation(output) for trial in group.trials]).rms


def shifted(amperes: float) -> Spoil:
    return lambda trial: replace(trial, motor_current_a=trial.motor_current_a + amperes)


@pytest.mark.parametrize("floor", FLOORS)
def test_right_floor_is_confirmed(floor: str, bench: Bench) -> None:
    group = verdict(motions(bench, floor), friction(bench(floor).truth))
    assert group.outcome is ModelOutcome.CONFIRMED, group.sentence
    assert group.biases == ()
    for trial in group.trials:
        assert trial.deviation("speed").rms < SPEED_RMS
        assert trial.deviation("slip").rms < SLIP_RMS


@pytest.mark.parametrize(
    ("model", "floor"), some([(a, b) for a in FLOORS for b in FLOORS if a != b], 3)
)
def test_wrong_floor_is_rejected_in_every_trial(model: str, floor: str, bench: Bench) -> None:
    group = verdict(motions(bench, floor), friction(bench(model).truth))
    assert group.outcome is ModelOutcome.REJECTED
    assert "No constant explains it" in group.sentence
    for trial in group.trials:
        slip = trial.deviation("slip")
        assert slip.limit is not None
        assert slip.rms > max(slip.limit, WRONG_SLIP_RMS)


def test_single_trial_reveals_a_wrong_floor(bench: Bench) -> None:
    trials = motions(bench, "stone", masses=(3.9593,), currents=(0.9,))
    assert verdict(trials, friction(bench("pvc").truth)).outcome is ModelOutcome.REJECTED
    assert verdict(trials, friction(bench("stone").truth)).outcome is ModelOutcome.CONFIRMED


@pytest.mark.parametrize("share", some([-0.01, 0.01, 0.02, 0.03], 2))
def test_torque_constant_that_is_off_is_named(share: float, bench: Bench) -> None:
    def off(rig: RigConstants) -> RigConstants:
        return replace(rig, torque_constant=Known(0.0295 * (1.0 + share), 3e-4))

    group = verdict(motions(bench, "stone", changed=off), friction(bench("stone").truth))
    assert group.outcome is ModelOutcome.CORRECTED
    (bias,) = group.biases
    assert bias.name == "torque_constant"
    assert bias.value == pytest.approx(0.0295, rel=3e-3)
    assert "torque_constant would have to be 29.4" in group.sentence
    assert rms(group, "speed") < SPEED_RMS
    stated = pooled([trial.deviation("speed") for trial in group.trials]).stated
    assert stated > 2.0 * SPEED_RMS


@pytest.mark.parametrize(
    ("floor", "offset_a"),
    some([(floor, a) for floor in ("stone", "pvc") for a in (-0.01, -0.005, 0.005, 0.01)], 3),
)
def test_zero_of_the_current_is_named(floor: str, offset_a: float, bench: Bench) -> None:
    group = verdict(motions(bench, floor, shifted(offset_a)), friction(bench(floor).truth))
    assert group.outcome is ModelOutcome.CORRECTED
    (bias,) = group.biases
    assert bias.name == "current_zero"
    assert bias.value == pytest.approx(offset_a, abs=1e-3)
    assert "The current's zero would have to be" in group.sentence
    assert "at rest the monitor shows" in group.sentence
    assert rms(group, "slip") < SLIP_RMS


def test_gain_and_zero_together_are_both_named(bench: Bench) -> None:
    def off(rig: RigConstants) -> RigConstants:
        return replace(rig, torque_constant=Known(0.0295 * 1.02, 3e-4))

    group = verdict(motions(bench, "pvc", shifted(0.01), changed=off), friction(bench("pvc").truth))
    assert {item.name for item in group.biases} == {"torque_constant", "current_zero"}
    assert group.outcome is ModelOutcome.CORRECTED


def test_zero_of_a_current_may_be_a_resistance(bench: Bench) -> None:
    group = verdict(motions(bench, "stone", shifted(0.005)), friction(bench("stone").truth))
    (said,) = [item for item in group.findings if item.startswith("The motion cannot separate it")]
    assert "no_load_torque" in said


def test_wheel_radius_within_its_uncertainty_is_named(bench: Bench) -> None:
    def off(rig: RigConstants) -> RigConstants:
        return replace(rig, wheel_radius=Known(0.0501, 1e-4))

    group = verdict(motions(bench, "stone", changed=off), friction(bench("stone").truth))
    assert group.outcome is ModelOutcome.CORRECTED
    assert [item.name for item in group.biases] == ["wheel_radius"]
    assert group.biases[0].value == pytest.approx(50.0, abs=0.02)  # mm


def sample_late(values: FloatArray) -> FloatArray:
    return np.append(values[:1], values[:-1])


def late_wheel(trial: LugreTrial) -> LugreTrial:
    return replace(trial, wheel_angle_rad=sample_late(trial.wheel_angle_rad))


def late_carriage(trial: LugreTrial) -> LugreTrial:
    return replace(trial, carriage_position_m=sample_late(trial.carriage_position_m))


@pytest.mark.parametrize(
    ("late", "name"), [(late_wheel, "wheel_delay"), (late_carriage, "carriage_delay")]
)
def test_late_encoder_is_named(late: Spoil, name: str, bench: Bench) -> None:
    group = verdict(motions(bench, "stone", late), friction(bench("stone").truth))
    assert group.outcome is ModelOutcome.CORRECTED
    (bias,) = group.biases
    assert bias.name == name
    assert bias.value == pytest.approx(1e-3, abs=2e-4)


def test_gross_error_of_the_drive_rejects(bench: Bench) -> None:
    group = verdict(
        motions(
            bench, "stone",
            changed=lambda rig: replace(rig, torque_constant=Known(0.0295 * 2.0, 3e-4)),
        ),
        friction(bench("stone").truth),
    )  # fmt: skip
    assert group.outcome is ModelOutcome.REJECTED
    assert "constants of the recording contradict its motion" in group.sentence


def test_implausible_constant_is_a_suspect_only(bench: Bench) -> None:
    def forgotten(rig: RigConstants) -> RigConstants:
        return replace(rig, rolling_resistance=Known(0.011, 0.002))  # half of what PVC has

    group = verdict(motions(bench, "pvc", changed=forgotten), friction(bench("pvc").truth))
    assert group.outcome is ModelOutcome.REJECTED
    assert "would be explained if this were so" in group.sentence
    assert "rolling_resistance would have to be 0.02" in group.sentence


def test_uncertain_model_is_not_tested(bench: Bench) -> None:
    model = friction(bench("stone").truth, u=0.5)
    group = verdict(motions(bench, "stone"), model)
    assert group.outcome is ModelOutcome.UNTESTED
    assert "cannot decide" in group.sentence


def test_trial_that_does_not_move_is_left_out(bench: Bench) -> None:
    rig = bench("pvc")
    found = driven_motion(rig.trial(0.15, 1), known_rig(rig.constants), {})
    assert isinstance(found, TrialRejection)
    assert "moved" in found.reason


def test_noise_of_coarse_counts_is_not_underestimated(bench: Bench) -> None:
    """A median of differences of rounded values gave limits that are 1.9 times the error."""

    def coarse(trial: LugreTrial) -> LugreTrial:
        return replace(trial, carriage_position_m=1e-3 * np.round(1e3 * trial.carriage_position_m))

    group = verdict(motions(bench, "stone", coarse), friction(bench("stone").truth))
    for trial in group.trials:
        slip = trial.deviation("slip")
        assert slip.limit is not None
        assert 2.2 * slip.rms < slip.limit < 4.0 * slip.rms


def test_table_of_the_paper_has_72_cells() -> None:
    cells = [
        published_speed_rms(floor, mass, current)
        for floor in FLOORS
        for mass in MASSES_KG
        for current in CURRENTS_A
    ]
    values = np.array(cells, dtype=np.float64)
    assert values.size == 72
    # lugre.md section 0, item 1: median 0.0175, greatest 0.038.
    assert float(np.median(values)) == pytest.approx(0.0175)
    assert float(values.max()) == pytest.approx(0.038)
    assert published_speed_rms("stone", 3.9593, 0.45) == 0.024
    assert published_speed_rms("paperboard", 1.9593, 1.5) == 0.015
    assert published_speed_rms("wood", 3.9593, 0.45) is None
    assert published_speed_rms("stone", 3.5, 0.45) is None
    assert published_speed_rms("stone", 3.9593, 0.5) is None


def test_unusable_trial_is_left_out_of_its_model() -> None:
    stone, pvc = (
        SavedModel(Path("models.json"), "", "lugre", floor, {"floor": floor}, {}, ())
        for floor in ("stone", "pvc")
    )
    lost, other = TrialRejection("0.6 A", "samples lost"), TrialRejection("0.9 A", "samples late")
    conditions = [{"floor": "pvc"}, {"floor": "ice"}]
    assert shared_out([stone, pvc], conditions, [lost, other]) == [[other], [lost, other]]
