"""The paper's pipeline on the golden runs, to the tolerances of its acceptance target 1."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from rigd_analyses.approach_angle.paper import Ends, PaperRun, PaperSettings, analyse_paper
from rigd_analyses.approach_angle.raw.good_run_limits import Limits
from rigd_analyses.approach_angle.raw.run_data import (
    AngleCalibration,
    AngleRig,
    AngleRun,
    Regime,
    Severity,
)

RUNS = ("r0", "r2", "r3", "r5")
#: The golden records begin at the command, as the paper's do.
AS_PUBLISHED = PaperSettings(limits=Limits(pre_trigger_s=0.0))
NUMBERS = (
    "torque_nm", "mu", "slip", "slip_corrected", "relative_speed",
    "sigma_s", "h", "p", "t_steady_s",
)  # fmt: skip

Golden = Callable[[str], Any]
Analyse = Callable[..., PaperRun]


@pytest.fixture
def analyse(calibration: AngleCalibration, rig: AngleRig) -> Analyse:
    def run(run: AngleRun, settings: PaperSettings | None = None) -> PaperRun:
        return analyse_paper(run, calibration, rig, settings)

    return run


def numbers(found: PaperRun) -> list[float]:
    return [getattr(found, name) for name in NUMBERS]


def codes(found: PaperRun) -> set[str]:
    return {flag.code for flag in found.flags}


@pytest.mark.parametrize("name", RUNS)
def test_golden_runs_give_the_printed_results(name: str, golden: Golden, analyse: Analyse) -> None:
    expected = golden(name).expected
    found = analyse(golden(name).run, AS_PUBLISHED)
    assert found.mu == pytest.approx(expected["mu"], rel=1e-4)
    assert found.torque_nm == pytest.approx(expected["T"], rel=1e-4)
    assert found.h == pytest.approx(expected["h"], rel=1e-4)
    assert found.p == pytest.approx(expected["p"], abs=1e-4)
    assert found.sigma_s == pytest.approx(expected["sigma"], abs=1e-4)
    assert found.t_steady_s == pytest.approx(expected["t_s"], abs=1e-4)
    assert found.slip == pytest.approx(expected["s"], abs=1e-4)
    assert found.slip_corrected == pytest.approx(expected["s_corr"], abs=1e-4)
    assert found.relative_speed == pytest.approx(expected["r"], abs=1e-4)
    assert not found.excluded


@pytest.mark.parametrize("name", RUNS)
def test_only_samples_from_command_to_stop_count(
    name: str, golden: Golden, analyse: Analyse
) -> None:
    alone, whole = analyse(golden(name).run, AS_PUBLISHED), analyse(golden(name).whole)
    # The times differ in their last bits, which the nearly dependent basis makes 1e-6 of.
    np.testing.assert_allclose(numbers(whole), numbers(alone), rtol=2e-5)
    assert whole.regime is alone.regime


@pytest.mark.parametrize(
    ("name", "regime", "note"),
    [
        ("r0", Regime.SLIDING, set()),
        ("r2", Regime.SLIDING, set()),
        ("r3", Regime.MIXED, {"partly_sliding"}),
        ("r5", Regime.ROLLING, {"no_sliding"}),
    ],
)
def test_only_a_sliding_run_has_a_friction_coefficient(
    name: str, regime: Regime, note: set[str], golden: Golden, analyse: Analyse
) -> None:
    found = analyse(golden(name).whole)
    assert found.regime is regime
    assert codes(found) == note
    assert all(flag.severity is Severity.NOTE for flag in found.flags)
    assert math.isfinite(found.mu)
    assert math.isfinite(found.friction_coefficient) == (regime is Regime.SLIDING)


def test_the_scale_is_corrected_by_its_calibration(
    golden: Golden, calibration: AngleCalibration, rig: AngleRig
) -> None:
    heavier = replace(calibration, load=replace(calibration.load, value=1.01))
    plain = analyse_paper(golden("r2").whole, calibration, rig)
    assert analyse_paper(golden("r2").whole, heavier, rig).mu == pytest.approx(plain.mu / 1.01)


def test_curves_belong_together_in_time(golden: Golden, analyse: Analyse) -> None:
    run = golden("r3").whole
    curves = analyse(run).curves
    assert curves is not None
    groups = {
        "t_s": ("gauge_a_v", "gauge_b_v", "fourier_a_v", "fourier_b_v", "torque_nm",
                "platform_raw_m", "rim_raw_m"),
        "gaussian_t_s": ("gaussian_nm",),
        "position_t_s": ("platform_m", "rim_m"),
        "speed_t_s": ("platform_speed_m_s", "rim_speed_m_s"),
    }  # fmt: skip
    assert {f.name for f in fields(curves)} == set(groups).union(*groups.values())
    for times, signals in groups.items():
        assert {getattr(curves, s).shape for s in signals} == {getattr(curves, times).shape}
    assert curves.t_s.size - curves.speed_t_s.size == 310
    # Smoothed positions lie on the raw ones, and their slope is the speed: no shift in time.
    raw = np.interp(curves.position_t_s, curves.t_s, curves.platform_raw_m)
    assert np.sqrt(np.mean((curves.platform_m - raw) ** 2)) < 1e-3
    between = np.diff(np.interp(curves.speed_t_s, curves.position_t_s, curves.platform_m))
    speed = between * 9600.0
    assert np.sqrt(np.mean((speed - curves.platform_speed_m_s[1:]) ** 2)) < 0.03
    assert curves.gaussian_nm.max() == pytest.approx(curves.torque_nm.max(), rel=1e-9)


def test_padding_at_ends_loses_speed_unlike_line(golden: Golden, analyse: Analyse) -> None:
    """Why the paper takes the line off: with odd padding V sags by several per cent at the end."""

    def last_speed(ends: Ends) -> float:
        curves = analyse(golden("r3").run, replace(AS_PUBLISHED, ends=ends)).curves
        assert curves is not None
        return float(np.mean(curves.platform_speed_m_s[-200:]))

    assert last_speed(Ends.FILTFILT) / last_speed(Ends.ZERO) - 1.0 == pytest.approx(-0.04, abs=0.03)


def with_torque(run: AngleRun, torque_nm: Callable[[Any], Any], scale: float) -> AngleRun:
    """Return ``run`` with gauges that show ``torque_nm`` of the time from the command on."""
    half = np.where(run.t_s < 0.0, 0.0, torque_nm(np.maximum(run.t_s, 0.0))) / (2.0 * scale)
    noise = 0.016 * np.random.default_rng(2).standard_normal((2, run.t_s.size))
    return replace(run, gauge_a_v=half + noise[0], gauge_b_v=-half + noise[1])


@pytest.mark.parametrize(
    ("shape", "code"),
    [
        (lambda t: 1.0 - t, "peak_at_edge"),
        (lambda t: 0.3 + 2.0 * t, "peak_at_edge"),
        (lambda t: 0.5 + np.exp(-0.5 * ((t - 0.4) / 0.04) ** 2), "steady_short"),
    ],
    ids=["falls from the start", "rises to the end", "peak late"],
)
def test_no_steady_torque_without_a_peak_before_it(
    shape: Callable[[Any], Any], code: str, golden: Golden, analyse: Analyse,
    calibration: AngleCalibration,
) -> None:  # fmt: skip
    found = analyse(with_torque(golden("r2").whole, shape, calibration.torque.value))
    assert code in codes(found)
    assert found.excluded
    assert np.all(np.isnan(numbers(found)))
    assert found.regime is None
    assert found.curves is not None  # so that a report can show what was wrong
    assert all("record" in flag.reason for flag in found.flags)


def test_returning_platform_has_no_slip(golden: Golden, analyse: Analyse) -> None:
    run = golden("r5").whole
    turning = np.interp(0.04, run.t_s, run.platform_v)
    back = turning - 0.15 * (run.platform_v - turning)
    found = analyse(replace(run, platform_v=np.where(run.t_s > 0.04, back, run.platform_v)))
    assert "no_speed" in codes(found)
    assert np.all(np.isnan(numbers(found)))


def test_paper_method_refuses_slow_record(golden: Golden, analyse: Analyse) -> None:
    run = golden("r2").whole
    thin = {
        name: getattr(run, name)[::40]
        for name in ("t_s", "gauge_a_v", "gauge_b_v", "wheel_v", "platform_v")
    }
    assert round(1.0 / np.diff(thin["t_s"])[0]) == 240
    found = analyse(replace(run, **thin))
    assert codes(found) == {"too_slow"}
    assert np.all(np.isnan(numbers(found)))


@pytest.mark.parametrize(
    "signals",
    [
        np.empty(0),
        np.zeros(1),
        np.zeros(6000),
        np.full(6000, np.nan),
        np.full(6000, 1e30),
        np.where(np.arange(6000) == 3000, np.inf, 0.0),
    ],
    ids=["nothing", "one sample", "zeros", "NaN", "huge", "one infinity"],
)
@pytest.mark.parametrize("backwards", [False, True])
def test_no_run_is_so_bad_that_it_raises(
    signals: Any, backwards: bool, golden: Golden, analyse: Analyse
) -> None:
    t_s = np.arange(signals.size) / 9600.0 - 0.1
    found = analyse(
        replace(
            golden("r0").run, t_s=t_s[::-1] if backwards else t_s,
            gauge_a_v=signals, gauge_b_v=-signals, wheel_v=signals, platform_v=signals,
            stop_s=0.4, load_n=float("nan"),
        )
    )  # fmt: skip
    assert found.excluded
    assert np.all(np.isnan(numbers(found)))
    assert all(flag.reason.endswith(".") for flag in found.flags)


@pytest.mark.parametrize(
    "options", [{"averages": (5, 10)}, {"averages": (5, 11)}, {"averages": (4,) * 7}]
)
def test_settings_with_time_shift_or_mismatch_are_refused(options: Any) -> None:
    with pytest.raises(ValueError, match=r"iteration|odd"):
        PaperSettings(**options)
