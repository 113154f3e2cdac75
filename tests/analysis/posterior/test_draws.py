"""Posteriors that are known in closed form: their intervals, ridges, modes, and failed chains."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import pytest
from scipy.special import logsumexp

from rigd.analysis.fitting.profile import axis
from rigd.analysis.posterior import draws as posterior
from rigd.analysis.posterior.draws import Sampled, effective_draws, r_hat, sample_posterior
from rigd.analysis.posterior_result import Posterior
from rigd.analysis.result import FloatArray

WIDE = 20.0  #: of the box, each way
NAMES = ("a", "b")
Z_95 = 1.96


@dataclass(frozen=True, eq=False)
class Gaussians:
    """A mixture of two-dimensional Gaussians on a box; jumps know the centres ``known``."""

    centres_of: FloatArray
    covariance: FloatArray
    weights: tuple[float, ...] = (1.0,)
    known: tuple[int, ...] = (0,)
    low: FloatArray = field(default_factory=lambda: np.full(2, -WIDE))
    high: FloatArray = field(default_factory=lambda: np.full(2, WIDE))

    @property
    def centres(self) -> FloatArray:
        return self.centres_of[list(self.known)]

    @property
    def covariances(self) -> FloatArray:
        return np.array([self.covariance for _ in self.known])

    def log_density(self, point: FloatArray) -> float:
        if np.any(point < self.low) or np.any(point > self.high):
            return -math.inf
        away = point - self.centres_of
        squares = np.einsum("ni,ij,nj->n", away, np.linalg.inv(self.covariance), away)
        return float(logsumexp(np.log(self.weights) - 0.5 * squares))


def quantities(low: float = math.exp(-WIDE), reach: float = 0.0) -> list[Sampled]:
    return [
        Sampled(name, name, "N", axis(2, k), low, math.exp(WIDE), reach)
        for k, name in enumerate(NAMES)
    ]


def known_sd(sd: float, rho: float = 0.0) -> FloatArray:
    return sd**2 * np.array([[1.0, rho], [rho, 1.0]])


def gaussian(rho: float, reach: float = 0.0) -> Posterior:
    density = Gaussians(np.array([[1.0, 2.0]]), known_sd(0.05, rho))
    return sample_posterior(density, quantities(reach=reach), seed=1)


def test_gaussian_gives_its_own_quantiles() -> None:
    found = gaussian(0.6)
    assert found.agreed
    assert not found.warnings
    for item, centre in zip(found.parameters, (1.0, 2.0), strict=True):
        assert item.low is not None and item.high is not None and item.estimate is not None
        assert math.log(item.estimate) == pytest.approx(centre, abs=0.01)
        half = 0.5 * (math.log(item.high) - math.log(item.low))
        assert half == pytest.approx(Z_95 * 0.05, rel=0.1)
        assert item.r_hat <= 1.01
        assert item.effective >= 400.0
        assert len(item.modes) == 1


def test_same_seed_gives_the_same_draws() -> None:
    np.testing.assert_array_equal(gaussian(0.6).draws, gaussian(0.6).draws)


def test_what_the_posterior_lacks_widens_it() -> None:
    alone, joined = gaussian(0.6).parameters[0], gaussian(0.6, reach=0.2).parameters[0]
    assert alone.high is not None and joined.high is not None and alone.estimate is not None
    above = math.log(alone.high / alone.estimate)
    assert math.log(joined.high / alone.estimate) == pytest.approx(math.hypot(above, 0.2))


def test_ridge_is_named() -> None:
    found = gaussian(-0.995)
    (ridge,) = found.ridges
    assert (ridge.first, ridge.second) == NAMES
    assert ridge.correlation == pytest.approx(-0.995, abs=0.01)
    assert "a and b lie on a ridge" in found.warnings[0]


def test_two_modes_are_shown_with_shares() -> None:
    centres = np.array([[0.0, 0.0], [1.5, 0.0]])
    density = Gaussians(centres, known_sd(0.1), weights=(0.3, 0.7), known=(0, 1))
    found = sample_posterior(density, quantities(), seed=1)
    assert found.agreed
    first, second = found.parameters[0].modes
    assert math.log(first.value) == pytest.approx(0.0, abs=0.1)
    assert math.log(second.value) == pytest.approx(1.5, abs=0.1)
    assert first.share == pytest.approx(0.3, abs=0.06)
    assert len(found.parameters[1].modes) == 1
    assert any(text.startswith("a has 2 modes") for text in found.warnings)


def test_chains_in_other_modes_give_no_number(monkeypatch: pytest.MonkeyPatch) -> None:
    """No jump leads from one mode to the other: two chains stay in each."""
    monkeypatch.setattr("rigd.analysis.posterior.sampler.JUMPS", 0.0)
    centres = np.array([[-4.0, 0.0], [4.0, 0.0]])
    density = Gaussians(centres, known_sd(0.05), weights=(0.5, 0.5), known=(0, 1))
    found = sample_posterior(density, quantities(), seed=1)
    assert not found.agreed
    assert all(item.estimate is item.low is item.high is None for item in found.parameters)
    assert found.parameters[0].r_hat > 1.5
    assert "rigd design" in found.warnings[0]
    assert "the shares are not reliable" in found.warnings[1]


def test_too_few_draws_give_no_number(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(posterior, "ROUNDS", (12,))
    found = gaussian(0.0)
    assert not found.agreed
    assert found.parameters[0].effective < 400.0
    assert found.parameters[0].low is None


def test_density_at_a_bound_leaves_the_interval_open() -> None:
    density = Gaussians(np.array([[0.0, 0.0]]), known_sd(0.05), low=np.array([-0.01, -WIDE]))
    found = sample_posterior(density, quantities(low=math.exp(-0.01)), seed=1)
    assert found.agreed
    assert found.parameters[0].estimate is None
    assert "not downwards" in found.parameters[0].sentence
    assert found.parameters[1].estimate is None, "its box ends at the same value"


def test_walkers_that_move_as_one_count_once() -> None:
    steps = np.random.default_rng(1).standard_normal((4, 500, 1))
    together = np.repeat(steps, 10, axis=2)
    apart = np.random.default_rng(2).standard_normal((4, 500, 10))
    assert effective_draws(together)[0] == pytest.approx(2000.0, rel=0.15)
    assert effective_draws(apart)[0] > 15000.0


@pytest.mark.parametrize("measure", [lambda x: effective_draws(x)[0], lambda x: -r_hat(x)])
def test_a_chain_elsewhere_is_noticed(measure: Callable[[FloatArray], float]) -> None:
    chains = np.random.default_rng(1).standard_normal((4, 100, 10))
    moved = chains.copy()
    moved[0] += 1.0
    assert measure(moved) < measure(chains)
    assert r_hat(moved) > 1.01 > r_hat(chains)
