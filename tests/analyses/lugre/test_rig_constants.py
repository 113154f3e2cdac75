"""Constants that no rig can have are refused by name, value and unit."""

from __future__ import annotations

import math

import pytest
from support.lugre.bench import known_rig

from rigd.model.errors import DataError
from rigd_analyses.lugre.trials.known_constants import Known
from rigd_analyses.lugre.trials.trial import LugreConstants

CONSTANTS = LugreConstants(3.9593, 0.05, 0.304, 0.009)


@pytest.mark.parametrize(
    ("name", "known", "words"),
    [
        ("torque_constant", Known(-0.0295, 3e-4), "torque_constant is -0.0295 N m/A"),
        ("gear_ratio", Known(0.0, 0.0), "gear_ratio is 0, must be above 0"),
        ("gear_efficiency", Known(81.0, 0.0), "gear_efficiency is 81, must be at most 1"),
        ("wheel_inertia", Known(0.0, 0.0), "wheel_inertia is 0 kg m^2"),
        ("no_load_torque", Known(-1e-3, 0.0), "must be 0 or more"),
        ("mass", Known(math.inf, 0.0), "mass is inf kg"),
        ("wheel_radius", Known(0.05, math.nan), "uncertainty of wheel_radius"),
        ("wheel_radius", Known(0.05, -1e-4), "uncertainty of wheel_radius"),
        ("guide_lift", Known(-39.0, 0.1), "guide_lift is -39 N, must be below the weight, 38.84 N"),
        ("guide_lift", Known(math.nan, 0.1), "guide_lift is nan N"),
        ("guide_lift", Known(0.0, math.inf), "uncertainty of guide_lift"),
    ],
)
def test_impossible_constant_is_refused_by_name(name: str, known: Known, words: str) -> None:
    with pytest.raises(DataError) as raised:
        known_rig(CONSTANTS, **{name: known})
    assert words in raised.value.message
    assert "--set" in str(raised.value.hint)


def test_guide_that_lifts_takes_load_from_the_wheel() -> None:
    rig = known_rig(CONSTANTS, guide_lift=Known(1.0, 0.2), gravity=Known(9.81, 0.0981))
    load_n = 3.9593 * 9.81 - 1.0
    assert rig.normal_force_n == pytest.approx(load_n)
    assert rig.weight_u == pytest.approx(math.hypot(3.9593 * 0.0981, 0.2) / load_n)
    gravity, lift = rig.load_shares
    assert gravity.effect < 0.0 < lift.effect  # a larger load is less friction over it


def test_losses_may_be_zero() -> None:
    none = Known(0.0, 0.0)
    assert known_rig(CONSTANTS, no_load_torque=none, bearing_torque=none).no_load == none


def test_loss_stated_as_zero_keeps_its_uncertainty() -> None:
    rig = known_rig(
        CONSTANTS,
        no_load_torque=Known(0.0, 2e-4),
        no_load_viscous=Known(0.0, 2e-6),
        motor_inertia=Known(0.0, 1e-7),
        wheel_inertia=Known(4.5e-4, 0.0),
        bearing_torque=Known(0.0, 0.0),
    )
    assert rig.no_load.u == pytest.approx(2e-4 * 0.81 * 20.25)
    assert rig.viscous.u == pytest.approx(2e-6 * 0.81 * 20.25**2)
    assert rig.inertia.u == pytest.approx(1e-7 * 0.81 * 20.25**2)


def test_gear_ratio_that_stands_twice_counts_twice() -> None:
    rig = known_rig(
        CONSTANTS,
        gear_ratio=Known(20.25, 0.1),
        gear_efficiency=Known(0.81, 0.0),
        no_load_viscous=Known(2e-6, 0.0),
    )
    assert rig.viscous.u == pytest.approx(2.0 * 0.1 / 20.25 * rig.viscous.value)
