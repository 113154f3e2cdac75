"""Constants that no rig can have are refused by name, value and unit."""

from __future__ import annotations

import math

import pytest
from support.lugre_bench import known_rig

from rigd.model.errors import DataError
from rigd_analyses.lugre.rig.constants import Known
from rigd_analyses.lugre.trial import LugreConstants

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
    ],
)
def test_impossible_constant_is_refused_by_name(name: str, known: Known, words: str) -> None:
    with pytest.raises(DataError) as raised:
        known_rig(CONSTANTS, **{name: known})
    assert words in raised.value.message
    assert "--set" in str(raised.value.hint)


def test_losses_may_be_zero() -> None:
    none = Known(0.0, 0.0)
    assert known_rig(CONSTANTS, no_load_torque=none, bearing_torque=none).no_load == none
