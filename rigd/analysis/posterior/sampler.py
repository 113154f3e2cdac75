"""Draws from a posterior density with emcee: several independent ensembles of walkers.

The walkers of an ensemble move by one another's places (differential evolution, ter Braak and
Vrugt 2008; Nelson, Ford and Payne 2014), which follows ridges without derivatives, or jump to a
draw from a mixture of t distributions around points that are known to be good (independence
Metropolis-Hastings, Tierney 1994), which brings them from one mode to another. Walkers of one
ensemble are not independent of one another, ensembles are: each ensemble is one chain.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import emcee
import numpy as np
from scipy.special import gammaln, logsumexp

from rigd.analysis.result import FloatArray

CHAINS = 4
WALKERS = 2  #: of an ensemble, times the dimension
FREEDOM = 5.0  #: degrees of freedom of a jump: its tails reach further than a Gaussian's
DISPERSED = 2.0  #: times the spread of the density: where walkers start
JUMPS, DIFFERENCES, SNOOKER = 0.65, 0.25, 0.1  #: shares of the moves
MOST_TRIES = 1000  #: until a start within the bounds is found


class Density(Protocol):
    """The logarithm of a density on a box, and where it is known to be large.

    ``low`` and ``high`` (d,) are the box. ``centres`` (k, d) and ``covariances`` (k, d, d) of as
    many Gaussians that together are near the density.
    """

    @property
    def low(self) -> FloatArray:
        """Return the lower bounds."""

    @property
    def high(self) -> FloatArray:
        """Return the upper bounds."""

    @property
    def centres(self) -> FloatArray:
        """Return where the density is large."""

    @property
    def covariances(self) -> FloatArray:
        """Return how far it reaches around each centre."""

    def log_density(self, point: FloatArray) -> float:
        """Return ln of the density at ``point`` (d,), up to a constant; -inf out of the box."""


@dataclass(frozen=True, eq=False)
class Draws:
    """Draws (chains, steps, walkers, d), behind those that are left out, and evaluations made."""

    chains: FloatArray
    evaluations: int

    @property
    def flat(self) -> FloatArray:
        """Return all draws, (n, d)."""
        return self.chains.reshape(-1, self.chains.shape[-1])


def draw(
    density: Density, seed: int, enough: Callable[[Draws], bool], rounds: Sequence[int]
) -> Draws:
    """Return draws of ``density``; the first quarter of each chain is left out.

    After each of ``rounds``, numbers of steps, it ends if ``enough`` is true of the draws.
    """
    jumps = _Mixture.around(density)
    moves = [
        (emcee.moves.MHMove(jumps.propose), JUMPS),
        (emcee.moves.DEMove(), DIFFERENCES),
        (emcee.moves.DESnookerMove(), SNOOKER),
    ]
    dimension = len(density.low)
    evaluated = _Counted(density.log_density)
    samplers, states = [], []
    for chain in range(CHAINS):
        sampler = emcee.EnsembleSampler(WALKERS * dimension, dimension, evaluated, moves=moves)
        state = np.random.MT19937(np.random.SeedSequence((seed, chain))).state
        sampler.random_state = state
        rng = np.random.default_rng((seed, chain, 1))
        samplers.append(sampler)
        states.append(_starts(density, chain, rng))
    for steps in rounds:
        states = [
            sampler.run_mcmc(state, steps) for sampler, state in zip(samplers, states, strict=True)
        ]
        chains = np.array([sampler.get_chain() for sampler in samplers])
        draws = Draws(chains[:, chains.shape[1] // 4 :], evaluated.count)
        if enough(draws):
            break
    return draws


class _Counted:
    """A function that counts its calls."""

    def __init__(self, function: Callable[[FloatArray], float]) -> None:
        self._function = function
        self.count = 0

    def __call__(self, point: FloatArray) -> float:
        self.count += 1
        return self._function(point)


def _starts(density: Density, chain: int, rng: np.random.Generator) -> FloatArray:
    """Return dispersed starts (walkers, d) of one chain, around one of the centres."""
    which = chain % len(density.centres)
    root = np.linalg.cholesky(density.covariances[which])
    found: list[FloatArray] = []
    for _ in range(MOST_TRIES):
        at = density.centres[which] + DISPERSED * root @ rng.standard_normal(len(root))
        at = np.where(at < density.low, 2.0 * density.low - at, at)  # reflected at the bounds
        at = np.where(at > density.high, 2.0 * density.high - at, at)
        if math.isfinite(density.log_density(at)):
            found.append(at)
        if len(found) == WALKERS * len(root):
            return np.array(found)
    raise ValueError("the density is nowhere finite around its centres")


@dataclass(frozen=True, eq=False)
class _Mixture:
    """Multivariate t distributions: ``roots`` (k, d, d) of their scales, ``log_weights`` (k,)."""

    centres: FloatArray
    roots: FloatArray
    log_weights: FloatArray

    @staticmethod
    def around(density: Density) -> _Mixture:
        """Return the mixture whose parts have the weights of Gaussians (Laplace's method)."""
        roots = np.asarray(np.linalg.cholesky(density.covariances), dtype=np.float64)
        heights = np.array([density.log_density(centre) for centre in density.centres])
        logs = heights + np.sum(np.log(np.diagonal(roots, axis1=1, axis2=2)), axis=1)
        return _Mixture(density.centres, roots, logs - logsumexp(logs))

    def propose(self, points: FloatArray, random: Any) -> tuple[FloatArray, FloatArray]:
        """Return a draw for each of ``points`` (n, d), and ln of the ratio of their densities.

        ``random`` is the generator of emcee, numpy's of old.
        """
        count, dimension = points.shape
        which = random.choice(len(self.centres), size=count, p=np.exp(self.log_weights))
        normal = random.standard_normal((count, dimension))
        wide = np.sqrt(FREEDOM / random.chisquare(FREEDOM, size=count))
        moved = np.einsum("nij,nj->ni", self.roots[which], normal) * wide[:, None]
        found = self.centres[which] + moved
        return found, self.log_density(points) - self.log_density(found)

    def log_density(self, points: FloatArray) -> FloatArray:
        """Return ln of the density (n,) at ``points`` (n, d), up to a constant."""
        d = points.shape[1]
        parts = []
        for centre, root, weight in zip(self.centres, self.roots, self.log_weights, strict=True):
            white = np.linalg.solve(root, (points - centre).T)
            spread = -0.5 * (FREEDOM + d) * np.log1p(np.sum(white**2, axis=0) / FREEDOM)
            parts.append(weight - float(np.sum(np.log(np.diag(root)))) + spread)
        constant = gammaln(0.5 * (FREEDOM + d)) - gammaln(0.5 * FREEDOM)
        return np.asarray(logsumexp(np.array(parts), axis=0) + constant)
