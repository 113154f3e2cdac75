"""Every guard of method A, by what goes wrong without it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from rigd.analysis.result import TrialRejection
from rigd.model.errors import DataError
from rigd_analyses.lugre.trials.slip_and_traction import (
    Guards,
    ProcessedTrial,
    process,
    process_trial,
)
from rigd_analyses.lugre.trials.trial import LugreConstants

CURRENTS = (0.6, 1.05, 1.5)


@pytest.fixture(scope="module")
def pvc(bench: Callable[..., Any]) -> Any:
    return bench("pvc")


def test_slip_force_and_bias_are_those_of_rig(bench: Callable[..., Any]) -> None:
    rig = bench("pvc")
    clean = replace(rig, noisy=False).trial(1.05, 1)
    processed = process_trial(rig.trial(1.05, 1), rig.constants, Guards())
    assert isinstance(processed, ProcessedTrial)
    assert processed.acceleration_bias_m_s2 == pytest.approx(0.02, abs=0.006)
    used = processed.samples.mask > 0.0
    n = len(used)
    rim = 0.05 * np.gradient(clean.wheel_angle_rad, clean.t_s)
    speed = np.gradient(clean.carriage_position_m, clean.t_s)
    slip_error = processed.samples.slip_m_s - (rim - speed)[:n]
    assert np.std(slip_error[used]) < 1.5e-3
    assert abs(np.mean(slip_error[used])) < 2e-4
    force = rig.mass_kg * clean.acceleration_m_s2 + rig.constants.resistance_n
    force_error = processed.traction_n - force[:n]
    assert abs(np.mean(force_error[used])) < 0.04


def test_drive_is_found_and_later_samples_are_excluded(pvc: Any) -> None:
    trial = pvc.trial(1.05, 1)
    processed = process_trial(trial, pvc.constants, Guards())
    assert isinstance(processed, ProcessedTrial)
    assert trial.t_s[processed.drive.start] == pytest.approx(0.35, abs=2e-3)
    braking = trial.t_s[np.argmax(trial.carriage_position_m > 1.15)]
    assert processed.t_s[-1] == pytest.approx(braking, abs=5e-3)
    assert processed.t_s[-1] <= braking + 1e-3


def test_the_mask_keeps_off_steps_and_standstill(pvc: Any) -> None:
    guards = Guards()
    processed = process_trial(pvc.trial(0.6, 1), pvc.constants, guards)
    assert isinstance(processed, ProcessedTrial)
    used = np.flatnonzero(processed.samples.mask)
    assert used[0] >= processed.drive.start + 16
    assert used[-1] <= processed.drive.end - 16
    assert np.min(processed.carriage_speed_m_s[used]) >= guards.min_speed_m_s
    assert np.all(processed.samples.slip_m_s[: processed.drive.start + 1] == 0.0)


def test_trial_without_motion_is_excluded_with_its_reason(pvc: Any) -> None:
    sweep = process(pvc.sweep(1, (0.15, *CURRENTS)), pvc.constants)
    assert [t.current_a for t in sweep.trials] == list(CURRENTS)
    assert [r.label for r in sweep.account.rejected] == ["0.15 A"]
    assert "moved" in sweep.account.rejected[0].reason


def test_driving_backwards_is_the_mirror_image(pvc: Any) -> None:
    forward = pvc.trial(1.05, 1)
    backward = replace(
        forward,
        current_a=-forward.current_a,
        wheel_angle_rad=-forward.wheel_angle_rad,
        carriage_position_m=-forward.carriage_position_m,
        acceleration_m_s2=-forward.acceleration_m_s2,
        motor_current_a=-forward.motor_current_a,
    )
    found = process_trial(forward, pvc.constants, Guards())
    two = process_trial(backward, pvc.constants, Guards())
    assert isinstance(found, ProcessedTrial) and isinstance(two, ProcessedTrial)
    np.testing.assert_allclose(found.samples.slip_m_s, two.samples.slip_m_s, atol=1e-12)
    np.testing.assert_allclose(found.samples.force, two.samples.force, atol=1e-12)


def test_another_sampling_rate_keeps_the_window_in_time(bench: Callable[..., Any]) -> None:
    rig = bench("pvc", dt_s=5e-4)
    processed = process_trial(rig.trial(1.05, 1), rig.constants, Guards())
    assert isinstance(processed, ProcessedTrial)
    assert processed.samples.period_s == pytest.approx(5e-4)
    assert processed.acceleration_bias_m_s2 == pytest.approx(0.02, abs=0.006)
    with pytest.raises(DataError, match="window of 31 ms holds 1 samples"):
        slow = rig.trial(1.05, 1)
        every = slice(None, None, 80)
        process_trial(
            replace(
                slow,
                t_s=np.arange(200) * 0.04,
                **{
                    name: np.resize(getattr(slow, name)[every], 200)
                    for name in (
                        "wheel_angle_rad",
                        "carriage_position_m",
                        "acceleration_m_s2",
                        "motor_current_a",
                    )
                },
            ),
            rig.constants,
            Guards(),
        )


@pytest.mark.parametrize("channel", ["wheel_angle_rad", "carriage_position_m"])
def test_a_reversed_encoder_is_refused_with_the_reason(pvc: Any, channel: str) -> None:
    trials = [replace(t, **{channel: -getattr(t, channel)}) for t in pvc.sweep(1, CURRENTS)]
    with pytest.raises(DataError, match="wiring"):
        process(trials, pvc.constants)


def test_a_reversed_accelerometer_is_refused(pvc: Any) -> None:
    trials = [replace(t, acceleration_m_s2=-t.acceleration_m_s2) for t in pvc.sweep(1, CURRENTS)]
    with pytest.raises(DataError, match="slip and traction run against each other"):
        process(trials, pvc.constants)


def test_a_reversed_current_monitor_is_refused(pvc: Any) -> None:
    trial = replace(pvc.trial(1.05, 1), motor_current_a=-pvc.trial(1.05, 1).motor_current_a)
    with pytest.raises(DataError, match="monitor's sign is reversed"):
        process_trial(trial, pvc.constants, Guards())


def test_samples_that_are_not_numbers_are_refused(pvc: Any) -> None:
    trial = pvc.trial(1.05, 1)
    spoiled = trial.carriage_position_m.copy()
    spoiled[700:703] = np.nan
    with pytest.raises(DataError, match=r"carriage position .* index 700"):
        process_trial(replace(trial, carriage_position_m=spoiled), pvc.constants, Guards())


def test_readings_beyond_any_sensor_are_refused(pvc: Any) -> None:
    trial = pvc.trial(1.05, 1)
    for name in ("wheel_angle_rad", "carriage_position_m"):
        spoilt = replace(trial, **{name: getattr(trial, name) + 1e300})
        with pytest.raises(DataError, match=r"reads up to 1e\+300, limit 1e\+06"):
            process_trial(spoilt, pvc.constants, Guards())


def test_a_constant_channel_is_refused(pvc: Any) -> None:
    trial = pvc.trial(1.05, 1)
    dead = np.full_like(trial.t_s, 0.02)
    with pytest.raises(DataError, match=r"acceleration is 0\.02 in all"):
        process_trial(replace(trial, acceleration_m_s2=dead), pvc.constants, Guards())


def test_gap_in_clock_and_unequal_arrays_are_refused(pvc: Any) -> None:
    trial = pvc.trial(1.05, 1)
    late = trial.t_s.copy()
    late[500:] += 0.004
    with pytest.raises(DataError, match="4 ms off the period of 1 ms"):
        process_trial(replace(trial, t_s=late), pvc.constants, Guards())
    with pytest.raises(DataError, match="motor current has shape"):
        process_trial(
            replace(trial, motor_current_a=trial.motor_current_a[1:]), pvc.constants, Guards()
        )


def test_no_rest_and_no_step_are_refused(pvc: Any) -> None:
    trial = pvc.trial(1.05, 1)
    cut = {
        name: getattr(trial, name)[300:]
        for name in (
            "t_s",
            "wheel_angle_rad",
            "carriage_position_m",
            "acceleration_m_s2",
            "motor_current_a",
        )
    }
    with pytest.raises(DataError, match="of rest before the current step"):
        process_trial(replace(trial, **cut), pvc.constants, Guards())
    with pytest.raises(DataError, match="no step to 3 A"):
        process_trial(replace(trial, current_a=3.0), pvc.constants, Guards())


def test_too_few_trials_are_refused(pvc: Any) -> None:
    with pytest.raises(DataError, match=r"1 of 2 trials .*at least 3"):
        process(pvc.sweep(1, (0.15, 1.05)), pvc.constants)


def test_trial_without_motion_is_rejected_without_a_number(bench: Callable[..., Any]) -> None:
    rig = bench("pvc")
    outcome = process_trial(rig.trial(0.15, 1), rig.constants, Guards())
    assert isinstance(outcome, TrialRejection)


def test_constants_are_checked_and_scale_with_the_mass() -> None:
    constants = LugreConstants(3.9593, 0.05, 0.304, 0.009)
    assert constants.for_mass(3.9593 / 2).guide_friction_n == pytest.approx(0.152)
    assert constants.resistance_n == pytest.approx(0.304 + 0.009 * 3.9593 * 9.81)
    with pytest.raises(DataError, match="mass_kg is -1"):
        LugreConstants(-1.0, 0.05, 0.304, 0.009)
    with pytest.raises(DataError, match="rolling_resistance is nan"):
        LugreConstants(1.0, 0.05, 0.304, float("nan"))
