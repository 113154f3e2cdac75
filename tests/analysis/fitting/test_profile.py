from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from rigd.analysis.fitting.fit import fit
from rigd.analysis.fitting.model import (
    FitParameter,
    Model,
    NormalEquations,
    Scaling,
    stacked_normal_equations,
)
from rigd.analysis.fitting.profile import AGREES, axis, crossing, follow, natural_ends, scan
from rigd.analysis.fitting.uncertainty import covariance

FloatArray = NDArray[np.float64]
T = np.linspace(-1.0, 1.0, 2000)


def test_on_linear_model_profile_is_gaussian_interval(
    line: Callable[..., Model],
) -> None:
    noise = 0.3 * np.random.default_rng(9).standard_normal(len(T))
    model = line(1.0 + 2.0 * T + noise, T)
    best = fit(model)
    sd = float(np.sqrt(covariance(model, best, 50).white[1, 1]))
    grid = best.theta[1] + sd * np.linspace(-6.0, 6.0, 25)
    found = scan(model, best, axis(2, 1), grid, inflation=1.0)
    low, high = natural_ends(model, 1, found)
    assert low is not None and high is not None
    assert low == pytest.approx(best.theta[1] - 1.96 * sd, abs=0.01 * sd)
    assert high == pytest.approx(best.theta[1] + 1.96 * sd, abs=0.01 * sd)


def test_inflation_widens_by_its_root(line: Callable[..., Model]) -> None:
    noise = 0.3 * np.random.default_rng(10).standard_normal(len(T))
    model = line(1.0 + 2.0 * T + noise, T)
    best = fit(model)
    sd = float(np.sqrt(covariance(model, best, 50).white[1, 1]))
    grid = best.theta[1] + sd * np.linspace(-12.0, 12.0, 49)
    widths = []
    for inflation in (1.0, 4.0):
        found = scan(model, best, axis(2, 1), grid, inflation=inflation)
        assert found.low is not None and found.high is not None
        widths.append(found.high - found.low)
    assert widths[1] / widths[0] == pytest.approx(2.0, rel=0.01)


def test_known_value_of_profile_leaves_the_rest(decay: Callable[..., Model]) -> None:
    """What is left of a quantity beside the profile is not what the profile itself allows."""
    t = np.linspace(0.0, 1.0, 300)
    noise = 0.05 * np.random.default_rng(14).standard_normal(300)
    model = decay(np.exp(-t / 0.3) + noise, t)
    best = fit(model)
    inverse = covariance(model, best, 30).white
    found = follow(model, best, axis(2, 1), inverse, (-10.0, 10.0))
    assert len(found.values) >= 3
    for held in map(found.held, range(len(found.values))):
        assert abs(held[1, 1]) < 1e-9 * inverse[1, 1]
        assert held[0, 0] > 0.0


def test_accepted_points_of_few_refits_reach_the_ends(decay: Callable[..., Model]) -> None:
    t = np.linspace(0.0, 1.0, 300)
    noise = 0.05 * np.random.default_rng(13).standard_normal(300)
    model = decay(np.exp(-t / 0.3) + noise, t)
    best = fit(model)
    inverse = covariance(model, best, 30).white
    found = follow(model, best, axis(2, 1), inverse, (-10.0, 10.0))
    assert found.low is not None and found.high is not None
    reached = np.log(found.accepted[:, 1])
    centre = best.scaled[1]
    assert centre - reached.min() > (1.0 - AGREES) * (centre - found.low)
    assert reached.max() - centre > (1.0 - AGREES) * (found.high - centre)


@pytest.mark.parametrize(("end_sds", "asked"), [(4.0, True), (40.0, False)])
def test_value_of_no_effect_is_refitted_unless_far(
    end_sds: float, asked: bool, line: Callable[..., Model]
) -> None:
    noise = 0.3 * np.random.default_rng(10).standard_normal(len(T))
    model = line(1.0 + 2.0 * T + noise, T)
    best = fit(model)
    inverse = covariance(model, best, 30).white
    value = float(best.theta[1] - end_sds * np.sqrt(inverse[1, 1]))
    found = follow(model, best, axis(2, 1), inverse, (-1e3, 1e3), none=value)
    at = found.statistic[found.values == value]
    assert len(at) == asked
    if asked:
        assert at[0] == pytest.approx(end_sds**2, rel=0.1)


