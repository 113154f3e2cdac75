"""Data that the model does not fit: refused, or identified without an undetermined number."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from support.cases import some

from rigd.model.errors import DataError
from rigd_analyses.lugre.model import PARAMETERS
from rigd_analyses.lugre.slip_force.identify import Settings, identify_lugre
from rigd_analyses.lugre.trials.trial import LugreConstants, LugreTrial

Spoil = Callable[[LugreTrial], LugreTrial]
FEW = slice(3, None, 3)  # of ten currents: enough to fit, and quick


def constants(**factors: float) -> Callable[[LugreConstants], LugreConstants]:
    """Return what multiplies constants that a person typed wrong."""
    return lambda c: replace(c, **{name: getattr(c, name) * f for name, f in factors.items()})


def scaled(name: str, factor: float) -> Spoil:
    """Return what multiplies a channel by ``factor``."""
    return lambda trial: replace(trial, **{name: getattr(trial, name) * factor})


def late(trial: LugreTrial) -> LugreTrial:
    """An acceleration that comes 20 ms late."""
    return replace(trial, acceleration_m_s2=np.roll(trial.acceleration_m_s2, 20))


def noisy(trial: LugreTrial) -> LugreTrial:
    noise = np.random.default_rng(1).normal(0.0, 3.0, len(trial.t_s))
    return replace(trial, acceleration_m_s2=trial.acceleration_m_s2 + noise)


WRONG_CONSTANTS = {
    "diameter for radius": constants(wheel_radius_m=2.0),
    "radius 1 % small": constants(wheel_radius_m=0.99),
    "radius 1 % large": constants(wheel_radius_m=1.01),
    "radius half": constants(wheel_radius_m=0.5),
    "mass in pounds": constants(mass_kg=2.2),
    "mass a tenth": constants(mass_kg=0.1),
    "no rolling resistance": constants(rolling_resistance=0.0),
    "rolling resistance tenfold": constants(rolling_resistance=10.0),
    "guide friction tenfold": constants(guide_friction_n=10.0),
}
SPOILT = {
    "acceleration tripled": scaled("acceleration_m_s2", 3.0),
    "acceleration a third": scaled("acceleration_m_s2", 1 / 3),
    "acceleration reversed": scaled("acceleration_m_s2", -1.0),
    "acceleration late": late,
    "acceleration noisy": noisy,
    "carriage 5 % short": scaled("carriage_position_m", 0.95),
    "wheel 5 % short": scaled("wheel_angle_rad", 0.95),
}


@pytest.mark.parametrize("name", some(list(WRONG_CONSTANTS), 2))
def test_a_wrong_constant_gives_no_unknown_number(bench: Callable[..., Any], name: str) -> None:
    rig = bench("stone")
    check(rig.sweep(1)[FEW], WRONG_CONSTANTS[name](rig.constants))


@pytest.mark.parametrize("name", some(list(SPOILT), 2))
def test_a_spoilt_channel_gives_no_unknown_number(bench: Callable[..., Any], name: str) -> None:
    rig = bench("stone")
    check([SPOILT[name](trial) for trial in rig.sweep(1)[FEW]], rig.constants)


def check(trials: Sequence[LugreTrial], known: LugreConstants) -> None:
    """Check that the identification refuses, or leaves nothing on a bound known."""
    try:
        result = identify_lugre(trials, known, Settings(starts=2))
    except DataError as error:
        assert error.message
        return
    text: Any = json.loads(json.dumps(result.to_json(), allow_nan=False))
    bounds = {parameter.name: (parameter.low, parameter.high) for parameter in PARAMETERS}
    for item in (*result.parameters, *result.derived):
        found = text["parameters"].get(item.name) or text["derived"][item.name]
        assert (found["estimate"] is None) == (item.quoted is None)
        ends = bounds.get(item.name)
        if ends is not None and any(math.isclose(item.estimate, e, rel_tol=1e-6) for e in ends):
            assert not item.identifiable, item
    speed = result.parameter("V_s")
    if not result.curve.x[0] <= speed.estimate <= result.curve.x[-1]:
        assert not speed.identifiable
