"""Robots whose contacts, sensors and manoeuvres are drawn: right ones get intervals that hold.

`benchmarks/articulated_coverage.py` plays as many as wanted; these were refused once, though right.
"""

from __future__ import annotations

from pathlib import Path

import pytest
from support.articulated.random_robots import NAMES, random_robot

from rigd.analysis.analysis import Options
from rigd.analysis.evaluation import evaluate
from rigd.analysis.parameters import ParameterEvaluation
from rigd.analysis.result import FitOutcome


@pytest.mark.parametrize(
    "number",
    [
        8,  # noise of its motor speeds is in its torques
        13,  # another optimum of mu_s and mu_d
        15,  # the last frame of a trial has its markers exchanged
        23,  # small steps along a ridge, which end before its lowest place
        74,  # mu_d and mu_s between coarse ones, all of which cost too much
        164,  # the fit ends at a step of the cost
    ],
)
def test_right_robot_is_answered_and_intervals_hold(number: int, tmp_path: Path) -> None:
    robot = random_robot(number, tmp_path)
    assert robot.record(tmp_path / "run.mcap").exit_code == 0
    evaluation = evaluate([tmp_path / "run.mcap"], Options())
    assert isinstance(evaluation, ParameterEvaluation)
    result = evaluation.sections[0].result
    assert result.gate is not None
    assert result.gate.outcome is FitOutcome.FITS
    missed = []
    for name in NAMES:
        entry = result.parameter(name)
        assert entry.low is not None
        assert entry.high is not None
        middle, half = 0.5 * (entry.low + entry.high), 0.5 * (entry.high - entry.low)
        missed.append(abs(robot.truth[name] - middle) / half)
    assert max(missed) < 1.5
    assert sum(off > 1.0 for off in missed) <= 1
