"""The count of an encoder is found whatever was bridged, and at any rate of sampling."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from support.lugre.bench import known_rig

from rigd.analysis.result import FitOutcome, FloatArray
from rigd.record.read.resample import bridge, means_around
from rigd_analyses.lugre.rig.family import fit_group, rig_system
from rigd_analyses.lugre.rig.parts import sort_out
from rigd_analyses.lugre.slip_force.identify import Settings
from rigd_analyses.lugre.trials.resolution import Rounding, count
from rigd_analyses.lugre.trials.trial import LugreTrial

Bench = Callable[..., Any]
ANGLE = 2.0 * np.pi / (1024 * 20.25)  #: rad, of the bench
POSITION = 3.0679616e-05  #: m
STEP = 0.0119682  #: m/s^2, of its converter


@pytest.mark.parametrize("dt_s", [1e-3, 2e-3, 5e-3])
@pytest.mark.parametrize("current_a", [0.3, 0.6, 1.5])
def test_count_is_found_at_any_rate(bench: Bench, dt_s: float, current_a: float) -> None:
    trial = replace(bench("pvc"), dt_s=dt_s).trial(current_a, 1)
    assert count(trial.wheel_angle_rad) == pytest.approx(ANGLE, rel=1e-5)
    assert count(trial.carriage_position_m) == pytest.approx(POSITION, rel=1e-5)
    assert count(trial.acceleration_m_s2) == pytest.approx(STEP, rel=1e-5)


@pytest.mark.parametrize("gap", [1, 2, 5, 10])
def test_bridged_samples_do_not_change_the_count(bench: Bench, gap: int) -> None:
    trial = bench("pvc").trial(0.6, 1)
    times = np.rint(trial.t_s * 1e9).astype(np.int64)
    moved = int(np.flatnonzero(np.diff(trial.wheel_angle_rad))[0])
    keep = np.ones(len(times), dtype=np.bool_)
    keep[moved - gap + 2 : moved + 2] = False
    bridged = bridge(times, times[keep], trial.wheel_angle_rad[keep])
    assert count(bridged) == pytest.approx(ANGLE, rel=1e-5)


def test_rounding_of_arithmetic_is_no_count() -> None:
    rng = np.random.default_rng(1)
    held = 3.0 + np.repeat([0.0, ANGLE, 2 * ANGLE, 5 * ANGLE], 50)
    assert count(held + 1e-15 * rng.standard_normal(200)) == pytest.approx(ANGLE, rel=1e-5)
    assert count(np.ones(100)) == 0.0


def test_dead_wheel_encoder_is_left_out_and_named(bench: Bench) -> None:
    trials = bench("pvc").sweep(1, (0.45, 0.75, 1.05, 1.35))
    trials[1] = replace(trials[1], wheel_angle_rad=np.full_like(trials[1].t_s, 3.0))
    kept, (rejected,) = sort_out(trials, [1e-3] * 4, Settings())
    assert len(kept) == 3
    assert rejected.label == "0.75 A"
    assert "the wheel encoder shows no turn while the carriage moved" in rejected.reason


def test_coarse_accelerometer_keeps_noise_of_its_steps(bench: Bench) -> None:
    rig = bench("pvc")
    coarse = [
        replace(trial, acceleration_m_s2=np.round(trial.acceleration_m_s2 / 0.25) * 0.25)
        for trial in rig.sweep(1, (0.45, 0.75, 1.05))
    ]
    parts, _ = sort_out(coarse, [1e-3] * 3, Settings())
    system = rig_system(parts, known_rig(rig.constants), np.ones(6))
    assert system.noise.acceleration_m_s2 == pytest.approx(0.25 / np.sqrt(12.0))


def means_at_1khz(trial: LugreTrial, values: FloatArray, samples: int) -> FloatArray:
    """Return the means of ``values`` (n,) as a recording gives them: ``samples`` in each ms."""
    times = np.rint(trial.t_s * 1e9).astype(np.int64)
    return means_around(times[samples:-1:samples], times, values)


def at_1khz(trial: LugreTrial, samples: int) -> LugreTrial:
    """Return ``trial`` whose encoders are read ``samples`` times in each ms, all else once."""
    kept = slice(samples, -1, samples)
    return replace(
        trial,
        t_s=trial.t_s[kept] - trial.t_s[samples],
        wheel_angle_rad=means_at_1khz(trial, trial.wheel_angle_rad, samples),
        carriage_position_m=means_at_1khz(trial, trial.carriage_position_m, samples),
        acceleration_m_s2=trial.acceleration_m_s2[kept],
        motor_current_a=trial.motor_current_a[kept],
        wheel_encoder=Rounding(count(trial.wheel_angle_rad), samples),
        carriage_encoder=Rounding(count(trial.carriage_position_m), samples),
    )


def test_means_of_coarse_accelerometer_keep_its_noise(bench: Bench) -> None:
    rig = replace(bench("pvc"), dt_s=2.5e-4)
    coarse = []
    for trial in rig.sweep(1, (0.45, 0.75, 1.05)):
        rounded = np.round(trial.acceleration_m_s2 / 0.25) * 0.25
        means = means_at_1khz(trial, rounded, 4)
        read = Rounding(count(rounded), 4)
        coarse.append(replace(at_1khz(trial, 4), acceleration_m_s2=means, accelerometer=read))
    parts, _ = sort_out(coarse, [1e-3] * 3, Settings())
    system = rig_system(parts, known_rig(rig.constants), np.ones(6))
    assert system.noise.acceleration_m_s2 == pytest.approx(0.25 / np.sqrt(4 * 12.0))


def test_right_rig_with_fast_encoders_fits(bench: Bench) -> None:
    rig = replace(bench("pvc"), dt_s=5e-4)
    trials = [at_1khz(trial, 2) for trial in rig.sweep(1, (0.45, 0.75, 1.05, 1.35))]
    begun = fit_group(trials, rig.constants, known_rig(rig.constants))
    assert begun.gate.outcome is FitOutcome.FITS, begun.gate.sentence
