"""Friction along the guide from a saved model: what is taken of it, and which files are refused."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.lugre.bench import FLOORS
from support.lugre.lateral_bench import DRY, VISCOUS, LateralBench
from support.lugre.model import PVC, saved_model

from rigd.analysis import ConfigError
from rigd.analysis.output_error.system import Unknown
from rigd.analysis.result import FitOutcome
from rigd.analysis.validation.saved_models import read_models
from rigd_analyses.lugre.lateral.family import find_lateral
from rigd_analyses.lugre.lateral.result import result
from rigd_analyses.lugre.lateral.saved_friction import Carried, carried
from rigd_analyses.lugre.model import MU_C, PARAMETERS, RATIO, SIGMA_0, V_S
from rigd_analyses.lugre.trials.known_constants import RigConstants

RIGS = ("lugre-1",)
HERE = {"floor": "pvc"}
STATED = {
    "V_s": (4.4e-3, None, None),
    "mu_c": (0.12, 0.119, 0.121),
    "mu_s": (0.15, 0.147, 0.153),
    "sigma_0": (49.9, 49.0, 50.5),
}


def model(folder: Path, **change: Any) -> Path:
    """Write a model of PVC on lugre-1 with ``change`` in it; None takes a key away."""
    path = saved_model(folder, **change.pop("inside", {}))
    data = json.loads(path.read_text())
    ends = {
        name: {"estimate": value, "low": low, "high": high}
        for name, (value, low, high) in STATED.items()
    }
    data |= {"rigs": list(RIGS), "parameters": ends} | change
    path.write_text(json.dumps({key: item for key, item in data.items() if item is not None}))
    return path


def test_intervals_become_what_is_known(tmp_path: Path) -> None:
    found = carried(read_models(model(tmp_path)), HERE, RIGS)
    assert [item.parameter.start for item in found.unknowns] == pytest.approx(list(PVC))
    u = [item.u for item in found.unknowns]
    assert u[MU_C] == pytest.approx(math.log(0.12 / 0.119) / 1.96, rel=1e-3)
    assert u[SIGMA_0] == pytest.approx(math.log(49.9 / 49.0) / 1.96, rel=1e-3)  # the wider side
    assert u[RATIO] == pytest.approx(math.hypot(u[MU_C], math.log(0.15 / 0.147) / 1.96), rel=1e-3)
    assert math.isinf(u[V_S])
    assert "Fitted along, because it gives no interval: V_s" in found.sentence


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"conditions": {"floor": "stone"}}, "is of floor stone, the trials are of pvc"),
        ({"rigs": ["lugre-2"]}, "is of the rig lugre-2, the trials are of lugre-1"),
        ({"rigs": None}, "does not name its rig: an earlier version"),
        ({"fit": None}, "no end point of a fit: an earlier version"),
        ({"model": "lugre-lateral"}, "is a model of lugre-lateral"),
        ({"inside": {"names": ["mu", "sigma_0"]}}, "has another law"),
        ({"gate": {"outcome": "does not fit"}}, "did not fit the recordings"),
    ],
)
def test_model_that_does_not_belong_is_refused(
    tmp_path: Path, change: dict[str, Any], message: str
) -> None:
    with pytest.raises(ConfigError, match=message):
        carried(read_models(model(tmp_path, **change)), HERE, RIGS)


def known(floor: str) -> Carried:
    """Return the friction of a floor, as well known as an identification gives it."""
    f = FLOORS[floor]
    truth = (f.v_s, f.mu_c, np.log(f.mu_s / f.mu_c), f.s0, f.s1, f.s2)
    u = {V_S: math.inf, RATIO: math.inf}
    unknowns = [
        Unknown(replace(item, start=float(x)), u.get(k, 0.01), f"{item.meaning}, by {floor}")
        for k, (item, x) in enumerate(zip(PARAMETERS, truth, strict=True))
    ]
    return Carried(floor, tuple(unknowns))


def test_known_friction_needs_one_current(lateral_bench: LateralBench, rig: RigConstants) -> None:
    trials = lateral_bench.sweep(2, (0.2, 0.65), (0.9,))
    found = find_lateral(trials, rig, lateral_bench.constants, friction=known("stone"))
    assert found.gate.outcome is FitOutcome.FITS
    shown = result(found)
    for name, value in {"mu_R_dry": DRY, "mu_R_vis": VISCOUS}.items():
        entry = shown.parameter(name)
        assert entry.low is not None and entry.high is not None
        assert entry.low <= value <= entry.high
    assert any("friction along the guide is that of stone" in line
               for line in shown.preprocessing.statements)  # fmt: skip


def test_friction_of_another_floor_is_named(lateral_bench: LateralBench, rig: RigConstants) -> None:
    trials = lateral_bench.sweep(2, (0.2, 0.65), (0.9,))
    found = find_lateral(trials, rig, lateral_bench.constants, friction=known("pvc"))
    assert found.gate.outcome is FitOutcome.MISFIT
    assert "another normalised bristle stiffness, by pvc" in found.gate.sentence
    assert all(entry.quoted is None for entry in result(found).parameters)
