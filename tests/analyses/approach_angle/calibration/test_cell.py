"""Scale and zero of the load cell: what they are, what they rest on, and what is no calibration."""

from __future__ import annotations

import numpy as np
import pytest

from rigd.analysis.calibration.result import CalibrationResult
from rigd_analyses.approach_angle.calibration.cell import CellBench, calibrate_cell

LOADS = np.array([2.0, 4.0, 6.0, 8.0, 8.0, 6.0, 4.0, 2.0])
BENCH = CellBench(load_scale=1.0, u_load_scale=6e-4, division_kg=0.01, gravity=9.81)
N_PER_V, ZERO_V = 20.0, 0.09


def volts(kg: np.ndarray) -> np.ndarray:
    return np.asarray(9.81 * kg / N_PER_V + ZERO_V)


def calibrated(shown: np.ndarray, cell: np.ndarray) -> CalibrationResult:
    return calibrate_cell(LOADS, shown, cell, BENCH)


def test_true_scale_and_zero_lie_in_intervals() -> None:
    """Bolts scatter by 1 %; the span of the scale errs within its uncertainty."""
    random = np.random.default_rng(3)
    scores = []
    for _ in range(100):
        true = LOADS * (1.0 + 0.01 * random.normal(size=len(LOADS)))
        span = 1.0 + 6e-4 * random.normal()
        shown = np.round(span * true[:, None] + 0.008 * random.normal(size=(8, 12)), 2).mean(axis=1)
        found = calibrated(shown, volts(true) + 1e-3 * random.normal(size=len(LOADS))).measured
        for name, value in (("normal_force_scale", N_PER_V), ("normal_force_zero", ZERO_V)):
            scores.append((found[name].value - value) / found[name].u)
    assert np.mean(np.abs(scores) < 2.0) >= 0.93
    assert np.sqrt(np.mean(np.square(scores))) > 0.5  # nor is it far too wide


@pytest.mark.parametrize(
    ("shown", "cell", "part"),
    [
        (LOADS, -volts(LOADS), "signal wires are swapped"),
        (LOADS, np.full(8, 0.09), "does not answer to the load"),
        (LOADS, np.minimum(volts(LOADS), 3.5), "off the straight line"),
        (LOADS, np.where(LOADS == 4.0, 2.2, volts(LOADS)), "off the straight line"),
        (LOADS / 2.2046, volts(LOADS), "load 1: the scale shows 0.91 kg while 2 kg were announced"),
        (LOADS * np.nan, volts(LOADS), "load 1: the scale shows nan kg"),
    ],
)
def test_data_without_a_calibration_are_refused(
    shown: np.ndarray, cell: np.ndarray, part: str
) -> None:
    result = calibrated(shown, cell)
    assert not result.measured
    assert any(part in refusal for refusal in result.refusals)


def test_three_loads_are_too_few() -> None:
    few = LOADS < 7.0
    result = calibrate_cell(LOADS[few], LOADS[few], volts(LOADS[few]), BENCH)
    assert "4 different loads above 0 are needed" in result.refusals[0]
