"""Trials in which the carriage turns: what the noise of the current does to them is no misfit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from support.lugre.bench import known_rig

from rigd.analysis.output_error.whitened_residuals import noise_at
from rigd_analyses.lugre.rig.deviations import may_turn
from rigd_analyses.lugre.rig.family import rig_system
from rigd_analyses.lugre.rig.outputs import ACCELERATION
from rigd_analyses.lugre.rig.system import RigSystem

HALF_SWING_S = 1.0 / 6.0
STEP = 350  #: sample at which the current begins
BEGIN = STEP - 40
ZERO_A = 8e-4  #: 2.3 times what the mean of 340 readings at rest is uncertain by
TRUE = {"ripple_sin": 0.3, "shake_2_sin": 0.15}  #: of the bench; all other constants are as stated


def white_acceleration(bench: Callable[..., Any], zero_a: float) -> np.ndarray[Any, Any]:
    """Return the whitened residuals (n,) of swings, at the true parameters.

    The monitor's zero is off by ``zero_a`` while the current flows.
    """
    rig = bench("pvc", half_swing_s=HALF_SWING_S)
    trial = rig.trial(1.5, 1)
    monitored = trial.motor_current_a + zero_a * (np.arange(len(trial.t_s)) >= STEP)
    floor = rig.truth
    ratio = np.log(floor.mu_s / floor.mu_c)
    friction = np.array([floor.v_s, floor.mu_c, ratio, floor.s0, floor.s1, floor.s2])
    part = slice(BEGIN, len(trial.t_s) - 100)
    parts = [(replace(trial, motor_current_a=monitored), part)]
    system = rig_system(parts, known_rig(rig.constants), friction)
    theta = truth(system)
    errors = system.measured[0] - system.simulate(0, theta[: len(system.shared)], np.zeros(4))
    white = noise_at(system, theta)[0].whiten_errors(errors)
    return np.asarray(white[:, ACCELERATION])


def truth(system: RigSystem) -> np.ndarray[Any, Any]:
    """Return the true parameters, (p,): shared, then those of the trial."""
    names = [unknown.parameter.name for unknown in system.shared]
    theta = np.array([unknown.parameter.start for unknown in system.shared])
    for name, value in TRUE.items():
        theta[names.index(name)] = value
    return np.concatenate([theta, np.zeros(len(system.local))])


@pytest.mark.parametrize("zero_a", [-ZERO_A, 0.0, ZERO_A])
def test_drift_over_a_turn_is_no_jump(bench: Callable[..., Any], zero_a: float) -> None:
    white = white_acceleration(bench, zero_a)
    assert np.max(np.abs(white)) < 5.0
    assert np.mean(white**2) < 1.25  # its noise is known from 340 readings at rest


def test_only_drift_near_a_turn_hides_it() -> None:
    speed = np.array([0.0, 2e-3, 0.1, 0.0, 2e-3, 5e-2])
    drift = np.array([1e-4, 1e-4, 5e-3, 1e-3, 1e-3, 5e-3])
    assert may_turn(speed, drift).tolist() == [False, False, False, True, True, False]
