"""Rise of the load along the rails: recovered with its interval; what is no calibration."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from support.approach_angle.plant import make_plant, mean_volts, pass_time, shipped
from support.cases import some

from rigd.analysis.calibration.result import CalibrationResult
from rigd_analyses.approach_angle.calibration.rise import Push, calibrate_rise
from rigd_sim.approach_angle.plant import AnglePlant

LOADS = (4.0, 4.0, 4.0, 4.0, 8.0, 8.0, 8.0, 8.0)
RISE = 0.1  #: of the shipped plant, 1/m: 3 % over 0.3 m
TRAVEL = 0.3
RIGS = some(range(1, 21), 3)


def calibrated(pushes: list[Push]) -> CalibrationResult:
    return calibrate_rise(pushes, u_travel=0.002, division_kg=0.01)


def push(load: float, rise: float = RISE) -> Push:
    shown = load * np.array([1.0, 1.0 + rise * TRAVEL, 1.0])
    return Push(load, shown, np.array([0.09, 0.09 + TRAVEL, 0.09]))


def weighed(plant: AnglePlant) -> tuple[float, float]:
    """Return what scale and potentiometer show on average, as the procedure waits and measures."""
    pass_time(plant, 4.0)
    shown = []
    for _ in range(16):
        pass_time(plant, 0.25)
        shown.append(plant.scale()[0])
    pots = shipped().potentiometers
    metres_per_volt = pots.pulley / pots.volts_per_rad
    return float(np.mean(shown)), metres_per_volt * float(mean_volts(plant, 0.1)[3])


def session(individual: int) -> list[Push]:
    """Return what a person measures on this rig."""
    plant, pushes = make_plant(individual=individual, seed=individual), []
    for k, load in enumerate(LOADS):
        if k in (0, 4):
            plant.change("load", load)
        seen: list[tuple[float, float]] = []
        for place in ("start", "end", "start"):
            if seen or not k:
                plant.change("platform", place)
            seen.append(weighed(plant))
        pushes.append(Push(load, *np.array(seen).T))
    return pushes


def test_true_rise_lies_in_interval_on_differing_rigs() -> None:
    """Each push has a rise of its own, 1 % of the load at the stop: the mean is what is sought."""
    found = [calibrated(session(individual)).measured["load_rise"] for individual in RIGS]
    deviations, u = np.array([(item.value - RISE, item.u) for item in found]).T
    assert np.count_nonzero(np.abs(deviations) > 2 * u) <= 2
    assert 0.5 < np.sqrt(np.mean((deviations / u) ** 2)) < 1.3
    spread = shipped().normal_force.rise_spread / TRAVEL
    assert np.median(u) == pytest.approx(spread / math.sqrt(8) * math.sqrt(6 / 4), rel=0.35)


def test_few_pushes_widen_interval_to_hold_95_percent() -> None:
    random = np.random.default_rng(7)
    scores = []
    for _ in range(500):
        few = [push(load, RISE + 0.03 * random.normal()) for load in (4.0, 8.0) for _ in range(3)]
        found = calibrated(few).measured["load_rise"]
        scores.append((found.value - RISE) / found.u)
    assert 0.93 <= np.mean(np.abs(scores) < 2.0) <= 0.99


@pytest.mark.parametrize("rise", [RISE, 0.0, -0.05])
def test_exact_rise_is_found_for_any_sign(rise: float) -> None:
    result = calibrated([push(load, rise) for load in LOADS])
    found = result.measured["load_rise"]
    assert found.value == pytest.approx(rise, abs=1e-12)
    rounding = math.sqrt(1.5) * 0.01 / math.sqrt(12) * (1 / 4 + 1 / 8) / 2 / TRAVEL
    assert found.u == pytest.approx(math.hypot(rounding, 0.002 * rise))
    assert not result.refusals


def test_even_ground_sag_and_scale_span_change_nothing() -> None:
    pushes = [push(load) for load in LOADS]
    sinking = [replace(item, shown_kg=item.shown_kg - 0.02 * np.arange(3)) for item in pushes]
    wider = [replace(item, shown_kg=1.003 * item.shown_kg) for item in pushes]
    for seen, within in ((sinking, 0.01), (wider, 1e-9)):
        assert calibrated(seen).measured["load_rise"].value == pytest.approx(RISE, rel=within)


def test_disproportionate_rise_is_in_the_uncertainty() -> None:
    """Rails whose bolts are stiff: so many newtons more, at any load."""
    result = calibrated([push(load, RISE * 6.0 / load) for load in LOADS])
    terms = {item.name: item.u for item in result.measured["load_rise"].budget}
    assert terms["scatter between pushes"] == pytest.approx(0.0, abs=1e-9)
    light, heavy = RISE * 6.0 / 4.0, RISE * 6.0 / 8.0
    assert terms["difference between the loads"] == pytest.approx((light - heavy) / math.sqrt(2))
    assert "at 4 kg +0.150 ± 0.000 1/m; at 8 kg +0.075 ± 0.000 1/m" in result.facts[1]


def test_travel_spread_and_residual_load_are_reported() -> None:
    pushes = [push(load, RISE + (0.02, -0.02)[k % 2]) for k, load in enumerate(LOADS)]
    pushes[2] = replace(pushes[2], shown_kg=pushes[2].shown_kg * [1, 1, 1.003])
    travelled, _, left = calibrated(pushes).facts
    assert "8 pushes of 0.300 m, over which the load rises by +3.0%" in travelled
    assert "one push departs from that by 0.7% of the load, and so may one run" in travelled
    assert "to within 12.0 g" in left


@pytest.mark.parametrize(
    ("spoil", "part"),
    [
        (lambda p: replace(p, shown_kg=p.shown_kg + 1.0), "the scale shows 5.00 kg while 4 kg"),
        (lambda p: replace(p, shown_kg=0.0 * p.shown_kg), "is the wheel on the surface"),
        (lambda p: replace(p, shown_kg=p.shown_kg * [1, 1.075, 1]), "by +10.7%, the others by +3"),
        (lambda p: replace(p, shown_kg=p.shown_kg * [1, 1, 1.025]), "back at the start the scale"),
        (lambda p: replace(p, position_m=0.0 * p.position_m), "the platform went by 0 mm"),
        (lambda p: replace(p, position_m=-p.position_m), "wired the wrong way round"),
    ],
)
def test_a_bad_push_is_refused_with_its_number(spoil: Callable[[Push], Push], part: str) -> None:
    pushes = [push(load) for load in LOADS]
    pushes[2] = spoil(pushes[2])
    result = calibrated(pushes)
    assert not result.measured
    (reason,) = result.refusals
    assert reason.startswith("push 3: ") and part in reason


@pytest.mark.parametrize(
    ("loads", "found"),
    [
        ((), "none"),
        ((4.0,) * 8, "8 under 4 kg"),
        ((8.0, 4.0, 4.0, 4.0, 8.0), "3 under 4 kg, 2 under 8 kg"),
    ],
)
def test_too_few_pushes_or_loads_are_refused(loads: tuple[float, ...], found: str) -> None:
    (reason,) = calibrated([push(load) for load in loads]).refusals
    assert reason == f"3 pushes are needed under each of at least 2 loads; there are {found}"
