from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from rigd.analysis.fitting.fit import fit
from rigd.analysis.fitting.model import Model
from rigd.analysis.fitting.uncertainty import (
    autocorrelation_time,
    correlation,
    covariance,
    delta_sd,
    jackknife_sd,
    leave_one_trial_out,
    scaled_pinv,
)

TRIALS, SIZE = 10, 400
T = np.tile(np.linspace(-1.0, 1.0, SIZE), TRIALS)
RHO = 0.9


def coloured(rng: np.random.Generator) -> NDArray[np.float64]:
    """AR(1) noise of unit variance, independent between trials."""
    out = np.empty(TRIALS * SIZE)
    shocks = np.sqrt(1.0 - RHO**2) * rng.standard_normal(len(out))
    for k in range(len(out)):
        out[k] = rng.standard_normal() if k % SIZE == 0 else RHO * out[k - 1] + shocks[k]
    return out


def test_white_noise_gives_the_textbook_covariance(line: Callable[..., Model]) -> None:
    noise = np.random.default_rng(5).standard_normal(len(T))
    model = line(noise, T, TRIALS)
    cov = covariance(model, fit(model), 20)
    design = np.stack([np.ones_like(T), T], axis=1)
    expected = cov.residual_sd**2 * np.linalg.inv(design.T @ design)
    np.testing.assert_allclose(cov.white, expected, rtol=1e-8, atol=1e-12)
    np.testing.assert_allclose(np.diag(cov.coloured), np.diag(expected), rtol=0.35)
    assert cov.residual_sd == np.float64(cov.residual_sd)
    assert abs(cov.residual_sd - 1.0) < 0.03


def test_the_sandwich_covers_where_white_does_not(line: Callable[..., Model]) -> None:
    rng = np.random.default_rng(6)
    repeats = 60
    slopes, white, sandwich = np.empty(repeats), np.empty(repeats), np.empty(repeats)
    for k in range(repeats):
        model = line(coloured(rng), T, TRIALS)
        found = fit(model)
        cov = covariance(model, found, 100)
        slopes[k] = found.theta[1]
        white[k], sandwich[k] = np.sqrt(cov.white[1, 1]), np.sqrt(cov.coloured[1, 1])
    assert np.mean(np.abs(slopes) < 1.96 * white) < 0.65
    assert np.mean(np.abs(slopes) < 1.96 * sandwich) > 0.85


def test_autocorrelation_time_of_a_known_process() -> None:
    rng = np.random.default_rng(7)
    slices = tuple(slice(i * SIZE, (i + 1) * SIZE) for i in range(TRIALS))
    times = [
        autocorrelation_time(coloured(rng), np.ones(TRIALS * SIZE), slices, 100) for _ in range(30)
    ]
    exact = (1.0 + RHO) / (1.0 - RHO)
    assert 0.75 * exact < np.mean(times) < 1.1 * exact
    white = rng.standard_normal(TRIALS * SIZE)
    assert autocorrelation_time(white, np.ones(TRIALS * SIZE), slices, 100) < 1.6


def test_vibration_does_not_make_coloured_residuals_look_white() -> None:
    rng = np.random.default_rng(17)
    t = np.arange(4000) * 1e-3
    smooth = np.convolve(rng.standard_normal(len(t) + 30), np.full(31, 1.0 / 31), "valid")
    residuals = smooth + 1.5 * np.std(smooth) * np.sin(2.0 * np.pi * 25.0 * t)
    tau = autocorrelation_time(residuals, np.ones(len(t)), (slice(0, len(t)),), 150)
    # All lags together give nearly nothing: what the smoothing adds, the vibration takes away.
    assert 5.0 < tau < 31.0


def test_alternating_residuals_are_never_better_than_white() -> None:
    r = np.tile([1.0, -1.0], 500)
    assert autocorrelation_time(r, np.ones(1000), (slice(0, 1000),), 100) == 1.0


def test_jackknife_agrees_with_the_spread_between_trials(line: Callable[..., Model]) -> None:
    rng = np.random.default_rng(8)
    offsets = np.repeat(rng.standard_normal(TRIALS), SIZE)
    model = line(offsets, T, TRIALS)
    thetas = leave_one_trial_out(model, fit(model))
    sd = jackknife_sd(lambda theta: theta[:1], thetas)
    assert abs(float(sd[0]) / (np.std(offsets[::SIZE], ddof=1) / np.sqrt(TRIALS)) - 1.0) < 1e-6


def test_a_parameter_on_its_bound_has_no_variance(decay: Callable[..., Model]) -> None:
    t = np.linspace(0.0, 1.0, 300)
    flat = decay(np.ones_like(t), t)  # k wants 0 and stops at its lower bound
    cov = covariance(flat, fit(flat), 20)
    assert cov.on_bound == (False, True)
    assert cov.white[1, 1] == 0.0
    assert correlation(cov.white)[1, 1] == 1.0


def test_delta_method_matches_variance_of_sum() -> None:
    cov = np.array([[4.0, 1.0], [1.0, 9.0]])
    np.testing.assert_allclose(delta_sd(np.array([[1.0, 1.0]]), cov), np.sqrt(15.0))


def test_singular_information_is_not_inverted_into_huge_numbers() -> None:
    information = np.outer([1.0, 1e6], [1.0, 1e6])
    assert np.max(np.abs(scaled_pinv(information))) < 1.0
