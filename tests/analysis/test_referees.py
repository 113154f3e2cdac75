"""Profiles and robust covariances against libraries of other authors: iminuit and statsmodels."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from rigd.analysis.fitting.fit import fit
from rigd.analysis.fitting.model import Model
from rigd.analysis.fitting.profile import axis, natural_ends, scan
from rigd.analysis.fitting.uncertainty import covariance

iminuit = pytest.importorskip("iminuit")
linear_model = pytest.importorskip("statsmodels.regression.linear_model")

FloatArray = NDArray[np.float64]
BLOCK, BLOCKS = 50, 80
RHO = 0.9


def coloured(seed: int) -> FloatArray:
    """Return AR(1) noise (n,) of unit variance."""
    rng = np.random.default_rng(seed)
    out = rng.standard_normal(BLOCK * BLOCKS)
    for k in range(1, len(out)):
        out[k] = RHO * out[k - 1] + np.sqrt(1.0 - RHO**2) * out[k]
    return out


@pytest.mark.parametrize("inflation", [1.0, 3.0])
def test_profile_ends_are_those_of_minos(decay: Callable[..., Model], inflation: float) -> None:
    """Little of the decay is seen, so that the interval of its rate is lopsided."""
    t = np.linspace(0.0, 0.4, 60)
    noise = 0.3 * np.random.default_rng(4).standard_normal(len(t))
    model = decay(2.0 * np.exp(-1.5 * t) + noise, t)
    best = fit(model)

    def statistic(a: float, k: float) -> float:
        return len(t) / inflation * float(np.log(model.cost(np.array([a, k])) / best.cost))

    referee = iminuit.Minuit(statistic, a=best.theta[0], k=best.theta[1])
    referee.errordef = 1.0
    referee.limits["k"] = (1e-3, 1e3)
    referee.migrad()
    referee.minos("k", cl=0.95)
    ends = referee.merrors["k"]
    grid = best.scaled[1] + np.linspace(-2.0, 0.9, 117)
    found = scan(model, best, axis(2, 1), grid, inflation=inflation)
    low, high = natural_ends(model, 1, found)
    assert low == pytest.approx(best.theta[1] + ends.lower, rel=0.01)
    assert high == pytest.approx(best.theta[1] + ends.upper, rel=0.01)
    assert abs(abs(ends.lower) / ends.upper - 1.0) > 0.02, "the interval is lopsided"


def test_block_covariance_is_that_of_clusters(line: Callable[..., Model]) -> None:
    x = np.linspace(-1.0, 1.0, BLOCK * BLOCKS)
    measured = 1.0 + 0.5 * x + coloured(1)
    model = line(measured, x)
    design = np.stack([np.ones_like(x), x], axis=1)
    groups = np.repeat(np.arange(BLOCKS), BLOCK)
    referee = linear_model.OLS(measured, design).fit(
        cov_type="cluster", cov_kwds={"groups": groups, "use_correction": False}
    )
    few = BLOCKS / (BLOCKS - 2)  # rigd's correction for few blocks
    np.testing.assert_allclose(
        covariance(model, fit(model), BLOCK).coloured, few * referee.cov_params(), rtol=1e-6
    )


def test_standard_errors_agree_with_newey_west_hac(line: Callable[..., Model]) -> None:
    """Two estimators of one thing: over ten records the mean ratio is one."""
    x = np.linspace(-1.0, 1.0, BLOCK * BLOCKS)
    design = np.stack([np.ones_like(x), x], axis=1)
    ratios = []
    for seed in range(10):
        measured = 1.0 + 0.5 * x + coloured(seed)
        model = line(measured, x)
        ours = np.sqrt(np.diag(covariance(model, fit(model), BLOCK).coloured))
        referee = linear_model.OLS(measured, design).fit(
            cov_type="HAC", cov_kwds={"maxlags": BLOCK, "use_correction": True}
        )
        ratios.append(ours / np.sqrt(np.diag(referee.cov_params())))
    np.testing.assert_allclose(np.mean(ratios, axis=0), 1.0, atol=0.1)
