"""Rows that are missing, repeated or late behind regular times: found without a fit."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from support.lugre.sensors import Logger
from support.lugre.wrong import BACK, CONSTANT, World, control, right

from rigd_analyses.lugre.rig.parts import sort_out
from rigd_analyses.lugre.slip_force.identify import Settings
from rigd_analyses.lugre.trials.rows import jump
from rigd_analyses.lugre.trials.slip_and_traction import Guards, process_trial
from rigd_analyses.lugre.trials.spikes import spiky, without_spikes
from rigd_analyses.lugre.trials.trial import LugreTrial

JUMP = "both encoders jump by the way of"
FEW = (*CONSTANT[3:5], *CONSTANT[6:8])


def left_out(world: World) -> dict[str, str]:
    trials = world.trials(3)
    _, rejected = sort_out(trials, [1e-3] * len(trials), Settings())
    return {item.label: item.reason for item in rejected}


@pytest.mark.parametrize("rows", [1, 3, 30, 200])
@pytest.mark.parametrize("floor", ["stone", "pvc", "paperboard"])
def test_trial_with_rows_cut_out_is_left_out(floor: str, rows: int) -> None:
    found = left_out(right(floor, program=FEW, cut_s=1e-3 * rows))
    assert list(found) == ["2: 0.75 A"]
    assert f"{JUMP} +{rows}" in found["2: 0.75 A"]


def test_slip_force_leaves_a_cut_trial_out() -> None:
    world = right("pvc", program=FEW, cut_s=3e-3)
    outcomes = [process_trial(trial, world.constants, Guards()) for trial in world.trials(3)]
    assert [getattr(item, "reason", "")[: len(JUMP)] for item in outcomes] == ["", JUMP, "", ""]


@pytest.mark.parametrize("change", [{"burst_s": 5e-3}, {"frozen_s": 5e-3}])
def test_late_or_repeated_rows_are_told(change: Any) -> None:
    world = replace(right("pvc", program=(*FEW, FEW[0])), logger=Logger(**change))
    trials = world.trials(3)
    outcomes = [process_trial(trial, world.constants, Guards()) for trial in trials]
    assert all(JUMP in getattr(item, "reason", "") for item in outcomes)


def slower(trial: LugreTrial, every: int) -> LugreTrial:
    arrays: dict[str, Any] = {
        name: x[::every] for name, x in vars(trial).items() if isinstance(x, np.ndarray)
    }
    return replace(trial, **arrays)


@pytest.mark.parametrize("every", [2, 5, 10])
def test_braking_at_low_rate_is_no_jump(every: int) -> None:
    trials = [slower(trial, every) for trial in right("stone", program=BACK).trials(3)]
    found = [jump(trial, slice(10, len(trial.t_s) - 150 // every)) for trial in trials]
    assert found == [""] * len(trials)


@pytest.mark.parametrize(
    "world",
    [
        *(control(number) for number in range(3)),
        *(right(floor, program=BACK) for floor in ("stone", "pvc")),
        right("pvc", guide=replace(right("pvc").guide, jump=5e-3)),
        right("pvc", wheel=replace(right("pvc").wheel, repeats=0.05)),
        right("stone", knocked=20.0),
    ],
)
def test_other_motion_is_no_jump_of_rows(world: World) -> None:
    assert not any(JUMP in reason for reason in left_out(world).values())
    assert spiky([without_spikes(trial) for trial in world.trials(3)]) == []


@pytest.mark.parametrize(
    ("name", "encoder", "size", "told"),
    [
        ("wheel_angle_rad", "wheel encoder", 0.02, "0.02 rad"),
        ("carriage_position_m", "carriage encoder", 2e-3, "0.002 m"),
    ],
)
def test_single_readings_aside_are_bridged_and_told(
    name: str, encoder: str, size: float, told: str
) -> None:
    (trial, *_) = right("pvc", program=FEW).trials(3)
    values = getattr(trial, name).copy()
    values[100::500] += size
    bridged = without_spikes(replace(trial, **{name: values}))
    found = getattr(bridged, name)
    np.testing.assert_allclose(found, getattr(trial, name), atol=0.1 * size)
    np.testing.assert_array_equal(np.delete(found, np.s_[100::500]),
                                  np.delete(values, np.s_[100::500]))  # fmt: skip
    (sentence,) = spiky([bridged, trial])
    count = len(values[100::500])
    assert f"{encoder} has spikes: {count} single readings in 1 trials" in sentence
    assert f"up to {told}" in sentence
