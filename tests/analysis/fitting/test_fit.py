from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from rigd.analysis.fitting.fit import Affine, Loss, fit, multi_start, robust_fit, robust_weights
from rigd.analysis.fitting.model import (
    FitParameter,
    Model,
    NormalEquations,
    Scaling,
    stacked_normal_equations,
)
from rigd.model.errors import DataError

FloatArray = NDArray[np.float64]
T = np.linspace(0.0, 3.0, 200)
TRUTH = np.array([5.0, 2.5])
CLEAN = TRUTH[0] * np.exp(-TRUTH[1] * T)


def test_recovers_a_known_nonlinear_model_exactly(decay: Callable[..., Model]) -> None:
    found = fit(decay(CLEAN, T))
    assert found.converged
    np.testing.assert_allclose(found.theta, TRUTH, rtol=1e-8)
    assert found.cost < 1e-14


@pytest.mark.parametrize("start", [[1e-3, 1e-3], [900.0, 0.01], [0.01, 20.0]])
def test_fit_converges_from_distant_starts(decay: Callable[..., Model], start: list[float]) -> None:
    np.testing.assert_allclose(fit(decay(CLEAN, T), np.array(start)).theta, TRUTH, rtol=1e-6)


def test_a_linear_model_takes_the_least_squares_solution(line: Callable[..., Model]) -> None:
    noisy = 2.0 - 3.0 * T + 0.1 * np.random.default_rng(4).standard_normal(len(T))
    expected = np.linalg.lstsq(np.stack([np.ones_like(T), T], axis=1), noisy, rcond=None)[0]
    np.testing.assert_allclose(fit(line(noisy, T)).theta, expected, rtol=1e-6)


def test_fit_at_a_bound_continues_with_other_parameters(decay: Callable[..., Model]) -> None:
    model = decay(CLEAN, T)
    held = replace(
        model, parameters=(model.parameters[0], FitParameter("k", "1/s", 1e-3, 2.0, 1.0))
    )  # type: ignore[type-var]
    found = fit(held)
    assert found.theta[1] == pytest.approx(2.0, rel=1e-12)
    shape = np.exp(-2.0 * T)
    assert found.theta[0] == pytest.approx(float(CLEAN @ shape / (shape @ shape)), rel=1e-6)


def test_fit_keeps_a_held_combination(decay: Callable[..., Model]) -> None:
    direction = np.array([1.0, 1.0])
    found = fit(decay(CLEAN, T), affine=Affine.holding(direction, 1.0))
    assert float(direction @ found.scaled) == pytest.approx(1.0, abs=1e-12)
    free = fit(decay(CLEAN, T))
    kept = Affine.holding(direction, float(direction @ free.scaled))
    np.testing.assert_allclose(fit(decay(CLEAN, T), affine=kept).theta, TRUTH, rtol=1e-6)


def test_more_starts_are_repeatable_and_sorted(decay: Callable[..., Model]) -> None:
    first = multi_start(decay(CLEAN, T), starts=6, seed=3)
    again = multi_start(decay(CLEAN, T), starts=6, seed=3)
    assert [f.cost for f in first] == sorted(f.cost for f in first)
    for a, b in zip(first, again, strict=True):
        np.testing.assert_array_equal(a.theta, b.theta)
    assert not np.array_equal(
        first[1].start, multi_start(decay(CLEAN, T), starts=6, seed=4)[1].start
    )


def test_a_robust_loss_beats_squares_under_outliers(decay: Callable[..., Model]) -> None:
    rng = np.random.default_rng(11)
    spoiled = CLEAN + 0.02 * rng.standard_normal(len(T))
    spoiled[rng.choice(len(T), 20, replace=False)] += 3.0
    model = decay(spoiled, T)
    plain = fit(model)
    robust = robust_fit(model, plain, Loss.HUBER)
    plain_error = float(np.max(np.abs(plain.theta / TRUTH - 1.0)))
    robust_error = float(np.max(np.abs(robust.theta / TRUTH - 1.0)))
    assert robust_error < 0.02
    assert robust_error < 0.2 * plain_error


