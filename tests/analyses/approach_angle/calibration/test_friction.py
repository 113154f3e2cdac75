"""Friction of rails and bearings: recovered with its interval; what is not known is reported."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rigd.analysis.calibration.result import together
from rigd_analyses.approach_angle.calibration.bearings import (
    BearingBench,
    Spin,
    calibrate_bearings,
    steady_turning,
)
from rigd_analyses.approach_angle.calibration.rails import (
    Push,
    RailBench,
    calibrate_rails,
    coast_of,
)

RAILS = RailBench(
    mass_kg=3.0, u_mass=0.003, gravity=9.81, u_platform_scale=0.002, rail_load=0.01,
    u_rail_load=0.003,
)  # fmt: skip
BEARINGS = BearingBench(torque_scale=2.04, u_torque_scale=0.0027, inertia=4e-4)
SPEEDS = (0.3, 0.35, 0.4, 0.45)
#: Where pushes begin: on four parts of a turn of the potentiometer, which takes 94 mm.
STARTS_M = (0.0, 0.024, 0.047, 0.071)
#: Of the rails: constant, per load, per speed.
CONSTANT, LOAD, VISCOUS = 0.6, 0.01, 0.3
BRAKE = CONSTANT + LOAD * 3.0 * 9.81


def push(
    speed: float,
    random: np.random.Generator,
    phase: float = 1.0,
    start_m: float = 0.0,
    rails: tuple[float, float] = (BRAKE, VISCOUS),
) -> Push:
    """Return 0.3 s at rest, then the exact answer of m dv/dt = -A - B v, as a pot sees it."""
    brake, viscous = rails
    step, rate = 0.01, viscous / 3.0
    t = step * np.arange(300, dtype=np.float64)
    end = np.log1p(speed * viscous / brake) / rate
    since = np.clip(t - 0.3, 0.0, end)
    limit = brake / viscous
    x = start_m + (speed + limit) * -np.expm1(-rate * since) / rate - limit * since
    turned = (x + 0.09 + 5e-4 * random.normal()) / 0.015
    seen = 0.015 * (turned + 8e-3 * np.sin(turned + phase)) + 3e-5 * random.normal(size=len(t))
    return Push(t, np.asarray(seen, np.float64))


def pushes(
    seed: int,
    sign: float = 1.0,
    starts_m: tuple[float, ...] = STARTS_M,
    rails: tuple[float, float] = (BRAKE, VISCOUS),
) -> list[Push]:
    random = np.random.default_rng(seed)
    phase = float(random.uniform(0.0, 2 * np.pi))
    found = [push(speed, random, phase, start, rails) for start in starts_m for speed in SPEEDS]
    return [Push(item.t_s, sign * item.x_m) for item in found]


def test_rails_are_recovered_with_their_interval() -> None:
    scores = []
    for seed in range(40):
        measured = calibrate_rails(pushes(seed), replace(RAILS, u_rail_load=0.0)).measured
        constant, viscous = measured["rail_constant"], measured["rail_viscous"]
        scores.append(
            [(constant.value - CONSTANT) / constant.u, (viscous.value - VISCOUS) / viscous.u]
        )
        assert constant.u < 0.02
        assert viscous.u < 0.06
    assert np.all(np.mean(np.abs(scores) < 2.0, axis=0) >= 0.9)


@pytest.mark.parametrize("starts_m", [STARTS_M, (0.0,) * 4])
def test_interval_of_viscous_rails_holds_from_any_start(starts_m: tuple[float, ...]) -> None:
    """Rails that brake hard make the coast short; then the error once per turn decides."""
    scores, shares = [], []
    for seed in range(40):
        random = np.random.default_rng(1000 + seed)
        brake, viscous = random.uniform(0.9, 1.9), 0.3 * np.exp(0.5 * random.normal())
        result = calibrate_rails(
            pushes(seed, starts_m=starts_m, rails=(brake, viscous)), replace(RAILS, u_mass=0.0)
        )
        found = result.measured.get("rail_viscous")
        if found is None:  # not distinguished from zero, and so not written
            continue
        scores.append((found.value - viscous) / found.u)
        shares.append(found.u / viscous)
    assert len(scores) >= 20
    assert np.mean(np.abs(scores) < 2.0) >= 0.92
    assert np.median(shares) < (0.25 if starts_m == STARTS_M else 0.5)


def test_pushes_from_one_start_are_named() -> None:
    spread, alike = (
        calibrate_rails(pushes(1, starts_m=at), RAILS) for at in (STARTS_M, (0.0,) * 4)
    )
    assert "shows as scatter" in spread.facts[-1]
    assert "Let the pushes begin at places spread over a turn" in alike.facts[-1]


def test_a_push_the_other_way_gives_the_same() -> None:
    there, back = (calibrate_rails(pushes(5, sign), RAILS).measured for sign in (1.0, -1.0))
    for name in there:
        assert back[name].value == pytest.approx(there[name].value, rel=1e-9)


def test_load_share_is_subtracted_and_reported_as_unmeasured() -> None:
    result = calibrate_rails(pushes(1), RAILS)
    other = calibrate_rails(pushes(1), replace(RAILS, rail_load=0.0))
    difference = other.measured["rail_constant"].value - result.measured["rail_constant"].value
    assert difference == pytest.approx(0.01 * 3.0 * 9.81)
    assert result.measured["rail_constant"].u == pytest.approx(0.003 * 3.0 * 9.81, rel=0.02)
    assert "cannot separate it from rail_constant" in result.kept["rail_load"]


def test_coast_begins_at_release_and_ends_before_stop() -> None:
    coast = coast_of(push(0.4, np.random.default_rng(2)))
    assert coast is not None
    assert coast.t_s[0] == 0.0
    assert 0.7 < coast.t_s[-1] < 1.1
    still = Push(np.linspace(0, 1, 101), np.zeros(101))
    assert coast_of(still) is None


def test_too_few_pushes_and_a_bumper_are_refused() -> None:
    (reason,) = calibrate_rails(pushes(1)[:3], RAILS).refusals
    assert "4 pushes are needed" in reason
    hit = [
        Push(item.t_s, np.minimum(item.x_m, 0.6 * item.x_m.max()) + 0.02 * (item.t_s > 1.0))
        for item in pushes(1)
    ]
    assert calibrate_rails(hit, RAILS).refusals


def test_rails_lighter_than_their_known_share_are_refused() -> None:
    (reason,) = calibrate_rails(pushes(1), replace(RAILS, rail_load=0.05)).refusals
    assert "is the wheel lifted" in reason


def spins(seed: int, constant: float = 0.012, viscous: float = 2e-4) -> list[Spin]:
    random = np.random.default_rng(seed)
    found = []
    for speed in (6.0, 10.0, 17.0, 24.0) * 4:
        acceleration = 0.1 * random.normal()
        torque = constant + viscous * speed + BEARINGS.inertia * acceleration
        volts = torque / BEARINGS.torque_scale + 2.4e-4 * random.normal()
        found.append(Spin(volts, speed, acceleration, 1.4))
    return found


def test_bearings_are_recovered_with_their_interval() -> None:
    scores = []
    for seed in range(60):
        measured = calibrate_bearings(spins(seed), BEARINGS).measured
        constant, viscous = measured["bearing_constant"], measured["bearing_viscous"]
        scores.append([(constant.value - 0.012) / constant.u, (viscous.value - 2e-4) / viscous.u])
    assert np.all(np.mean(np.abs(scores) < 2.0, axis=0) >= 0.9)


def test_accelerating_torque_is_not_attributed_to_bearings() -> None:
    steady, gaining = (
        [
            Spin((0.012 + 2e-4 * w + 4e-4 * dw) / 2.04 + 1e-6 * (-1) ** n, w, dw, 1.4)
            for n, w in enumerate((6.0, 10.0, 17.0, 24.0) * 2)
        ]
        for dw in (0.0, 0.4)
    )
    for spinning in (steady, gaining):
        measured = calibrate_bearings(spinning, BEARINGS).measured
        assert measured["bearing_constant"].value == pytest.approx(0.012, rel=1e-3)


def test_unseen_viscosity_is_kept_and_reported() -> None:
    result = calibrate_bearings(spins(1, viscous=0.0), BEARINGS)
    assert "bearing_constant" in result.measured
    assert "bearing_viscous" not in result.measured
    assert "do not distinguish it from zero" in result.kept["bearing_viscous"]
    assert "carries no load" in result.kept["bearing_load"]


def test_bad_spins_are_refused() -> None:
    good = spins(1)
    swapped = [replace(item, difference_v=-item.difference_v) for item in good]
    backwards = [replace(item, speed_rad_s=-item.speed_rad_s) for item in good]
    alike = [replace(item, speed_rad_s=10.0 + 0.1 * n) for n, item in enumerate(good)]
    unsteady = [replace(good[0], acceleration_rad_s2=5.0), *good[1:]]
    touched = [replace(good[3], difference_v=good[3].difference_v + 0.05), *good[:3], *good[4:]]
    for bad, part in (
        (swapped, "are the gauges swapped"),
        (backwards, "wired the wrong way round"),
        (alike, "voltages further apart"),
        (unsteady, "wait longer"),
        (touched, "touched something"),
        (good[:5], "6 spins"),
    ):
        result = calibrate_bearings(bad, BEARINGS)
        assert not result.measured
        assert part in result.refusals[0]


def test_speed_and_acceleration_are_those_of_the_middle() -> None:
    t = np.linspace(2.0, 3.0, 200)
    speed, acceleration = steady_turning(t, 1.0 + 20.0 * (t - 2.5) + 0.75 * (t - 2.5) ** 2)
    assert speed == pytest.approx(20.0)
    assert acceleration == pytest.approx(1.5)


def test_refused_part_refuses_combined_calibration() -> None:
    good, bad = calibrate_rails(pushes(1), RAILS), calibrate_bearings(spins(1)[:3], BEARINGS)
    result = together("both", [good, bad])
    assert not result.measured
    assert result.refusals == (f"{bad.title}: {bad.refusals[0]}",)
    assert not together("one", [good]).refusals
