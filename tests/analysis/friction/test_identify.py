"""The band of a fitted law agrees with the intervals of its parameters."""

from __future__ import annotations

import numpy as np
import pytest

from rigd.analysis import Options
from rigd.analysis.friction import FrictionLaw, LawParameter, SlipForce, step
from rigd.analysis.friction.identify import SlipData, identify_law
from rigd.analysis.result import FloatArray, Preprocessing

SAMPLES, TRIALS, MU = 600, 8, 0.3


@step
def _dry(
    state: FloatArray, theta: FloatArray, between: float, slip: float, rolling: float, dt: float
) -> float:
    return float(theta[0] * np.sign(slip))


class Dry(FrictionLaw):
    """Dry friction alone: its steady curve is its one parameter."""

    parameters = (LawParameter("mu", "1", 1e-3, 10.0, 0.2, symbol="mu", meaning="friction"),)
    step = _dry

    @staticmethod
    def steady(theta: FloatArray, slip_m_s: FloatArray, rolling_m_s: float) -> FloatArray:
        return np.asarray(theta[0] * np.sign(slip_m_s))


def _trial(number: int, offset: float) -> SlipForce:
    rng = np.random.default_rng([3, number])
    slip = np.concatenate([[0.0], np.linspace(0.01, 0.1, SAMPLES - 1)])
    force = (MU + offset * rng.standard_normal()) * np.sign(slip)
    force += 0.02 * rng.standard_normal(SAMPLES)
    return SlipForce(str(number), 1e-3, slip, force, np.sign(slip))


@pytest.mark.parametrize("offset", [0.0, 4e-3])
def test_band_is_as_wide_as_interval(offset: float) -> None:
    """Trials whose friction differs widen both, by the jackknife."""
    trials = [_trial(number, offset) for number in range(TRIALS)]
    data = SlipData(
        trials, "", "", Preprocessing((), {}, {}), window_s=0.2, least_slip_m_s=0.0,
        shown=lambda predicted: (),
    )  # fmt: skip
    found = identify_law("dry", Dry, data, Options(starts=1))
    (mu,), curve = found.parameters, found.curve
    assert mu.low is not None and mu.high is not None
    np.testing.assert_allclose(curve.low, mu.low, rtol=0.1 * (mu.high / mu.low - 1.0))
    np.testing.assert_allclose(curve.high, mu.high, rtol=0.1 * (mu.high / mu.low - 1.0))
