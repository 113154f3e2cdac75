"""Hum of the mains is named and taken off; what only looks like it is left alone."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from rigd_analyses.approach_angle.mains import without_mains
from rigd_analyses.approach_angle.raw.good_run_limits import Limits
from rigd_analyses.approach_angle.raw.run_data import AngleCalibration, AngleRun, FloatArray, Known

CALIBRATION = AngleCalibration(torque=Known(2.03), wheel=Known(12.57), platform=Known(0.1885))
T_S = np.arange(-0.1, 0.55, 1.0 / 9600.0)
STOP_S = 0.5


def good_run(seed: int = 1) -> AngleRun:
    """Return a run whose torque swings with the rollers, 18 a turn, of a wheel that spins up."""
    rng = np.random.default_rng(seed)
    driven = np.clip(T_S, 0.0, None)
    turned = 4.0 * driven + 30.0 * driven**2
    torque = np.where(T_S > 0.0, 0.8 + 0.1 * np.sin(18.0 * turned), 0.0)
    torque += 0.6 * np.where(T_S > 0.0, np.exp(-driven / 0.02), 0.0)
    usual = 0.006 * np.sin(2.0 * np.pi * 50.0 * T_S)
    noise = rng.standard_normal((4, T_S.size)) * np.array([[0.016], [0.016], [0.0015], [0.0015]])
    return AngleRun(
        "run", "clean_0", 0.0, 4.0, 10.0, 1, T_S, 0.5 * torque + usual + noise[0],
        -0.5 * torque + noise[1], 0.3 + turned / 12.57 + noise[2],
        0.5 + 0.5 * driven**2 / 0.1885 + noise[3], STOP_S, 40.0,
    )  # fmt: skip


def wave(hz: float, size: float, phase: float = 0.7) -> FloatArray:
    """Return a line with a third harmonic, (n,) in V."""
    at = 2.0 * np.pi * hz * T_S + phase
    return np.asarray(size * (np.sin(at) + 0.2 * np.sin(3.0 * at)))


def with_hum(run: AngleRun, name: str, hum: FloatArray) -> AngleRun:
    changed: dict[str, Any] = {name: getattr(run, name) + hum}
    return replace(run, **changed)


@pytest.mark.parametrize("hz", [49.8, 50.0, 51.0, 60.0])
@pytest.mark.parametrize(("name", "size"), [("gauge_a_v", 0.2), ("gauge_a_v", 1.0),
                                            ("wheel_v", 0.05), ("platform_v", 0.05)])  # fmt: skip
def test_hum_is_named_and_taken_off(name: str, size: float, hz: float) -> None:
    run, hum = good_run(), wave(hz, size)
    found = without_mains(with_hum(run, name, hum), CALIBRATION, Limits())
    assert [flag.code for flag in found.flags] == ["mains_hum"]
    assert f"{hz:.0f}" in found.flags[0].reason or f"{hz:.1f}" in found.flags[0].reason
    left = (getattr(found, name) - getattr(run, name))[T_S < STOP_S]
    assert np.std(left) < 0.15 * np.std(hum)


@pytest.mark.parametrize("seed", range(10))
def test_rollers_and_usual_hum_are_left(seed: int) -> None:
    run = good_run(seed)
    assert without_mains(run, CALIBRATION, Limits()) is run


@pytest.mark.parametrize("there", [T_S > 0.0, T_S < 0.0], ids=["only in the run", "only before it"])
def test_line_in_one_part_is_no_mains(there: FloatArray) -> None:
    run = with_hum(good_run(), "gauge_a_v", wave(50.0, 0.4) * there)
    assert without_mains(run, CALIBRATION, Limits()) is run


@pytest.mark.parametrize("first_s", [-0.07, -0.01, 0.05])
def test_run_without_rest_shows_no_mains(first_s: float) -> None:
    run, kept = with_hum(good_run(), "gauge_a_v", wave(50.0, 0.4)), first_s <= T_S
    names = ("t_s", "gauge_a_v", "gauge_b_v", "wheel_v", "platform_v")
    short: dict[str, Any] = {name: getattr(run, name)[kept] for name in names}
    assert not without_mains(replace(run, **short), CALIBRATION, Limits()).flags


def test_other_frequencies_and_noise_are_no_mains() -> None:
    rng = np.random.default_rng(5)
    for disturbance in (wave(35.0, 0.4), wave(75.0, 0.4), 0.3 * rng.standard_normal(T_S.size)):
        run = with_hum(good_run(), "gauge_a_v", disturbance)
        assert without_mains(run, CALIBRATION, Limits()) is run
