"""What the draws of a posterior show: credible intervals, whether chains agree, ridges, modes.

Chains are judged by the rank-normalised split R-hat and by effective sample sizes of bulk and
tails (Vehtari, Gelman, Simpson, Carpenter and Buerkner, Bayesian Analysis 16, 2021); arviz-stats
computes them. A chain is an ensemble of walkers that depend on one another: its effective sample
size is the variance of the draws over that of the mean of all walkers, the latter with the memory
of the series of these means (Goodman and Weare, Comm. Appl. Math. Comp. Sci. 5, 2010, sec. 5).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from arviz_stats.base import array_stats
from scipy.signal import argrelmax
from scipy.stats import gaussian_kde, norm, rankdata, spearmanr

from rigd.analysis.fitting.identifiability import Evidence, judge
from rigd.analysis.posterior.sampler import Density, Draws, draw
from rigd.analysis.posterior_result import CredibleInterval, Mode, Posterior, Ridge
from rigd.analysis.result import FloatArray, Verdict

AGREE = 1.01  #: R-hat up to which chains agree (Vehtari et al.)
ENOUGH = 400.0  #: effective draws: 100 of each chain (ibid.)
ROUNDS = (40, *[20] * 10)  #: steps of each walker, until the draws are enough
SAME = 0.95  #: rank correlation from which two parameters can replace each other
OPEN = math.exp(-0.5 * 3.84)  #: density at a bound, of the largest: where a profile would be open
BINS = 20
VALLEY = 0.5  #: of the lower of two peaks: a lower density between them makes them two modes
LEAST_SHARE = 0.05  #: of the draws, in a mode
DENSITY_DRAWS, DENSITY_POINTS = 2000, 256


@dataclass(frozen=True, eq=False)
class Sampled:
    """A positive quantity whose logarithm is ``direction`` (d,) times the sampled point.

    ``low`` and ``high`` are what it may be at all; ``reach`` is the half width, of the logarithm
    and at 95 %, that the posterior does not hold and that is joined in quadrature. ``given`` is
    whether a number may be given of it at all.
    """

    name: str
    symbol: str
    unit: str
    direction: FloatArray
    low: float
    high: float
    reach: float = 0.0
    given: bool = True


def sample_posterior(
    density: Density, quantities: Sequence[Sampled], seed: int, tempering: float = 1.0
) -> Posterior:
    """Return the posterior of ``quantities``: independent chains until they agree, or the last.

    ``tempering`` is what ``density`` was divided by in the exponent, for the report.
    """
    directions = np.array([item.direction for item in quantities])

    def enough(draws: Draws) -> bool:
        logs = draws.chains @ directions.T
        return all(_agrees(logs[..., k]) for k in range(len(quantities)))

    draws = draw(density, seed, enough, ROUNDS)
    logs = draws.chains @ directions.T
    agreed = enough(draws)
    parameters = tuple(_interval(item, logs[..., k], agreed) for k, item in enumerate(quantities))
    ridges = _ridges(quantities, logs)
    chains, steps, walkers, _ = logs.shape
    return Posterior(
        agreed=agreed,
        parameters=parameters,
        ridges=ridges,
        warnings=_warnings(parameters, ridges, agreed),
        tempering=tempering,
        seed=seed,
        evaluations=draws.evaluations,
        draws=np.exp(logs).reshape(chains, steps * walkers, len(quantities)),
    )


def r_hat(chains: FloatArray) -> float:
    """Return the rank-normalised split R-hat of ``chains`` (chains, steps, walkers)."""
    return float(array_stats.rhat(chains.reshape(len(chains), -1), method="rank"))


def effective_draws(chains: FloatArray) -> tuple[float, float]:
    """Return the effective sample sizes of bulk and tails of ``chains`` (chains, steps, walkers).

    The bulk is of normalised ranks, the tails of what lies beyond the 5 % and the 95 % quantile,
    the smaller of both.
    """
    ranks = rankdata(chains.reshape(-1)).reshape(chains.shape)
    bulk = _effective(np.asarray(norm.ppf((ranks - 0.375) / (chains.size + 0.25))))
    low, high = np.quantile(chains, [0.05, 0.95])
    tails = [(chains <= low).astype(np.float64), (chains >= high).astype(np.float64)]
    return bulk, min(_effective(tail) for tail in tails)


def modes(values: FloatArray) -> tuple[Mode, ...]:
    """Return the modes of draws (n,): peaks of their density with a valley between them."""
    thinned = values[:: max(1, len(values) // DENSITY_DRAWS)]
    if not np.ptp(thinned) > 0.0:
        return (Mode(float(thinned[0]), 1.0),)
    grid = np.linspace(np.min(values), np.max(values), DENSITY_POINTS)
    height = gaussian_kde(thinned, "silverman")(grid)
    peaks = [int(k) for k in argrelmax(np.concatenate([[0.0], height, [0.0]]))[0] - 1]
    edges = [0]
    kept = peaks[:1]
    for peak in peaks[1:]:
        valley = kept[-1] + int(np.argmin(height[kept[-1] : peak + 1]))
        before, behind = edges[-1], grid[valley]
        share = float(np.mean((values >= grid[before]) & (values < behind)))
        if height[valley] < VALLEY * min(height[kept[-1]], height[peak]) and (
            share >= LEAST_SHARE and float(np.mean(values >= behind)) >= LEAST_SHARE
        ):
            kept.append(peak)
            edges.append(valley)
        elif height[peak] > height[kept[-1]]:
            kept[-1] = peak
    ends = [*(grid[k] for k in edges[1:]), math.inf]
    begins = [-math.inf, *ends[:-1]]
    return tuple(
        Mode(float(grid[peak]), float(np.mean((values >= begin) & (values < end))))
        for peak, begin, end in zip(kept, begins, ends, strict=True)
    )


def _agrees(chains: FloatArray) -> bool:
    return r_hat(chains) <= AGREE and min(effective_draws(chains)) >= ENOUGH


def _effective(chains: FloatArray) -> float:
    """Return the effective sample size of the mean of ``chains`` (chains, steps, walkers)."""
    means = chains.mean(axis=2)
    variance = float(np.var(means))
    if not variance > 0.0:
        return 0.0
    found = float(np.var(chains)) / variance * float(array_stats.ess(means, method="mean"))
    return min(found, float(chains.size))


def _interval(item: Sampled, chains: FloatArray, agreed: bool) -> CredibleInterval:
    bulk, tail = effective_draws(chains)
    values = chains.reshape(-1)
    low, centre, high = (float(x) for x in np.quantile(values, [0.025, 0.5, 0.975]))
    below, above = math.hypot(centre - low, item.reach), math.hypot(high - centre, item.reach)
    at_low, at_high = _open(values, math.log(item.low), math.log(item.high))
    ends = (
        None if at_low else math.exp(centre - below),
        None if at_high else math.exp(centre + above),
    )
    verdict, sentence = judge(Evidence(math.exp(centre), *ends, item.unit))
    known = agreed and item.given and verdict in (Verdict.IDENTIFIABLE, Verdict.WEAK)
    if not agreed:
        sentence = "The chains do not agree yet."
    elif not item.given:
        sentence = "The table of the parameters gives no number, with the reason."
    return CredibleInterval(
        item.name, item.symbol, item.unit,
        math.exp(centre) if known else None,
        ends[0] if known else None,
        ends[1] if known else None,
        r_hat(chains), bulk, tail,
        tuple(Mode(math.exp(mode.value), mode.share) for mode in modes(values)),
        sentence,
    )  # fmt: skip


def _open(values: FloatArray, low: float, high: float) -> tuple[bool, bool]:
    """Return whether the density is large at either bound, so that the bound ends the interval."""
    first, last = (float(x) for x in np.quantile(values, [0.005, 0.995]))
    width = max((last - first) / BINS, np.finfo(float).tiny)
    counts, _ = np.histogram(values, bins=BINS, range=(first, last))
    most = float(np.max(counts))
    at_low = np.count_nonzero(values <= low + width) >= OPEN * most
    return bool(at_low), bool(np.count_nonzero(values >= high - width) >= OPEN * most)


def _ridges(quantities: Sequence[Sampled], logs: FloatArray) -> tuple[Ridge, ...]:
    values = logs.reshape(-1, len(quantities))
    found = []
    for j, second in enumerate(quantities):
        for i, first in enumerate(quantities[:j]):
            rho = float(spearmanr(values[:, i], values[:, j]).statistic)
            if abs(rho) >= SAME:
                found.append(Ridge(first.name, second.name, rho))
    return tuple(sorted(found, key=lambda ridge: -abs(ridge.correlation)))


def _warnings(
    parameters: Sequence[CredibleInterval], ridges: Sequence[Ridge], agreed: bool
) -> tuple[str, ...]:
    found = []
    if not agreed:
        worst = max(parameters, key=lambda item: item.r_hat)
        fewest = min(parameters, key=lambda item: item.effective)
        found.append(
            f"No credible interval is given: the chains do not agree (R-hat of {worst.name} "
            f"{worst.r_hat:.3f}, {AGREE} is the limit; {fewest.effective:.0f} effective draws of "
            f"{fewest.name}, {ENOUGH:.0f} are needed). Use the intervals of the table; record "
            "tests that part the parameters (`rigd design`), or sample again (`--seed 2`)."
        )
    for item in parameters:
        if len(item.modes) > 1:
            places = " and ".join(f"{mode.value:.3g} ({mode.share:.0%})" for mode in item.modes)
            shares = "" if agreed else "; the shares are not reliable, as the chains do not agree"
            found.append(
                f"{item.name} has {len(item.modes)} modes, at {places} {item.unit}{shares}: the "
                "data fit with either. More tests must decide between them."
            )
    found += [
        f"{ridge.first} and {ridge.second} lie on a ridge (rank correlation "
        f"{ridge.correlation:+.3f}): each can stand in for the other."
        for ridge in ridges
    ]
    return tuple(found)