def test_robust_weights_leave_the_bulk_alone() -> None:
    residuals = np.concatenate([np.random.default_rng(2).standard_normal(1000), [50.0]])
    weights = robust_weights(residuals, np.ones(1001), Loss.HUBER)
    assert np.mean(weights[:-1] == 1.0) > 0.75
    assert weights[-1] < 0.05
    np.testing.assert_array_equal(
        robust_weights(residuals, np.ones(1001), Loss.SQUARES), np.ones(1001)
    )


def test_a_cost_that_is_not_finite_is_refused(decay: Callable[..., Model]) -> None:
    broken = CLEAN.copy()
    broken[3] = np.nan
    with pytest.raises(DataError, match="not finite"):
        fit(decay(broken, T))


@dataclass(frozen=True)
class Residuals:
    """As many residuals as parameters, as a model of one trial."""

    of: Callable[[FloatArray], FloatArray]
    by: Callable[[FloatArray], FloatArray]
    most: float
    start: tuple[float, ...]

    @property
    def parameters(self) -> tuple[FitParameter, ...]:
        box = (-50.0, self.most)
        return tuple(
            FitParameter(f"x{k}", "1", *box, start, Scaling.LINEAR)
            for k, start in enumerate(self.start)
        )

    @property
    def trial_slices(self) -> tuple[slice, ...]:
        return (slice(0, len(self.start)),)

    @property
    def mask(self) -> FloatArray:
        return np.ones(len(self.start))

    def residuals(self, theta: FloatArray) -> FloatArray:
        return self.of(theta)

    def jacobian(self, theta: FloatArray) -> FloatArray:
        return self.by(theta)

    def cost(self, theta: FloatArray, weights: FloatArray | None = None) -> float:
        return 0.5 * float(self.of(theta) @ self.of(theta))

    def normal_equations(
        self, theta: FloatArray, weights: FloatArray | None = None
    ) -> NormalEquations:
        return stacked_normal_equations(self.of(theta), self.by(theta), self.mask)


def test_bound_on_a_ridge_takes_few_steps() -> None:
    """A step that is cut at the bound alone would raise the cost by its part across the ridge."""
    random = np.random.default_rng(1)
    left, right = (np.linalg.qr(random.standard_normal((5, 5)))[0] for _ in range(2))
    matrix = left @ np.diag(np.geomspace(1e3, 0.1, 5)) @ right.T
    aim = matrix @ np.full(5, 2.0) + left @ np.full(5, 3.0)
    model = Residuals(lambda q: matrix @ q - aim, lambda _: matrix, 3.0, (1.5,) * 5)
    expected = lsq_linear(matrix, aim, (-50.0, 3.0), tol=1e-14).x
    assert np.count_nonzero(expected > 2.999) == 2
    found = fit(model, relative_decrease=1e-9, damping=1e-8, thorough=True)
    assert found.iterations <= 5
    np.testing.assert_allclose(found.theta, expected, atol=1e-3)


def test_bent_ridge_is_followed_in_few_steps() -> None:
    model = Residuals(
        lambda q: np.array([1e4 * (q[1] - q[0] ** 2), 5.0 - q[0]]),
        lambda q: np.array([[-2e4 * q[0], 1e4], [-1.0, 0.0]]),
        50.0,
        (-1.0, 1.0),
    )
    found = fit(model, relative_decrease=1e-9, damping=1e-8, thorough=True, ridges=True)
    np.testing.assert_allclose(found.theta, [5.0, 25.0], atol=1e-3)
    assert found.converged


def test_parameters_of_one_effect_are_fitted() -> None:
    matrix = np.full((2, 2), 1024.0)
    aim = np.full(2, 4096.0)
    model = Residuals(lambda q: matrix @ q - aim, lambda _: matrix, 50.0, (0.0, 1.0))
    found = fit(model, damping=0.0, thorough=True)
    assert found.converged
    assert float(np.sum(found.theta)) == pytest.approx(4.0, abs=1e-6)
