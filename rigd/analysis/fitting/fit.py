"""Fits parameters within bounds from many starts (Levenberg-Marquardt on normal equations).

The parameters are scaled. The damping follows Nielsen (IMM-REP-1999-05). Projection with an active
set keeps the parameters within their bounds: if the data push a parameter against its bound, the
parameter stops there and the others go on. A robust loss is iteratively reweighted least squares
around the same minimiser.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

import numpy as np

from rigd.analysis.fitting.model import (
    Model,
    NormalEquations,
    scaled_bounds,
    slopes,
    to_natural,
    to_scaled,
)
from rigd.analysis.result import FloatArray
from rigd.model.errors import DataError

MAX_ITERATIONS = 60  #: starts that need more crawl along a ridge the data do not resolve
RELATIVE_DECREASE = 1e-12
STEP_TOLERANCE = 1e-9  #: in scaled coordinates, in which one is a factor e
DAMPING = 1e-3  #: of the first step
TRUSTED = 1e-4  #: a step with more damping may be short far from the optimum
REJECTED = 1e-6  #: least damping behind a step that was refused
SECOND_TRIES = 3  #: steps after one that raised the cost
ACROSS = 1e-4  #: damping with which a step leads across a ridge, not along it
MAX_DAMPING = 1e12  #: beyond it the steps are below rounding
MAX_STEP = 3.0  #: e-folds; a longer step is a linearisation far outside its validity
HUBER_K = 1.345  #: 95 % efficiency on Gaussian residuals
ROBUST_ROUNDS = 20
MAD_TO_SIGMA = 1.4826


class Loss(Enum):
    """The weight of residuals that are far outside the bulk."""

    SQUARES = "squares"
    HUBER = "huber"


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
    """The end of one start: ``theta`` natural and ``scaled`` (p,), cost, numbers of steps."""

    theta: FloatArray
    scaled: FloatArray
    start: FloatArray
    cost: float
    iterations: int
    evaluations: int
    converged: bool
    information: FloatArray  #: (p, p), scaled, at the begin of the last step
    weights: FloatArray | None = None


def fit(
    model: Model,
    start: FloatArray | None = None,
    *,
    affine: Affine | None = None,
    weights: FloatArray | None = None,
    max_iterations: int = MAX_ITERATIONS,
    relative_decrease: float = RELATIVE_DECREASE,
    damping: float = DAMPING,
    thorough: bool = False,
    ridges: bool = False,
) -> Fit:
    """Return the least-squares fit from one start (natural units; the model's own by default).

    It ends with a step that gains less than ``relative_decrease`` of the cost, or would by the
    linearised model. ``damping`` is that of the first step, relative to the diagonal: close to the
    optimum a smaller one saves steps along ridges. A ``thorough`` fit solves a step that meets a
    bound again, and takes a small gain for the end only if the model promises no more: for dear
    costs. With ``ridges`` it follows a step that raises the cost across a bent ridge.

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

    def equations(point: FloatArray) -> tuple[NormalEquations, FloatArray]:
        theta = natural(point)
        full = model.normal_equations(theta, weights)
        scale = slopes(parameters, theta)
        information = full.information * np.outer(scale, scale)
        return NormalEquations(
            full.cost,
            affine.basis.T @ (scale * full.gradient),
            affine.basis.T @ information @ affine.basis,
        ), information

    def second_try(target: FloatArray, cost: float) -> tuple[FloatArray, float, int]:
        """Return where further steps from ``target`` come below the present cost, else itself.

        Along a curved ridge a long step is right but for what the curvature adds, which the steps
        after it take away (the watchdog of Chamberlain et al., Mathematical Programming Study 16,
        1982).
        """
        point = target
        for count in range(1, SECOND_TRIES + 1):
            there, _ = equations(point)
            if not np.isfinite(there.cost):
                return target, cost, 2 * count - 1
            point = point + _damped_step(there, point, low, high, max(damping, ACROSS), again=True)
            found = model.cost(natural(point), weights)
            if found < now.cost:
                return point, found, 2 * count
        return target, cost, 2 * SECOND_TRIES

    now, whole = equations(w)
    if not np.isfinite(now.cost):
        raise DataError(
            "the model's cost is not finite at the start of the fit",
            hint="a constant or a signal is far from what the rig has: compare both with the rig "
            "(`rigd report FILE` shows signals, `rigd identify FILE --set` corrects constants)",
        )
    growth = 2.0
    iterations, evaluations, converged = 0, 1, False
    while iterations < max_iterations and not converged:
        iterations += 1
        step = _damped_step(now, w, low, high, damping, again=thorough)
        target = np.clip(w + step, low, high)
        step = target - w
        if float(np.max(np.abs(step), initial=0.0)) < STEP_TOLERANCE:
            converged = True
            break
        predicted = now.promised(step)
        little = 0.0 <= predicted < relative_decrease * now.cost
        if little and damping <= TRUSTED:
            converged = True
            break
        cost = model.cost(natural(target), weights)
        evaluations += 1
        if ridges and damping <= TRUSTED and predicted > 0.0 and not cost < now.cost:
            target, cost, more = second_try(target, cost)
            evaluations += more
        gain = now.cost - cost
        if np.isfinite(cost) and gain > 0.0:
            converged = gain < relative_decrease * now.cost
            if thorough and converged:
                whole_step = _damped_step(now, w, low, high, 0.0, again=True)
                converged = now.promised(whole_step) - gain < relative_decrease * now.cost
            if converged:
                w, now = target, NormalEquations(cost, now.gradient, now.information)
                break
            after, there = equations(target)
            evaluations += 1
            if np.isfinite(after.cost):
                ratio = gain / predicted if predicted > 0.0 else 1.0
                damping *= max(1.0 / 3.0, 1.0 - (2.0 * min(ratio, 1.0) - 1.0) ** 3)
                growth = 2.0
                w, now, whole = target, after, there
                continue
        if damping > MAX_DAMPING or little:  # the step was refused
            converged = True
        else:
            damping = max(damping * growth, REJECTED)
            growth *= 2.0
    scaled = affine.offset + affine.basis @ w
    return Fit(
        to_natural(parameters, scaled), scaled, theta0, now.cost, iterations, evaluations,
        converged, whole, weights,
    )  # fmt: skip


def _damped_step(
    now: NormalEquations, w: FloatArray, low: FloatArray, high: FloatArray, damping: float,
    *, again: bool,
) -> FloatArray:  # fmt: skip
    """Return the step on the parameters that are not held by their bound.

    With ``again`` a parameter that would leave its box stops at the bound, and the step of all
    others is solved again with it there: a neighbour's step on a ridge would be wrong by as much.
    """
    held = ((w <= low) & (now.gradient > 0.0)) | ((w >= high) & (now.gradient < 0.0))
    least, most = np.maximum(low - w, -MAX_STEP), np.minimum(high - w, MAX_STEP)
    free = np.flatnonzero(~held)
    step = np.zeros_like(w)
    while free.size:
        matrix = now.information[np.ix_(free, free)]
        diagonal = np.diag(matrix)
        # A floor under the diagonal keeps a direction without information from any step size.
        floor = 1e-9 * float(np.max(diagonal)) + np.finfo(float).tiny
        damped = matrix + damping * np.diag(np.maximum(diagonal, floor))
        step[free] = 0.0
        slope = (now.gradient + now.information @ step)[free]
        step[free] = _solved(damped + 1e-14 * floor * np.eye(free.size), -slope)
        if not again:
            return np.asarray(np.clip(step, -MAX_STEP, MAX_STEP))
        room = np.where(step > 0.0, most, -least)[free]
        beyond = np.flatnonzero(np.abs(step[free]) > room)
        if beyond.size == 0:
            break
        first = int(beyond[np.argmin(room[beyond] / np.abs(step[free][beyond]))])
        stopped = free[first]
        step[stopped] = most[stopped] if step[stopped] > 0.0 else least[stopped]
        free = np.delete(free, first)
    return step


def _solved(matrix: FloatArray, right: FloatArray) -> FloatArray:
    """Return the solution; if several are, as of parameters of one effect, the shortest."""
    try:
        return np.asarray(np.linalg.solve(matrix, right), float)
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.lstsq(matrix, right, rcond=None)[0], float)


