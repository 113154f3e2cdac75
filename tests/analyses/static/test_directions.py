"""Friction that differs by direction is told, and the mean of both is no friction of either."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from support.cases import some
from support.logged import FloatArray, LoggedTable, logged

from rigd.analysis import Options
from rigd.analysis.parameters import ParameterEvaluation
from rigd.analysis.result import IdentificationResult
from rigd_analyses.static.analysis import StaticFrictionAnalysis

SPEEDS_M_S = (1e-3, 2e-3, 5e-3, 1e-2, 2e-2, 5e-2, 1e-1)
COULOMB_N = 5.0


def strokes() -> FloatArray:
    """Speeds in m/s of strokes of 3 s both ways, at 100 Hz."""
    return np.concatenate([np.full(300, side * v) for v in SPEEDS_M_S for side in (1.0, -1.0)])


def friction(speed: FloatArray) -> FloatArray:
    size = np.abs(speed)
    return np.sign(speed) * (COULOMB_N + np.exp(-((size / 0.005) ** 2)) + 20.0 * size)


def drifting(count: int, seed: int, tau_rows: float, sd: float) -> FloatArray:
    """Noise that remembers its value for ``tau_rows`` rows."""
    keeps = np.exp(-1.0 / tau_rows)
    steps = np.random.default_rng(seed).normal(0.0, sd * np.sqrt(1.0 - keeps**2), count)
    noise = np.zeros(count)
    for k in range(1, count):
        noise[k] = keeps * noise[k - 1] + steps[k]
    return noise


def found(
    path: Path, speed: FloatArray, force: FloatArray, dt: float = 0.01
) -> ParameterEvaluation:
    columns = {"speed": ("m/s", speed), "force": ("N", force)}
    t_s: FloatArray = dt * np.arange(len(speed), dtype=np.float64)
    table = LoggedTable(t_s, columns)
    sweep = logged(path, {"log": table}, "static-friction")
    evaluation = StaticFrictionAnalysis().evaluate([sweep], Options(starts=2), lambda _: None)
    assert isinstance(evaluation, ParameterEvaluation)
    return evaluation


def each(evaluation: ParameterEvaluation) -> tuple[IdentificationResult, IdentificationResult]:
    """Return the results forward and backward, which name the difference first of all."""
    assert [x.label for x in evaluation.sections] == ["logged, forward", "logged, backward"]
    forward, backward = (section.result for section in evaluation.sections)
    assert forward.warnings[0] == backward.warnings[0]
    return forward, backward


def half_difference(said: str) -> tuple[float, float]:
    """Return what a sentence states of half the difference, with half its interval."""
    match = re.search(r"half the difference is ([-−\d.]+) ± ([\d.]+) N", said)
    assert match is not None, said
    value, half = (text.replace("−", "-") for text in match.groups())
    return float(value), float(half)


@pytest.mark.parametrize("seed", some([1, 2, 3, 4], 4, 1))
@pytest.mark.parametrize("noise", ["white", "drifting"])
def test_zero_of_the_sensor_parts_the_directions(noise: str, seed: int, tmp_path: Path) -> None:
    """It was one friction of both, without a word, or an error that lasts."""
    speed = strokes()
    white = np.random.default_rng(seed).normal(0.0, 0.2, len(speed))
    error = white if noise == "white" else drifting(len(speed), seed, 50.0, 0.2)
    forward, backward = each(found(tmp_path / "a.mcap", speed, friction(speed) + 0.8 + error))
    value, half = half_difference(forward.warnings[0])
    assert abs(value - 0.8) < 2.0 * half
    for result, truth in ((forward, COULOMB_N + 0.8), (backward, COULOMB_N - 0.8)):
        item = result.parameter("F_c")
        assert item.low is not None and item.high is not None
        assert abs(truth - 0.5 * (item.low + item.high)) < item.high - item.low
    assert noise == "drifting" or "same at all speeds" in forward.warnings[0]


@pytest.mark.parametrize("seed", some([1, 2, 3, 4], 4, 1))
def test_joint_with_loud_memory_is_not_pooled(seed: int, tmp_path: Path) -> None:
    """Published before as 5.3 N ± 2.9 %: forward it is 6.1 N, backward 4.5 N."""
    dt = 0.0156
    speed = 6.3e-3 * np.sin(2.0 * np.pi * dt * np.arange(11_500) / 12.0)
    force = np.sign(speed) * 5.3 + 0.8 + drifting(len(speed), seed, 7.2, 1.6)
    forward, _ = each(found(tmp_path / "a.mcap", speed, force, dt))
    value, half = half_difference(forward.warnings[0])
    assert abs(value - 0.8) < 2.0 * half
    assert "these data cannot tell" in forward.warnings[0]


def test_difference_that_follows_friction_is_no_zero(tmp_path: Path) -> None:
    speed = strokes()
    noise = np.random.default_rng(5).normal(0.0, 0.1, len(speed))
    force = friction(speed) * np.where(speed > 0.0, 1.1, 0.9) + noise
    forward, _ = each(found(tmp_path / "a.mcap", speed, force))
    assert "grows and falls with the friction" in forward.warnings[0]


@pytest.mark.parametrize("seed", some([1, 2, 3, 4], 4, 1))
@pytest.mark.parametrize("tau_rows", [0.01, 50.0, 1000.0])
def test_directions_that_agree_stay_one_friction(
    tau_rows: float, seed: int, tmp_path: Path
) -> None:
    speed = strokes()
    force = friction(speed) + drifting(len(speed), seed, tau_rows, 0.2)
    (section,) = found(tmp_path / "a.mcap", speed, force).sections
    (test,) = [x for x in section.result.residual_tests if x.name == "agreement of directions"]
    assert test.passed
    assert re.search(r"friction forward \d.* N, backward \d.* ± .* N", test.sentence)


def test_strokes_one_way_test_no_direction(tmp_path: Path) -> None:
    speed = np.abs(strokes())
    noise = np.random.default_rng(6).normal(0.0, 0.2, len(speed))
    (section,) = found(tmp_path / "a.mcap", speed, friction(speed) + noise).sections
    assert not [x for x in section.result.residual_tests if "directions" in x.name]
