"""Levenberg-Marquardt on normal equations in scaled parameters, with a box and many starts.

The damping follows Nielsen (IMM-REP-1999-05); the box is kept by projection with an active set,
so that a parameter the data push against its bound stops there and the others go on. A robust
loss is iteratively reweighted least squares around the same minimiser.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

import numpy as np

from rigd.analysis.model import Model, NormalEquations, scaled_bounds, slopes, to_natural, to_scaled
from rigd.analysis.result import FloatArray
from rigd.model.errors import DataError

MAX_ITERATIONS = 60  #: starts that need more crawl along a ridge the data do not resolve
RELATIVE_DECREASE = 1e-12
STEP_TOLERANCE = 1e-9  #: in scaled coordinates, where one is a factor e
MAX_DAMPING = 1e12  #: beyond it the steps are below rounding
MAX_STEP = 3.0  #: e-folds; a longer step is a linearisation far outside its validity
HUBER_K = 1.345  #: 95 % efficiency on Gaussian residuals
ROBUST_ROUNDS = 20
MAD_TO_SIGMA = 1.4826


class Loss(Enum):
    """How residuals far outside the bulk count."""

    SQUARES = "squares"
    HUBER = "huber"
    SOFT_L1 = "soft_l1"


@dataclass(frozen=True, eq=False)
class Affine:
    """Scaled parameters u = offset + basis @ w: how a profile holds one combination fixed.

    ``offset`` (p,), ``basis`` (p, m). ``free`` (m,) are the indices of u that w stands for, whose
    bounds apply to w; a parameter that is not free follows from the constraint and has no bound.
    """

    offset: FloatArray
    basis: FloatArray
    free: tuple[int, ...]

    @staticmethod
    def identity(count: int) -> Affine:
        """Return the map that leaves all ``count`` parameters free."""
        return Affine(np.zeros(count), np.eye(count), tuple(range(count)))

    @staticmethod
    def holding(direction: FloatArray, value: float) -> Affine:
        """Return the map on which ``direction @ u == value``; its first nonzero entry is solved."""
        pivot = int(np.flatnonzero(direction)[0])
        free = tuple(i for i in range(len(direction)) if i != pivot)
        basis = np.zeros((len(direction), len(free)))
        for column, index in enumerate(free):
            basis[index, column] = 1.0
            basis[pivot, column] = -direction[index] / direction[pivot]
        offset = np.zeros(len(direction))
        offset[pivot] = value / direction[pivot]
        return Affine(offset, basis, free)


@dataclass(frozen=True, eq=False)
class Fit:
    """Where one start ended: ``theta`` natural and ``scaled`` (p,), cost, and the work it took."""

    theta: FloatArray
    scaled: FloatArray
    start: FloatArray
    cost: float
    iterations: int
    evaluations: int
    converged: bool
    weights: FloatArray | None = None


def fit(
    model: Model,
    start: FloatArray | None = None,
    *,
    affine: Affine | None = None,
    weights: FloatArray | None = None,
    max_iterations: int = MAX_ITERATIONS,
    relative_decrease: float = RELATIVE_DECREASE,
) -> Fit:
    """Return the least-squares fit from one start (natural units; the model's own by default).

    It ends with a step that gains less than ``relative_decrease`` of the cost.
    Raises DataError when the cost is not finite at the start.
    """
    parameters = model.parameters
    affine = Affine.identity(len(parameters)) if affine is None else affine
    theta0 = np.array([p.start for p in parameters]) if start is None else np.asarray(start, float)
    low_all, high_all = scaled_bounds(parameters)
    low, high = low_all[list(affine.free)], high_all[list(affine.free)]
    w = np.clip(to_scaled(parameters, theta0)[list(affine.free)], low, high)

    def natural(point: FloatArray) -> FloatArray:
        return to_natural(parameters, affine.offset + affine.basis @ point)

    def equations(point: FloatArray) -> NormalEquations:
        theta = natural(point)
        full = model.normal_equations(theta, weights)
        chain = affine.basis * slopes(parameters, theta)[:, None]
        return NormalEquations(
            full.cost, chain.T @ full.gradient, chain.T @ full.information @ chain
        )

    now = equations(w)
    if not np.isfinite(now.cost):
        raise DataError("the model's cost is not finite at the start of the fit")
    damping, growth = 1e-3, 2.0
    iterations, evaluations, converged = 0, 1, False
    while iterations < max_iterations and not converged:
        iterations += 1
        step = _damped_step(now, w, low, high, damping)
        target = np.clip(w + step, low, high)
        step = target - w
        if float(np.max(np.abs(step), initial=0.0)) < STEP_TOLERANCE:
            converged = True
            break
        predicted = -float(now.gradient @ step + 0.5 * step @ now.information @ step)
        cost = model.cost(natural(target), weights)
        evaluations += 1
        gain = now.cost - cost
        if np.isfinite(cost) and gain > 0.0:
            converged = gain < relative_decrease * now.cost
            ratio = gain / predicted if predicted > 0.0 else 1.0
            damping *= max(1.0 / 3.0, 1.0 - (2.0 * ratio - 1.0) ** 3)
            growth = 2.0
            w = target
            now = equations(w)
            evaluations += 1
        elif damping > MAX_DAMPING or 0.0 <= predicted < relative_decrease * now.cost:
            converged = True
        else:
            damping *= growth
            growth *= 2.0
    scaled = affine.offset + affine.basis @ w
    return Fit(
        to_natural(parameters, scaled), scaled, theta0, now.cost, iterations, evaluations,
        converged, weights,
    )  # fmt: skip


def _damped_step(
    now: NormalEquations, w: FloatArray, low: FloatArray, high: FloatArray, damping: float
) -> FloatArray:
    """Return the step on the parameters that are not held by their bound."""
    held = ((w <= low) & (now.gradient > 0.0)) | ((w >= high) & (now.gradient < 0.0))
    free = np.flatnonzero(~held)
    step = np.zeros_like(w)
    if free.size == 0:
        return step
    matrix = now.information[np.ix_(free, free)]
    diagonal = np.diag(matrix)
    # A floor under the diagonal keeps a direction without information from taking any step size.
    floor = 1e-9 * float(np.max(diagonal)) + np.finfo(float).tiny
    damped = matrix + damping * np.diag(np.maximum(diagonal, floor))
    step[free] = np.linalg.solve(damped + 1e-14 * floor * np.eye(free.size), -now.gradient[free])
    return np.asarray(np.clip(step, -MAX_STEP, MAX_STEP))


def multi_start(
    model: Model,
    *,
    starts: int,
    seed: int,
    weights: FloatArray | None = None,
    spread: float = 0.35,
) -> tuple[Fit, ...]:
    """Return ``starts`` fits, best first: the model's own start, then seeded draws from the box.

    Draws are normal around the model's start in scaled coordinates with a standard deviation of
    ``spread`` times the width of the box, clipped to it.
    """
    parameters = model.parameters
    low, high = scaled_bounds(parameters)
    centre = to_scaled(parameters, np.array([p.start for p in parameters]))
    rng = np.random.default_rng(seed)
    points = [centre]
    points += [
        np.clip(centre + spread * (high - low) * rng.standard_normal(len(centre)), low, high)
        for _ in range(starts - 1)
    ]
    fits = [fit(model, to_natural(parameters, p), weights=weights) for p in points]
    return tuple(sorted(fits, key=lambda f: f.cost))


def robust_weights(residuals: FloatArray, mask: FloatArray, loss: Loss) -> FloatArray:
    """Return IRLS weights (n,) in (0, 1], with the scale taken from the median deviation."""
    if loss is Loss.SQUARES:
        return np.ones_like(residuals)
    used = residuals[mask > 0.0]
    scale = MAD_TO_SIGMA * float(np.median(np.abs(used - np.median(used))))
    distance = np.abs(residuals) / max(HUBER_K * scale, np.finfo(float).tiny)
    if loss is Loss.HUBER:
        return 1.0 / np.maximum(distance, 1.0)
    return 1.0 / np.sqrt(1.0 + distance**2)


def robust_fit(model: Model, first: Fit, loss: Loss) -> Fit:
    """Return ``first`` refined under ``loss``; weights and fit alternate until neither moves."""
    current = first
    for _ in range(ROBUST_ROUNDS):
        weights = robust_weights(model.residuals(current.theta), model.mask, loss)
        following = fit(model, current.theta, weights=weights)
        moved = float(np.max(np.abs(following.scaled - current.scaled)))
        current = following
        if loss is Loss.SQUARES or moved < 1e-6:
            break
    return current


def named(model: Model, theta: FloatArray) -> Mapping[str, float]:
    """Return ``theta`` by parameter name."""
    return {p.name: float(x) for p, x in zip(model.parameters, theta, strict=True)}
