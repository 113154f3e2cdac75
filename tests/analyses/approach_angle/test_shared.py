"""Errors that all runs share, on runs made from the equations alone: named, sized, or not there."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from rigd_analyses.approach_angle.better.result import BalanceRow, Blocks
from rigd_analyses.approach_angle.better.run import no_numbers
from rigd_analyses.approach_angle.paper import PaperRun
from rigd_analyses.approach_angle.raw.run_data import (
    AngleCalibration,
    AngleRig,
    AngleRun,
    Flag,
    Known,
    KnownRun,
)
from rigd_analyses.approach_angle.run_result import RunResult
from rigd_analyses.approach_angle.shared.balance import balance_errors, excluded_errors
from rigd_analyses.approach_angle.shared.load import load_errors
from rigd_analyses.approach_angle.shared.share import gauge_errors, shown
from rigd_analyses.approach_angle.shared.travel import travel_errors

SETS = {"clean_0": (0.0, 0.19), "clean_15": (15.0, 0.25), "clean_45": (45.0, 0.58)}
LOADS_KG = (4.0, 5.0, 6.0, 8.0)
CALIBRATION = AngleCalibration(
    torque=Known(2.03, 0.005), wheel=Known(12.57, 0.025), platform=Known(0.1885, 0.0004)
)
GRAVITY, RADIUS = 9.81, 0.05


@dataclass(frozen=True)
class Wrong:
    """What is wrong with a campaign, relative if the name has no unit."""

    gain: float = 0.0
    offset_nm: float = 0.0
    drift: float = 0.0
    tare_kg: float = 0.0
    span: float = 0.0
    gain_a: float = 0.0
    turn: float = 0.0


def campaign(
    rig: AngleRig, wrong: Wrong = Wrong(), seed: int = 1, repeats: int = 3
) -> tuple[list[KnownRun], list[RunResult]]:
    """Return 12 cells of a rig that is as uncertain as it is known, and what their runs show."""
    rng = np.random.default_rng(seed)
    known, results = [], []
    rail_n, viscous = (rng.normal(0.0, value.u) for value in (rig.rail_constant, rig.rail_viscous))
    drag, rolling = (rng.normal(0.0, v.u) for v in (rig.roller_drag, rig.rolling_resistance))
    points = [(name, load, k) for name in SETS for load in LOADS_KG for k in range(repeats)]
    setting = {(name, load): rng.normal(1.0, 0.01) for name in SETS for load in LOADS_KG}
    for number, (name, load, _) in enumerate(points):
        degrees, mu = SETS[name]
        alpha, normal = math.radians(degrees), load * GRAVITY * setting[name, load]
        true_nm, speed = RADIUS * mu * normal, 1.2
        shown_nm = true_nm * (1.0 + wrong.gain + wrong.drift * number / len(points))
        shown_nm += wrong.offset_nm
        residual = (
            (shown_nm - true_nm) / RADIUS + rolling * normal + drag * normal * math.tan(alpha)
            + (rail_n + viscous * speed) / math.cos(alpha) + rng.normal(0.0, 1e-3 * normal)
        )  # fmt: skip
        row = BalanceRow(
            residual_n=residual, normal_n=normal, torque_nm=shown_nm, force_n=shown_nm / RADIUS,
            wheel_speed_rad_s=40.0, platform_speed_m_s=speed, push_n=mu * normal,
            on_rails_n=normal, push_u_n=0.06,
        )  # fmt: skip
        run = raw_run(name, alpha, load, normal * (1 + wrong.span) + GRAVITY * wrong.tare_kg)
        run = replace(run, number=number, **gauges(shown_nm, wrong, rng))
        known.append(KnownRun(run, CALIBRATION, rig))
        results.append(result_of(run, row))
    return known, results


def raw_run(name: str, alpha: float, load_kg: float, load_n: float) -> AngleRun:
    none = np.empty(0)
    return AngleRun(name, name, alpha, load_kg, 10.0, 1, none, none, none, none, none, 0.4, load_n)


def gauges(torque_nm: float, wrong: Wrong, rng: np.random.Generator) -> dict[str, Any]:
    """Return signals at rest, then under a torque over three turns, with bending of both gauges."""
    t_s = np.arange(-0.1, 0.4, 1e-3)
    torque = torque_nm * (t_s > 0.0)
    theta = rng.uniform(0.0, 1.0) + 6.0 * math.pi * np.clip(t_s, 0.0, None) / 0.4
    half, bending = 0.5 * torque / CALIBRATION.torque.value, 0.05 * np.cos(theta)
    noise = 0.002 * rng.standard_normal((2, t_s.size))
    return {
        "t_s": t_s,
        "gauge_a_v": 0.01 + (1.0 + wrong.gain_a) * half + bending + noise[0],
        "gauge_b_v": 0.02 - half + bending + noise[1],
        "wheel_v": (1.0 + wrong.turn) * theta / CALIBRATION.wheel.value,
    }


def result_of(run: AngleRun, row: BalanceRow | None, *flags: Flag) -> RunResult:
    nan = math.nan
    paper = PaperRun(nan, nan, nan, nan, nan, nan, nan, nan, nan, None, flags)
    return RunResult(run, paper, replace(no_numbers(()), mu=0.2, balance=row), flags)


@pytest.mark.parametrize(
    ("wrong", "code", "size", "clean_0"),
    [
        (Wrong(gain=-0.08), "torque_gain", -0.08, 0.08),
        (Wrong(gain=0.08), "torque_gain", 0.08, 0.08),
        (Wrong(offset_nm=0.05), "torque_offset", 0.05, 0.09),
        (Wrong(drift=0.15), "torque_drift", 0.15, 0.024),
    ],
)
def test_shared_error_of_torque_is_named_and_sized(
    rig: AngleRig, wrong: Wrong, code: str, size: float, clean_0: float
) -> None:
    (found,), _ = balance_errors(*campaign(rig, wrong))
    assert found.code == code
    assert abs(found.size - size) < 3.0 * found.u < abs(size)
    assert found.effect["clean_0"] == pytest.approx(clean_0, rel=0.3)
    assert "too much" in found.sentence if size > 0 else "too little" in found.sentence


def test_uncertain_rig_alone_is_no_shared_error(rig: AngleRig) -> None:
    """The rig is off by draws from what it is known by; the gauges and loads are right."""
    alarms = [
        error.code
        for seed in range(100)
        for runs in [campaign(rig, seed=seed)]
        for error in (*balance_errors(*runs)[0], *load_errors(*runs), *gauge_errors(*runs))
    ]
    assert len(alarms) <= 1, alarms


def test_drag_of_rollers_leaves_maxima_alone(rig: AngleRig) -> None:
    known, results = campaign(rig)
    more = 10.0 * rig.roller_drag.u

    def dragged(result: RunResult, alpha: float) -> RunResult:
        row = result.better.balance
        assert row is not None
        residual = row.residual_n + more * row.normal_n * math.tan(alpha)
        row = replace(row, residual_n=residual)
        return replace(result, better=replace(result.better, balance=row))

    wrong = [dragged(r, k.run.alpha_rad) for k, r in zip(known, results, strict=True)]
    (found,), _ = balance_errors(known, wrong)
    assert found.code == "roller_drag"
    assert found.size == pytest.approx(more, rel=0.2)
    assert max(found.effect.values()) < 0.002


def test_run_left_out_shows_no_shared_error(rig: AngleRig) -> None:
    known, results = campaign(rig, Wrong(gain=0.08))
    out = [replace(result, flags=(Flag("gauge_dead", "Bad."),)) for result in results]
    assert balance_errors(known, out) == ([], {})
    assert load_errors(known, out) == gauge_errors(known, out) == []


def excluded(results: list[RunResult], count: int) -> list[RunResult]:
    """Return ``results`` of which the balance excludes so many, those with the largest residual."""
    sizes = [abs(b.residual_n) / b.normal_n if (b := r.better.balance) else 0.0 for r in results]
    worst = sorted(range(len(sizes)), key=lambda k: -sizes[k])[:count]
    flag = Flag("rubbing", "The gauges show more than the motion needs.")
    return [replace(r, flags=(flag,)) if k in worst else r for k, r in enumerate(results)]


def test_runs_that_the_balance_excludes_are_evidence(rig: AngleRig) -> None:
    known, results = campaign(rig, Wrong(gain=0.06))
    (found,), _ = balance_errors(known, excluded(results, 20))
    assert found.code == "torque_gain"
    assert abs(found.size - 0.06) < 2.0 * found.u


@pytest.mark.parametrize(("count", "widened"), [(0, False), (1, False), (4, True), (12, True)])
def test_more_excluded_runs_than_chance_widen(rig: AngleRig, count: int, widened: bool) -> None:
    known, results = campaign(rig, Wrong(gain=0.05))
    found = excluded_errors(known, excluded(results, count))
    assert bool(found) is widened
    for error in found:
        assert min(error.effect.values()) > 0.5 * 0.05


def test_more_runs_make_an_error_better_known(rig: AngleRig) -> None:
    (few,), _ = balance_errors(*campaign(rig, Wrong(gain=0.08)))
    (many,), _ = balance_errors(*campaign(rig, Wrong(gain=0.08), repeats=12))
    assert few.code == many.code == "torque_gain"
    assert many.u < few.u


def test_second_significant_explanation_is_in_the_interval(rig: AngleRig) -> None:
    """Rails that brake, and torque that is lost, differ by the angle alone."""
    known, results = campaign(rig)

    def braked(result: RunResult, alpha: float) -> RunResult:
        row = result.better.balance
        assert row is not None
        row = replace(row, residual_n=row.residual_n + 0.7 / math.cos(alpha))
        return replace(result, better=replace(result.better, balance=row))

    wrong = [braked(r, k.run.alpha_rad) for k, r in zip(known, results, strict=True)]
    (found,), _ = balance_errors(known, wrong)
    assert found.code == "rails"
    assert found.effect["clean_0"] > 0.5 * 0.7 / (0.19 * 5.5 * GRAVITY)


def sliding(result: RunResult, place: int, rise: float, rng: np.random.Generator) -> RunResult:
    """Return ``result`` with sliding blocks whose friction also rises with the travel, 1/m."""
    travel = np.linspace(0.05, 0.28, 12)
    speed = (0.3 + 0.25 * (place % 4)) * np.sqrt(travel / 0.1)
    mu = 0.3 * np.exp(-0.1 * np.log10(speed / 0.5) ** 2 + rise * travel)
    mu *= (1.0 + 0.015 * rng.standard_normal()) * (1.0 + 0.01 * rng.standard_normal(12))
    full = np.ones(12)
    blocks = Blocks(0.1 + travel, speed, mu, full, travel, full > 0.0)
    return replace(result, better=replace(result.better, blocks=blocks))


@pytest.mark.parametrize(
    ("rise", "named"), [(0.0, False), (-0.1, False), (-0.6, True), (0.6, True)]
)
def test_change_along_travel_is_named_and_widens(rig: AngleRig, rise: float, named: bool) -> None:
    rng = np.random.default_rng(5)
    known, results = campaign(rig)
    found = travel_errors(known, [sliding(r, k, rise, rng) for k, r in enumerate(results)])
    assert bool(found) is named
    for error in found:
        assert abs(error.size - rise) < 0.1
        assert error.effect["clean_0"] == pytest.approx(abs(rise) * 0.165, rel=0.2)
        assert ("rises" if rise > 0.0 else "falls") in error.sentence


@pytest.mark.parametrize("repeats", [3, 8, 16])
@pytest.mark.parametrize(
    ("wrong", "shift"), [(Wrong(gain=-0.05), 0.05), (Wrong(drift=0.06), 0.03), (Wrong(), 0.0)]
)
def test_error_just_missed_is_in_the_interval(
    rig: AngleRig, wrong: Wrong, shift: float, repeats: int
) -> None:
    """What 36, 96 and 192 runs do not name is within 2 u, with more as with fewer."""
    held, widths = [], []
    for seed in range(10):
        _, effect = balance_errors(*campaign(rig, wrong, seed, repeats))
        widths.append(effect["clean_15"])
        held.append(2.0 * math.hypot(effect["clean_15"], 0.01) > shift)
    assert sum(held) >= 9
    if not shift:
        assert float(np.median(widths)) < 0.01


@pytest.mark.parametrize(
    ("wrong", "code", "size"),
    [
        (Wrong(tare_kg=0.15), "missed_tare", 0.15),
        (Wrong(tare_kg=-0.15), "missed_tare", -0.15),
        (Wrong(span=0.04), "load_span", 0.04),
    ],
)
def test_scale_against_announced_loads_is_named(
    rig: AngleRig, wrong: Wrong, code: str, size: float
) -> None:
    (found,) = load_errors(*campaign(rig, wrong))
    assert found.code == code
    assert found.size == pytest.approx(size, rel=0.25)
    assert found.effect["clean_0"] == pytest.approx(abs(size) / (1 if wrong.span else 5.5), rel=0.3)


def test_wrong_calibration_of_scale_is_named(rig: AngleRig) -> None:
    known, results = campaign(rig)
    wrong = replace(CALIBRATION, load=Known(1.04, 0.002))
    (found,) = load_errors([replace(k, calibration=wrong) for k in known], results)
    assert (found.code, found.size > 0.03) == ("load_span", True)


def test_two_loads_show_no_tare(rig: AngleRig) -> None:
    known, results = campaign(rig, Wrong(tare_kg=0.5))
    few = [k for k in range(len(known)) if known[k].run.announced_load_kg == 4.0]
    assert load_errors([known[k] for k in few[:2]], [results[k] for k in few[:2]]) == []


def test_gauge_that_lost_gain_is_named(rig: AngleRig) -> None:
    (found,) = gauge_errors(*campaign(rig, Wrong(gain_a=-0.1)))
    assert "gauge a has lost gain" in found.sentence
    assert found.effect["clean_45"] == pytest.approx(0.05, rel=0.15)


def test_gauge_off_in_one_set_widens_all(rig: AngleRig) -> None:
    (right, results), (wrong, _) = campaign(rig), campaign(rig, Wrong(gain_a=-0.1))
    known = [w if w.run.set_name == "clean_0" else k for k, w in zip(right, wrong, strict=True)]
    (found,) = gauge_errors(known, results)
    assert "in clean_0" in found.sentence
    assert set(found.effect) == set(SETS) and min(found.effect.values()) > 0.04


def test_calibrated_share_is_no_error(rig: AngleRig) -> None:
    known, results = campaign(rig, Wrong(gain_a=-0.1))
    calibrated = replace(CALIBRATION, gauge_share=Known(0.9 / 1.9, 0.002))
    assert gauge_errors([replace(k, calibration=calibrated) for k in known], results) == []


def test_share_without_rest_is_unknown(rig: AngleRig) -> None:
    known, _ = campaign(rig)
    run = known[0].run
    late: dict[str, Any] = {
        name: getattr(run, name)[200:] for name in ("t_s", "gauge_a_v", "gauge_b_v", "wheel_v")
    }
    assert shown(replace(known[0], run=replace(run, **late))) is None
    found = shown(known[0])
    assert found is not None and found.share.value == pytest.approx(0.5, abs=0.01)


@pytest.mark.parametrize("turn", [-0.05, -0.02, 0.03])
def test_bending_names_a_wrong_turn(rig: AngleRig, turn: float) -> None:
    """As if the supply of all sensors was another one: the share of the gauges stays right."""
    (found,) = gauge_errors(*campaign(rig, Wrong(turn=turn)))
    assert found.code == "wheel_turn"
    assert 1.0 / (1.0 + found.size) - 1.0 == pytest.approx(turn, abs=0.002)
    assert min(found.effect[name] for name in SETS) > 0.9 * abs(turn)
    assert ("too little" in found.sentence) is (turn < 0.0)


def test_gauges_without_bending_name_no_turn(rig: AngleRig) -> None:
    known, results = campaign(rig)
    noise = np.random.default_rng(3)
    torques = [
        replace(
            k, run=replace(k.run, gauge_b_v=-k.run.gauge_a_v + 0.002 * noise.standard_normal(500))
        )
        for k in known
    ]
    assert gauge_errors(torques, results) == []


def test_few_runs_show_no_shared_error(rig: AngleRig) -> None:
    known, results = campaign(rig, Wrong(gain=0.5, gain_a=-0.5))
    known, results = known[:3], results[:3]
    assert balance_errors(known, results) == ([], {})
    assert gauge_errors(known, results) == []
