"""The span of a scale: what it is, what it rests on, and what is no calibration."""

from __future__ import annotations

import numpy as np
import pytest

from rigd.analysis.calibration.result import CalibrationResult
from rigd_analyses.approach_angle.calibration.scale import calibrate_scale

WEIGHTS = np.array([0.0, 2.0, 4.0, 6.0, 8.0, 6.0, 4.0, 2.0, 0.0])


def calibrated(shown: np.ndarray) -> CalibrationResult:
    return calibrate_scale(WEIGHTS, shown, u_weight=3e-4, division_kg=0.01)


def test_the_true_span_lies_in_the_interval() -> None:
    random = np.random.default_rng(3)
    scores = []
    for _ in range(100):
        gain = 1.0 + 2e-3 * random.normal()
        weights = WEIGHTS * (1.0 + 3e-4 * random.normal())  # a set is off as a whole
        readings = gain * weights[:, None] + 0.02 + 0.008 * random.normal(size=(9, 12))
        found = calibrated(np.round(readings, 2).mean(axis=1)).measured["load_scale"]
        scores.append((found.value - 1.0 / gain) / found.u)
    assert np.mean(np.abs(scores) < 2.0) >= 0.93


def test_zero_linearity_and_hysteresis_are_reported() -> None:
    shown = WEIGHTS + 0.020
    shown[6] += 0.012  # at 4 kg on the way down
    zero, linearity = calibrated(shown).facts
    assert "empty it shows +2" in zero
    assert "up and down differ by at most 12.0 g" in linearity


@pytest.mark.parametrize(
    ("shown", "part"),
    [
        (0.5 * WEIGHTS, "shows 0.500 kg for each kg"),
        (-WEIGHTS, "shows -1.000 kg for each kg"),
        (WEIGHTS + 0.2 * (WEIGHTS == 8.0), "off the straight line"),
    ],
)
def test_data_without_a_calibration_are_refused(shown: np.ndarray, part: str) -> None:
    result = calibrated(shown)
    assert not result.measured
    assert any(part in refusal for refusal in result.refusals)


def test_three_weights_are_too_few() -> None:
    few = WEIGHTS < 5.0
    result = calibrate_scale(WEIGHTS[few], WEIGHTS[few], u_weight=3e-4, division_kg=0.01)
    assert "4 different weights are needed" in result.refusals[0]


@pytest.mark.parametrize("weights", [[0.0, 2.0, 4.0, 8.0], [0.0, 2.0, 4.0, 6.0, 8.0]])
def test_scatter_of_few_readings_is_widened(weights: list[float]) -> None:
    """Two or three degrees of freedom show the scatter badly: 2 u held 82 of 100 then."""
    random, laid = np.random.default_rng(4), np.array(weights)
    held = []
    for _ in range(300):
        shown = laid + 0.02 * random.normal(size=len(laid))
        found = calibrate_scale(laid, shown, u_weight=1e-5, division_kg=1e-4)
        value = found.measured["load_scale"]
        held.append(abs(value.value - 1.0) < 2.0 * value.u)
    assert np.mean(held) >= 0.92


@pytest.mark.parametrize("laid", [np.arange(9.0), np.array([0.0, 0.0, 2.0, 4.0, 8.0])])
def test_weights_laid_on_alone_show_no_hysteresis(laid: np.ndarray) -> None:
    found = calibrate_scale(laid, laid, u_weight=1e-4, division_kg=0.01)
    assert "not seen" in found.facts[1]
    assert "differ by" not in found.facts[1]
