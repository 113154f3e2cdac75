"""The torque scale: recovered on rigs that differ, within its interval; bad data refused."""

from __future__ import annotations

import numpy as np
import pytest
from support.approach_angle.plant import make_plant, mean_volts, pass_time
from support.cases import some

from rigd_analyses.approach_angle.calibration.torque import ArmBench, calibrate_torque
from rigd_sim.approach_angle.plant import AnglePlant

BENCH = ArmBench(
    arm_m=0.2039, u_arm_m=5e-4, u_mass=3e-4, gravity=9.81, u_gravity=5e-3,
    u_alignment_rad=np.radians(1.0), poisson=0.33,
)  # fmt: skip
MASSES = np.array([0.0, 1.0, 2.0, 3.0, 2.0, 1.0, 0.0])
SCALE = 2.04
RIGS = some(range(1, 21), 3)


def gauges(scale: float = SCALE, common: float = 0.01) -> tuple[np.ndarray, np.ndarray]:
    """Return ideal voltages: the arm's torque, some bending that both gauges see, and zeros."""
    torque = MASSES * BENCH.gravity * BENCH.arm_m
    difference, mean = torque / scale, 0.2 - common * torque
    return mean + 0.5 * difference + 0.05, mean - 0.5 * difference


def true_scale(plant: AnglePlant) -> float:
    """Return N m per V of (V_a - V_b), from what the plant is made of."""
    c = plant._constants[0]
    strains = c["gain_a"] * c["shear_a"] - c["gain_b"] * c["shear_b"]
    return float(1.0 / (c["gauge_sensitivity"] * c["shear_per_torque"] * strains))


def calibrated_on(individual: int) -> tuple[float, float]:
    """Return deviation and uncertainty of the scale that a bench session on this rig gives."""
    plant = make_plant(individual=individual, seed=individual)
    plant.change("wheel_lift", "lifted")
    plant.change("shaft", "clamped")
    volts = []
    for mass in MASSES:
        plant.change("arm_mass", float(mass))
        pass_time(plant, 0.1)
        volts.append(mean_volts(plant, 1.0)[:2])
    a, b = np.array(volts).T
    found = calibrate_torque(MASSES, a, b, BENCH).measured["torque_scale"]
    return found.value - true_scale(plant), found.u


def test_true_scale_lies_in_interval_on_differing_rigs() -> None:
    """Arm, gains and gauge angles are drawn; U = 2 u must hold it in 95 % and not be lavish."""
    deviations, u = np.array([calibrated_on(individual) for individual in RIGS]).T
    assert np.count_nonzero(np.abs(deviations) > 2 * u) <= 2
    assert 0.5 < np.sqrt(np.mean((deviations / u) ** 2)) < 1.5
    assert np.all(u < 0.004 * SCALE)


def test_ideal_gauges_give_scale_and_budget_of_arm() -> None:
    result = calibrate_torque(MASSES, *gauges(), BENCH)
    found = result.measured["torque_scale"]
    assert found.value == pytest.approx(SCALE, rel=1e-12)
    terms = {item.name: item.u for item in found.budget}
    assert terms["length of the arm"] == pytest.approx(SCALE * 5e-4 / 0.2039)
    # 1 degree on each of two gauges, and a mean that moves by 0.01 SCALE of the difference.
    let_through = np.sqrt(2) * np.radians(1.0) * 2 * 1.33 / 0.67 * 0.01 * SCALE
    assert terms["bending let through by misaligned gauges"] == pytest.approx(SCALE * let_through)
    assert terms["scatter about the line"] < 1e-9
    assert found.u == pytest.approx(np.sqrt(sum(u**2 for u in terms.values())))


def test_swapped_gauges_are_refused() -> None:
    a, b = gauges()
    result = calibrate_torque(MASSES, b, a, BENCH)
    assert not result.measured
    assert "the gauges are swapped" in result.refusals[0]


def test_another_weight_than_announced_is_refused() -> None:
    a, b = gauges()
    wrong = MASSES.copy()
    wrong[3] = 2.5
    (reason,) = calibrate_torque(wrong, a, b, BENCH).refusals
    assert "off the straight line, more than 1%" in reason


def test_a_dead_gauge_is_refused() -> None:
    a, _ = gauges(common=0.0)
    reasons = calibrate_torque(MASSES, a, np.zeros(len(MASSES)), BENCH).refusals
    assert any("one of them is dead" in reason for reason in reasons)


def test_gauges_that_do_not_answer_are_refused() -> None:
    still = np.full(len(MASSES), 0.3)
    (reason,) = calibrate_torque(MASSES, still, still, BENCH).refusals
    assert "do not answer" in reason


def test_two_masses_are_too_few() -> None:
    few = np.isin(MASSES, (0.0, 3.0))
    a, b = gauges()
    (reason,) = calibrate_torque(MASSES[few], a[few], b[few], BENCH).refusals
    assert reason.endswith("there are 0 kg, 3 kg")
