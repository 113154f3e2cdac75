"""Output error on rigs drawn at random, whose constants are measured with their uncertainties."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from support.lugre.random_rigs import measured, random_rig

from rigd.analysis import Options
from rigd.analysis.evaluation import evaluate
from rigd.analysis.parameters import ParameterEvaluation
from rigd_analyses.lugre.model import friction
from rigd_analyses.lugre.rig.ridge import KEPT_M_S, with_speed

#: What each data set is known to leave open; `benchmarks/identify_coverage.py` has many more.
OPEN = {
    # mu_s is 0.4 % above mu_c. By chance a Stribeck effect below 1 mm/s fits better.
    ("stone", 12): {"V_s"},
    # The fit first ends at mu_c = 0.001 on the ridge of V_s, from which another law fits better.
    ("paperboard", 3): {"V_s", "mu_c"},
    ("pvc", 1): set(),
}


@pytest.mark.parametrize("speed", [0.005, 0.5, 3.0])
def test_point_along_ridge_keeps_friction_at_two_slips(speed: float) -> None:
    theta = np.array([4.42, 1.55e-3, 3.486, 80.06, 0.534, 2.508, 0.05])
    moved = with_speed(theta, speed)
    assert moved[0] == speed
    assert moved[3:] == pytest.approx(theta[3:], rel=1e-12)
    slips = np.array(KEPT_M_S)
    assert friction(moved[:6], slips) == pytest.approx(friction(theta[:6], slips), rel=1e-9)


@pytest.mark.parametrize(("floor", "number"), OPEN)
def test_intervals_hold_truth_of_hidden_rig(floor: str, number: int, tmp_path: Path) -> None:
    rig = random_rig(number, floor, tmp_path)
    rig.record(tmp_path / "run.mcap", seed=number)
    evaluation = evaluate([measured(tmp_path / "run.mcap", number, floor)], Options())
    assert isinstance(evaluation, ParameterEvaluation)
    assert evaluation.fits
    result = evaluation.sections[0].result
    assert result.parameter("sigma_0").identifiable and result.parameter("sigma_1").identifiable
    for name, truth in rig.truth.items():
        entry = result.parameter(name)
        assert not (entry.identifiable and name in OPEN[floor, number]), entry
        if entry.low is not None and entry.high is not None:
            assert entry.low <= truth <= entry.high, entry
    assert (
        (result.curve.low <= rig.friction(result.curve.x))
        & (rig.friction(result.curve.x) <= result.curve.high)
    ).all()