def test_open_end_of_profile_is_none(decay: Callable[..., Model]) -> None:
    t = np.linspace(0.0, 1.0, 300)
    flat = decay(1.0 + 0.01 * np.random.default_rng(12).standard_normal(300), t)
    found = scan(flat, fit(flat), axis(2, 1), np.log(np.geomspace(1e-3, 1e2, 60)), inflation=1.0)
    assert found.low is None
    assert found.high is not None and np.exp(found.high) < 0.05
    assert len(found.accepted) > 3


class TwoBranches:
    """r = 1 + x^2/100 + (y^2 - 1)^2 - 0.02 x y: equally low at left with y < 0, right with y > 0.

    Held at one x, the cost over y has a minimum at either sign, and no step leads across.
    """

    parameters = (
        FitParameter("x", "1", -3.0, 3.0, -1.0, Scaling.LINEAR),
        FitParameter("y", "1", -3.0, 3.0, -1.0, Scaling.LINEAR),
    )
    trial_slices = (slice(0, 200),)
    mask = np.ones(200)

    def residuals(self, theta: FloatArray) -> FloatArray:
        x, y = theta
        return np.full(200, 1.0 + 0.01 * x**2 + (y**2 - 1.0) ** 2 - 0.02 * x * y)

    def jacobian(self, theta: FloatArray) -> FloatArray:
        x, y = theta
        row = np.array([0.02 * x - 0.02 * y, 4.0 * y * (y**2 - 1.0) - 0.02 * x])
        return np.tile(row, (200, 1))

    def cost(self, theta: FloatArray, weights: FloatArray | None = None) -> float:
        return self.normal_equations(theta, weights).cost

    def normal_equations(
        self, theta: FloatArray, weights: FloatArray | None = None
    ) -> NormalEquations:
        used = self.mask if weights is None else weights
        return stacked_normal_equations(self.residuals(theta), self.jacobian(theta), used)


def test_second_branch_is_followed_from_any_touching_origin() -> None:
    model = TwoBranches()
    left = fit(model, np.array([-1.0, -1.0]))
    right = fit(model, np.array([1.0, 1.0]))
    assert left.theta[1] < 0.0 < right.theta[1]
    grid = np.linspace(-3.0, 3.0, 25)
    alone = scan(model, left, axis(2, 0), grid, inflation=1.0)
    both = scan(model, left, axis(2, 0), grid, inflation=1.0, others=[right.theta])
    assert alone.high is not None and alone.high < 0.0
    assert both.high is not None and both.high > 1.9
    assert both.low == pytest.approx(-both.high, abs=0.05)


def test_interval_goes_on_along_another_branch() -> None:
    """The optimum of that branch is not known: only that it exists."""
    model, inverse = TwoBranches(), np.diag([0.25, 0.01])
    left = fit(model, np.array([-1.0, -1.0]))
    limits = (-3.0, 3.0)
    alone = follow(model, left, axis(2, 0), inverse, limits)
    assert alone.high is not None and alone.high < 0.0
    both = follow(
        model, left, axis(2, 0), inverse, limits,
        branch=lambda x: np.array([x, 1.0]) if x > -1.5 else None,
    )  # fmt: skip
    assert both.high is None or both.high > 1.0  # None: a refit that has not converged ends none
    assert np.max(both.accepted[:, 1]) > 0.9
    assert both.low == pytest.approx(alone.low, abs=1e-6)


def test_crossing_accepts_all_between_the_outermost_points() -> None:
    grid = np.arange(7.0)
    low, high = crossing(grid, np.array([16.0, 1.0, 9.0, 9.0, 0.0, 1.0, 16.0]), 4.0)
    assert low == pytest.approx(2.0 / 3.0)
    assert high == pytest.approx(5.0 + 1.0 / 3.0)
