"""Trials that are all the same test give no number: one motion has many explanations."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from support.lugre.wrong import CONSTANT, Program, right

from rigd.analysis import DataError
from rigd_analyses.lugre.rig.family import fit_group
from rigd_analyses.lugre.rig.parts import sort_out
from rigd_analyses.lugre.slip_force.identify import Settings
from rigd_analyses.lugre.trials.identical_trials import refuse_alike
from rigd_analyses.lugre.trials.slip_and_traction import process


@pytest.mark.parametrize(
    ("floor", "current"), [("stone", 0.25), ("pvc", 0.45), ("paperboard", 0.75), ("stone", 1.5)]
)
def test_three_trials_of_one_current_are_refused(floor: str, current: float) -> None:
    """Of 14 such data sets 7 gave intervals that do not hold the truth, sigma_2 20 % off."""
    world = right(floor, program=(((current, 3.0),),) * 3)
    with pytest.raises(DataError, match="all 3 trials are the same test: their currents differ by"):
        fit_group(world.trials(1), world.constants, world.rig)


def test_one_current_in_many_trials_is_refused() -> None:
    world = right("pvc", program=(((1.2, 3.0),),) * 10)
    with pytest.raises(DataError, match="all 10 trials are the same test"):
        fit_group(world.trials(2), world.constants, world.rig)


@pytest.mark.parametrize("current", [0.25, 0.75])
def test_slip_force_refuses_trials_of_one_current(current: float) -> None:
    """On stone they gave mu_c 64 %, or sigma_2 65 % too low, within 6 % and 18 %."""
    world = right("stone", program=(((current, 3.0),),) * 3)
    with pytest.raises(DataError, match="all 3 trials are the same test"):
        process(world.trials(1), world.constants)


@pytest.mark.parametrize(
    ("program", "loads"),
    [
        (CONSTANT[2:5], (1.0, 1.0, 1.0)),
        ((((0.45, 3.0),), ((0.45, 3.0),), ((0.5, 3.0),)), (1.0, 1.0, 1.0)),
        ((((0.75, 3.0),),) * 3, (1.0, 1.0, 0.8)),
        ((((0.75, 3.0),), ((0.75, 0.5), (-0.75, 0.5)), ((0.75, 3.0),)), (1.0, 1.0, 1.0)),
    ],
    ids=["currents", "one current", "masses", "braking"],
)
def test_trials_that_differ_are_not_alike(program: Program, loads: Any) -> None:
    trials = right("stone", program=program).trials(1)
    trials = [replace(trial, load=load) for trial, load in zip(trials, loads, strict=True)]
    parts, _ = sort_out(trials, [1e-3] * 3, Settings())
    refuse_alike(parts)