def newton_step(now: NormalEquations, model: Model, found: Fit) -> FloatArray:
    """Return the step (p,) to the minimum of the linearised model, scaled, within the bounds."""
    low, high = scaled_bounds(model.parameters)
    return _damped_step(now, found.scaled, low, high, 0.0, again=True)


def multi_start(
    model: Model,
    *,
    starts: int,
    seed: int,
    weights: FloatArray | None = None,
    spread: float = 0.35,
    relative_decrease: float = RELATIVE_DECREASE,
) -> tuple[Fit, ...]:
    """Return ``starts`` fits, best first: the model's own start, then seeded draws from the box.

    ``relative_decrease`` is that of the cost below which each ends.

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
    fits = [
        fit(model, to_natural(parameters, p), weights=weights, relative_decrease=relative_decrease)
        for p in points
    ]
    return tuple(sorted(fits, key=lambda f: f.cost))


def robust_weights(residuals: FloatArray, mask: FloatArray, loss: Loss) -> FloatArray:
    """Return IRLS weights (n,) in (0, 1], with the scale taken from the median deviation."""
    if loss is Loss.SQUARES:
        return np.ones_like(residuals)
    used = residuals[mask > 0.0]
    scale = MAD_TO_SIGMA * float(np.median(np.abs(used - np.median(used))))
    distance = np.abs(residuals) / max(HUBER_K * scale, np.finfo(float).tiny)
    return 1.0 / np.maximum(distance, 1.0)


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
