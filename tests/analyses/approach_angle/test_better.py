"""The corrected method of one run: golden runs, simulated runs, and runs spoilt on purpose."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from support.approach_angle.corrected_method import analyse_better
from support.approach_angle.headless import simulate
from support.approach_angle.plant import varied
from support.approach_angle.runs import drawn_rig, trial

from rigd_analyses.approach_angle.better.bending import Bending
from rigd_analyses.approach_angle.better.result import BetterRun
from rigd_analyses.approach_angle.better.run import _load_change
from rigd_analyses.approach_angle.better.settings import BetterSettings
from rigd_analyses.approach_angle.raw.run_data import (
    AngleCalibration,
    AngleRig,
    AngleRun,
    FloatArray,
    Known,
    Regime,
    Severity,
)

Golden = Callable[[str], Any]
FILE = Path(__file__).with_name("data") / "angle_golden.npz"
TORQUE_PER_V = 2.029  #: of the golden runs, N m


def cut(run: AngleRun, at: NDArray[np.bool_]) -> AngleRun:
    return replace(
        run, t_s=run.t_s[at], gauge_a_v=run.gauge_a_v[at], gauge_b_v=run.gauge_b_v[at],
        wheel_v=run.wheel_v[at], platform_v=run.platform_v[at],
    )  # fmt: skip


def to_stop(item: Any) -> AngleRun:
    """Return a golden run up to its stop: what stands behind it there did not happen."""
    run: AngleRun = item.whole
    return cut(run, run.t_s <= run.stop_s)


@cache
def true_mu(name: str) -> float:
    with np.load(FILE) as data:
        return float(data[f"{name}_true_mu"])


def codes(found: BetterRun) -> set[str]:
    return {flag.code for flag in found.flags}


@pytest.mark.parametrize("name", ["r0", "r2"])
def test_sliding_golden_run_beats_mu_of_the_paper(
    name: str, golden: Golden, calibration: AngleCalibration, rig: AngleRig
) -> None:
    item = golden(name)
    found = analyse_better(to_stop(item), calibration, rig)
    true = true_mu(name)
    assert found.regime is Regime.SLIDING
    assert found.mu == pytest.approx(true, rel=0.03)
    assert abs(found.mu - true) < 2.0 * found.mu_u
    assert abs(found.mu - true) < 0.3 * abs(item.expected["mu"] - true)


@pytest.mark.parametrize("name", ["r3", "r5"])
def test_barely_sliding_golden_run_has_demand_without_coefficient(
    name: str, golden: Golden, calibration: AngleCalibration, rig: AngleRig
) -> None:
    item = golden(name)
    found = analyse_better(to_stop(item), calibration, rig)
    assert math.isnan(found.mu) and math.isnan(found.mu_u) and found.budget is None
    assert codes(found) == {"no_sliding"} and not found.excluded
    assert found.demand == pytest.approx(true_mu(name), rel=0.06)
    assert found.regime is not Regime.SLIDING


@pytest.mark.parametrize("set_name", ["clean_0", "clean_30", "clean_45"])
def test_force_balance_finds_torque_lost_behind_gauges(set_name: str) -> None:
    rubbing, good = (
        trial(set_name, 4.0, 10.0, 1, 1, rig=drawn_rig(0), seed=3, rubbing_nm=rub).known
        for rub in (0.15, 0.0)
    )
    found = analyse_better(rubbing.run, rubbing.calibration, rubbing.rig)
    assert "rubbing" in codes(found) and found.excluded
    assert found.force_residual > found.force_residual_limit
    assert np.isnan([found.mu, found.mu_u, found.demand]).all()
    well = analyse_better(good.run, good.calibration, good.rig)
    assert not well.excluded
    assert abs(well.force_residual) < 0.5 * well.force_residual_limit
    half = replace(good.run, gauge_a_v=0.5 * good.run.gauge_a_v)
    lost = analyse_better(half, good.calibration, good.rig)
    assert "torque_missing" in codes(lost) and lost.force_residual < 0.0


def test_wheel_that_hops_is_named() -> None:
    done = simulate("clean_0", 4.0, 10.0, seed=3, parameters=varied(
        normal_force={"profile_rollers": 6e-4}))  # fmt: skip
    item = trial("clean_0", 4.0, 10.0, 1, 1, rig=drawn_rig(0), seed=3).known
    hopping = replace(
        item.run, t_s=done.t_s, gauge_a_v=done.gauge_a_v, gauge_b_v=done.gauge_b_v,
        wheel_v=done.wheel_v, platform_v=done.platform_v, stop_s=done.stop_s,
        load_n=9.81 * done.scale_kg,
    )  # fmt: skip
    assert "wheel_hop" in codes(analyse_better(hopping, item.calibration, item.rig))
    assert "wheel_hop" not in codes(analyse_better(item.run, item.calibration, item.rig))


def test_zero_not_taken_off_counts_as_shared() -> None:
    item = trial("clean_0", 4.0, 10.0, 1, 1, rig=drawn_rig(0), seed=3).known
    moved = replace(item.run, gauge_a_v=item.run.gauge_a_v + 0.05)
    found = analyse_better(moved, item.calibration, item.rig)
    assert found.budget is not None
    (zero,) = [term for term in found.budget.terms if term.name == "gauge zero"]
    assert zero.systematic and zero.input_u > 0.06


def swapped(run: AngleRun) -> AngleRun:
    return replace(run, gauge_a_v=run.gauge_b_v, gauge_b_v=run.gauge_a_v)


def late(run: AngleRun) -> AngleRun:
    return cut(run, run.t_s >= 0.0)


def spotted(run: AngleRun) -> AngleRun:
    volts = run.wheel_v.copy()
    volts[run.t_s.searchsorted(0.2)] = np.nan
    return replace(run, wheel_v=volts)


@pytest.mark.parametrize(
    ("spoil", "code"),
    [
        (swapped, "negative_torque"),
        (late, "no_pre_trigger"),
        (spotted, "nan_samples"),
        (lambda run: replace(run, load_stable=False), "scale_unsteady"),
        (lambda run: replace(run, load_n=math.nan), "load_missing"),
        (lambda run: replace(run, load_n=1.3 * run.load_n), "load_disagrees"),
        (lambda run: replace(run, platform_v=np.full_like(run.platform_v, 0.5)), "pot_dead"),
        (lambda run: replace(run, stop_s=0.09), "too_short"),
        (lambda run: replace(run, t_s=np.empty(0), gauge_a_v=np.empty(0), gauge_b_v=np.empty(0),
                             wheel_v=np.empty(0), platform_v=np.empty(0)), "too_short"),
    ],
)  # fmt: skip
def test_bad_run_gives_its_reason_and_no_number(
    spoil: Callable[[AngleRun], AngleRun], code: str,
    golden: Golden, calibration: AngleCalibration, rig: AngleRig,
) -> None:  # fmt: skip
    found = analyse_better(spoil(golden("r0").whole), calibration, rig)
    assert code in codes(found) and found.excluded
    assert np.isnan(
        [found.mu, found.mu_u, found.demand, found.slip, found.slip_corrected, found.torque_nm]
    ).all()
    assert found.regime is None and found.blocks.mu.size == 0


def test_no_limits_at_all_still_give_no_exception(
    golden: Golden, calibration: AngleCalibration, rig: AngleRig
) -> None:
    """Limits are a setting; a run too short for a single block must not raise."""
    loose = BetterSettings()
    loose = replace(loose, limits=replace(loose.limits, shortest_s=0.0))
    run = replace(golden("r0").whole, stop_s=0.09)
    assert math.isnan(analyse_better(run, calibration, rig, loose).mu)


def test_unreadable_samples_after_stop_hardly_change_results(
    golden: Golden, calibration: AngleCalibration, rig: AngleRig
) -> None:
    run = golden("r0").whole
    volts = run.platform_v.copy()
    volts[run.t_s > run.stop_s + 0.02] = np.nan
    whole = analyse_better(run, calibration, rig)
    found = analyse_better(replace(run, platform_v=volts), calibration, rig)
    assert found.mu == pytest.approx(whole.mu, rel=0.005)


def with_zero(run: AngleRun, volts: float) -> AngleRun:
    return replace(run, gauge_a_v=run.gauge_a_v + volts)


def test_zero_is_subtracted_only_with_known_crosstalk(
    golden: Golden, calibration: AngleCalibration, rig: AngleRig
) -> None:
    run, drift_v = golden("r0").whole, 0.005
    none = Bending(c=0.0, s=0.0, u=1e-5, runs=90, zero_u_nm=0.013)

    def mu(run: AngleRun, bending: Bending | None) -> float:
        return analyse_better(run, calibration, rig, bending=bending).mu

    moved = TORQUE_PER_V * drift_v / (0.995 * 0.05 * run.load_n)
    assert mu(with_zero(run, drift_v), none) == pytest.approx(mu(run, none), rel=1e-9)
    assert mu(with_zero(run, drift_v), None) - mu(run, None) == pytest.approx(moved, rel=0.01)
    assert analyse_better(run, calibration, rig, bending=none).tare_v == pytest.approx(
        analyse_better(with_zero(run, drift_v), calibration, rig).tare_v - drift_v
    )


def test_crosstalk_is_subtracted_at_present_and_start_angle(
    golden: Golden, calibration: AngleCalibration, rig: AngleRig
) -> None:
    run, c, s = golden("r0").whole, 4e-4, -3e-4
    angle = calibration.wheel.value * run.wheel_v
    volts = run.load_n * (c * np.cos(angle) + s * np.sin(angle)) / calibration.torque.value
    bent = replace(run, gauge_a_v=run.gauge_a_v + volts)
    straight = Bending(0.0, 0.0, 1e-5, 90, 0.013)
    known = replace(straight, c=c, s=s)
    plain = analyse_better(run, calibration, rig, bending=straight).mu
    assert analyse_better(bent, calibration, rig, bending=known).mu == pytest.approx(
        plain, rel=0.002
    )
    assert abs(analyse_better(bent, calibration, rig, bending=straight).mu / plain - 1) > 0.01


def cell(run: AngleRun, newton: FloatArray | float) -> AngleRun:
    return replace(run, normal_force_v=np.broadcast_to(newton, run.t_s.shape) / 20.0)


def test_load_cell_if_present_gives_normal_force(
    golden: Golden, calibration: AngleCalibration, rig: AngleRig
) -> None:
    run = golden("r0").whole
    loaded = replace(calibration, normal_force=Known(20.0, 0.06))
    rising = run.load_n * (1.0 + 0.05 * np.clip(run.t_s, 0.0, None) / run.stop_s)
    found = analyse_better(cell(run, rising), loaded, rig)
    plain = analyse_better(run, calibration, rig)
    assert found.normal_force_n == pytest.approx(1.03 * run.load_n, rel=0.005)
    assert found.mu == pytest.approx(plain.mu / 1.03, rel=0.01)
    assert found.mu_u < plain.mu_u


@pytest.mark.parametrize("zero_v", [-0.09, 0.09])
def test_zero_of_load_cell_drops_out(
    zero_v: float, golden: Golden, calibration: AngleCalibration, rig: AngleRig
) -> None:
    """90 mV are 1.8 N of 39 N; the scale shows the load before the start."""
    run = golden("r0").whole
    loaded = replace(
        calibration, normal_force=Known(20.0, 0.06), normal_force_zero=Known(0.0, 0.05)
    )
    still = cell(run, run.load_n)
    assert still.normal_force_v is not None
    off = replace(still, normal_force_v=still.normal_force_v + zero_v)
    right, found = (analyse_better(item, loaded, rig) for item in (still, off))
    assert not found.excluded
    assert found.mu == pytest.approx(right.mu, rel=1e-9)
    assert found.normal_force_n == pytest.approx(run.load_n, rel=1e-9)


def test_block_lost_after_the_stop_changes_nothing() -> None:
    known = trial("clean_0", 4.0, 10.0, 1, 1, rig=drawn_rig(0), seed=3).known
    whole, stop = known.run, known.run.stop_s
    lost = cut(whole, (whole.t_s < stop + 0.01) | (whole.t_s > stop + 0.03))
    ends = cut(whole, whole.t_s < stop + 0.01)
    found, expected = (analyse_better(run, known.calibration, known.rig) for run in (lost, ends))
    assert math.isfinite(expected.mu)
    assert (found.mu, found.slip, found.flags) == (expected.mu, expected.slip, expected.flags)


@pytest.mark.parametrize(("gain", "named"), [(0.96, False), (1.04, False), (0.9, True), (-1, True)])
def test_wrong_gain_of_cell_is_harmless_or_named(
    gain: float, named: bool, golden: Golden, calibration: AngleCalibration, rig: AngleRig
) -> None:
    """N rises by 5 %; only that part of it is by the load cell."""
    run = golden("r0").whole
    loaded = replace(calibration, normal_force=Known(20.0, 0.06))
    rising = run.load_n * (1.0 + 0.05 * np.clip(run.t_s, 0.0, None) / run.stop_s)
    right = analyse_better(cell(run, rising), loaded, rig)
    found = analyse_better(cell(run, gain * rising), loaded, rig)
    assert ("load_cell_disagrees" in codes(found)) is named
    if not named:
        assert abs(found.mu - right.mu) < 0.15 * right.mu_u


@pytest.mark.parametrize("newton", [0.0, 1.3, math.nan])
def test_load_cell_contradicting_scale_excludes_run(
    newton: float, golden: Golden, calibration: AngleCalibration, rig: AngleRig
) -> None:
    run = golden("r0").whole
    loaded = replace(calibration, normal_force=Known(20.0, 0.06))
    found = analyse_better(cell(run, newton * run.load_n), loaded, rig)
    assert "load_cell_disagrees" in codes(found) and math.isnan(found.mu)


def test_known_load_rise_is_used_without_load_cell(
    golden: Golden, calibration: AngleCalibration, rig: AngleRig
) -> None:
    run = golden("r0").whole
    plain = analyse_better(run, calibration, rig)
    found = analyse_better(run, calibration, replace(rig, load_rise=Known(0.1, 0.01)))
    travel = 0.1 * 0.13  # 0.1 1/m over the mean travel of the sliding blocks
    assert found.normal_force_n / plain.normal_force_n - 1.0 == pytest.approx(travel, rel=0.25)
    assert found.mu_u < plain.mu_u


@pytest.mark.parametrize("voltage_v", [4.0, 10.0])
@pytest.mark.parametrize("set_name", ["clean_0", "clean_45"])
def test_slip_is_that_of_contact_within_its_uncertainty(set_name: str, voltage_v: float) -> None:
    item = trial(set_name, 5.0, voltage_v, 1, 1, rig=drawn_rig(0), seed=5, individual=9)
    run, truth = item.simulated, item.simulated.truth
    found = analyse_better(item.known.run, item.known.calibration, item.known.rig)
    at = run.window(BetterSettings().start_s, run.stop_s)
    rim = 0.995 * 0.05 * np.mean(truth["wheel_speed"][at])
    true = rim / (np.mean(truth["platform_speed"][at]) * math.cos(run.alpha_rad)) - 1.0
    assert abs(found.slip_corrected - true) / (1.0 + true) < 0.015
    assert abs(found.slip_corrected - true) < 3.0 * found.slip_corrected_u


@pytest.mark.parametrize("set_name", ["clean_0", "clean_15", "clean_30", "clean_45"])
def test_on_an_ideal_rig_mu_is_the_truth(set_name: str) -> None:
    """Without noise and drag, and with drags of 0 in the calibration: only F_r/N is left."""
    rig = replace(
        drawn_rig(0), effective_radius=Known(1.0), bearing_constant=Known(0.0),
        bearing_viscous=Known(0.0), bearing_load=Known(0.0), rolling_resistance=Known(0.0),
        roller_drag=Known(0.0), rail_constant=Known(0.0), rail_load=Known(0.0),
        rail_viscous=Known(0.0), load_rise=Known(0.0),
    )  # fmt: skip
    item = trial(set_name, 4.0, 10.0, 1, 1, rig=rig, seed=1, noise=False, drag=False)
    found = analyse_better(item.known.run, item.known.calibration, rig)
    times = found.blocks.t_s[found.blocks.sliding]
    truth = item.simulated.true_mu(times[0] - 0.01, times[-1] + 0.01)
    assert found.mu == pytest.approx(truth, rel=1e-3)
    assert all(flag.severity is not Severity.EXCLUDED for flag in found.flags)


@pytest.mark.parametrize(("mu", "t_s"), [(0.1, 0.05), (0.3, 1.0), (1.2, 0.3)])
def test_load_change_is_that_of_drawn_rigs(mu: float, t_s: float) -> None:
    random, settings = np.random.default_rng(5), BetterSettings()
    tilting = random.uniform(0.0, 2.0 * settings.tilting, 200_000)
    settling = random.uniform(0.0, 2.0 * settings.settling, 200_000)
    change = tilting * mu - settling * (1.0 - math.exp(-t_s / settings.settling_s))
    found = _load_change(mu, t_s, settings)
    assert found == pytest.approx(float(np.sqrt(np.mean(change**2))), rel=0.01)
