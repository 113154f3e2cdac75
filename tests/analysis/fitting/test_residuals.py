from __future__ import annotations

import numpy as np
import pytest

from rigd.analysis.fitting.residuals import (
    autocorrelation,
    goodness,
    ljung_box,
    normality,
    outliers,
)

WHITE = [np.random.default_rng(s).standard_normal(800) for s in range(6)]
COLOURED = [np.convolve(w, np.ones(10) / 10.0, mode="valid") for w in WHITE]


def test_short_trials_have_a_whiteness_test() -> None:
    for count in (21, 20, 8, 4):
        p_value = ljung_box([WHITE[0][:count]], 20).p_value
        assert p_value is not None
        assert 0.0 < p_value <= 1.0


def test_whiteness_separates_white_from_smoothed_noise() -> None:
    assert ljung_box(WHITE, 20).passed
    assert not ljung_box(COLOURED, 20).passed


def test_autocorrelation_matches_a_moving_average() -> None:
    found = autocorrelation(COLOURED, 30, 1e-3)
    assert found.lag_s[0] == pytest.approx(1e-3)
    assert found.value[4] == pytest.approx(0.5, abs=0.1)
    assert np.mean(np.abs(autocorrelation(WHITE, 100, 1e-3).value) < found.band) > 0.9


def test_heavy_tails_and_outliers_are_seen() -> None:
    clean = np.concatenate(WHITE)
    spoiled = clean.copy()
    spoiled[::200] = 12.0
    assert normality(clean, 1.0).passed
    assert not normality(spoiled, 1.0).passed
    assert outliers(clean).passed
    assert not outliers(spoiled).passed
    assert outliers(spoiled).statistic == pytest.approx(1.0 / 200.0)


def test_goodness_of_exact_and_of_constant_fit() -> None:
    y = np.arange(10.0)
    assert goodness(y, y) == (0.0, 1.0)
    rms, r_squared = goodness(y, np.full(10, 4.5))
    assert rms == pytest.approx(np.sqrt(8.25))
    assert r_squared == pytest.approx(0.0)
