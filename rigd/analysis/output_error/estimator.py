"""Output-error estimation: measured input in, predicted outputs out, constants with doubt.

A rig family brings a :class:`rigd.analysis.output_error.system.System`: it simulates each trial
from the measured input and returns the outputs with their exact sensitivities. Three kinds of
unknowns are fitted together:

- free parameters, which only the data determine;
- constants with an uncertainty u: each adds the residual (value - stated value) / u, so that the
  data may correct what they determine better, and what is left open widens the interval;
- local values of each trial (the begin of a position between two counts, an initial bristle).

Noise of the input makes the residuals of a simulated output drift, which plain least squares would
take for information. The residuals are whitened by the Kalman filter of the small deviations from
the simulated motion (:mod:`rigd.analysis.output_error.innovations`), with the noise that input and
sensors show themselves: the prediction error method (Ljung, System Identification, 2nd ed. 1999,
sec. 7.4). Covariances are sandwiches with block sums of the scores (HAC).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rigd.analysis.estimates import Share
from rigd.analysis.fitting.fit import DAMPING, Fit, fit, newton_step
from rigd.analysis.fitting.model import (
    NormalEquations,
    scaled_bounds,
    slopes,
    to_natural,
    to_scaled,
)
from rigd.analysis.fitting.uncertainty import bounds_reached, no_less, scaled_pinv
from rigd.analysis.output_error.system import Diverged, SomeTrials, System
from rigd.analysis.output_error.thresholds import THRESHOLDS
from rigd.analysis.output_error.whitened_residuals import FINITE, OutputErrorModel, noise_at
from rigd.analysis.result import FloatArray
from rigd.model.errors import DataError

NEAR = 1e-8  #: first damping near an optimum
MAX_ITERATIONS = 40
OTHER_ITERATIONS = 12  #: of a second optimum, and of a model that is far off
RANKING_TRIALS = 3  #: from the first to the last; the starts are ranked by these
RANKING_ITERATIONS = 8
REFINED = 2  #: optima that all trials refine
MORE_FITS = 3
DRAWN, MOST_ANEW = 8, 4  #: starts of a fit whose end may be wrong; how many all trials refine
#: Standard deviation of the farthest over the box: on three floors half of 14 at 0.1 led to the
#: right end, 15 of 16 at 0.05.
FARTHEST = 0.1
SEED = 48


#: A fit with the model, and so the noise, that it was made with.
Branch = tuple[OutputErrorModel, Fit]


@dataclass(frozen=True, eq=False)
class OutputErrorFit:
    """The end of the fit and how far it may be off; matrices (p, p) in scaled coordinates.

    ``covariance`` is the sandwich, of which ``from_data`` is the part of the noise; ``pulls`` (p,)
    is by how many of its own uncertainties each constant was moved, 0 for a free parameter.
    ``information``, ``scores`` and ``slope`` (p,) are of these data alone, without what is known of
    constants: J'J of the whitened Jacobian, the covariance of J'e, and J'e itself. ``left`` (p,) is
    the Newton step that remains, in standard errors; a bound stops it.
    ``errors`` are the residuals of each trial, (n, m), not whitened. ``others`` are the natural
    parameters (p,) of other optima that the data do not rule out at once.
    """

    model: OutputErrorModel
    fit: Fit
    covariance: FloatArray
    from_data: FloatArray
    inverse: FloatArray
    information: FloatArray
    scores: FloatArray
    slope: FloatArray
    left: FloatArray
    on_bound: tuple[bool, ...]
    pulls: FloatArray
    errors: tuple[FloatArray, ...]
    others: tuple[FloatArray, ...] = ()

    @property
    def converged(self) -> bool:
        """Whether the fit has come to its optimum: no number of another one means anything."""
        return bool(np.all(np.abs(self.left) <= THRESHOLDS.max_left_sd))

    @property
    def unsettled(self) -> str:
        """Which parameter has how far to go; empty if the fit has converged."""
        if self.converged:
            return ""
        far = np.nan_to_num(np.abs(self.left), nan=np.inf)
        worst = self.model.parameters[int(np.argmax(far))].name
        return f"the fit has not converged: {worst} has {np.max(far):.2g} standard errors to go"

    def budget(self, gradient: FloatArray) -> dict[str, float]:
        """Return the variance of a quantity by its sources.

        ``gradient`` (p,) is d(quantity)/d(scaled). The key ``"noise"`` is that of the data, the
        others are the wordings of the constants; local values count as noise.
        """
        shares = (gradient @ self.inverse) ** 2 * self.model.precision
        unknowns = self.model.system.shared
        found = {
            item.wording: float(share)
            for item, share in zip(unknowns, shares, strict=False)
            if math.isfinite(item.u)
        }
        local = float(np.sum(shares[len(unknowns) :]))
        if (more := self.model.elsewhere) is not None:
            moved = self.inverse @ gradient
            found["other groups"] = float(moved @ more.scores @ moved)
        return {"noise": float(gradient @ self.from_data @ gradient) + local, **found}

    def shares(self, gradient: FloatArray) -> tuple[Share, ...]:
        """Return what each stated constant adds to a quantity if it is 1 u larger.

        ``gradient`` (p,) is d(quantity)/d(scaled). With the inverse H of all information, of which
        the stated constants give P, the optimum moves by H P for each unit of what is stated.
        """
        moved = (gradient @ self.inverse) * np.sqrt(self.model.precision)
        return tuple(
            Share(item.parameter.name, item.parameter.start, item.u, float(effect))
            for item, effect in zip(self.model.system.shared, moved, strict=False)
            if math.isfinite(item.u) and effect
        )


def estimate(system: System, starts: Sequence[FloatArray], block: int) -> OutputErrorFit:
    """Return the best fit from ``starts``, each the shared parameters (p,) in natural units.

    A few trials rank the starts; all trials refine the best optima that differ. Optima are compared
    under one noise; one that has not converged is given only if none has. ``block`` is the longest
    correlation of the scores that is accounted for, in samples.

    Raises:
        Diverged: the cost of a trial is not finite at any start.
    """
    branches: list[Branch] = []
    ranked = _ranked(system, starts)
    refined = 0
    for start in ranked:
        iterations = OTHER_ITERATIONS if branches else MAX_ITERATIONS
        try:
            branch = _branch(system, start, iterations, THRESHOLDS.min_decrease_rough, NEAR)
        except Diverged:
            if start is ranked[-1] and not branches:
                raise
            continue
        if not _met(branch[1], branches, len(system.shared), THRESHOLDS.max_distance_one_optimum):
            branches.append(branch)
        if (refined := refined + 1) == REFINED:
            break
    order = by_cost(branches)
    near = [
        branch for cost, branch in order if cost < order[0][0] + THRESHOLDS.max_cost_behind_best
    ] or branches[:1]
    ends = [settled(*branch, block) for branch in near]
    able = [end for end in ends if end.converged] or ends
    first = by_cost([(end.model, end.fit) for end in able])[0][1][1]
    chosen = next(end for end in able if end.fit is first)
    return replace(chosen, others=tuple(end.fit.theta for end in ends if end is not chosen))


def improve(found: OutputErrorFit, theta: FloatArray, block: int) -> OutputErrorFit:
    """Return the fit continued from ``theta`` (p,), a better point than the end of ``found``."""
    ended = settled(found.model, _fit(found.model, theta, THRESHOLDS.min_decrease_rough), block)
    return replace(ended, others=(*found.others, found.fit.theta))


def retried(
    found: OutputErrorFit, beside: Callable[[OutputErrorFit], Sequence[FloatArray]], block: int,
    elsewhere: Callable[[], Sequence[FloatArray]] = list,
) -> OutputErrorFit:  # fmt: skip
    """Return ``found``, or the fit from the best point ``beside`` it if that is better.

    Along a bent ridge a fit may come to an end that is not the best of the ridge. If it is far off,
    or on a bound with no point beside it, it may be in a wrong place: then it begins anew first,
    from shared parameters (p,) ``elsewhere``. All points are natural.
    """
    starts = beside(found)
    if _gross(found.model, found.fit) or (_stopped(found) and not starts):
        found = _anew(found, elsewhere(), block)
        if _gross(found.model, found.fit):  # no other end is better
            return found
        starts = beside(found)
    best = found.fit
    for start in starts:
        try:
            ended = _fit(
                found.model,
                start,
                THRESHOLDS.min_decrease_rough,
                NEAR,
                OTHER_ITERATIONS,
                ridges=True,
            )
        except Diverged:
            continue
        best = min(best, ended, key=lambda item: item.cost)
    if best.cost > found.fit.cost - THRESHOLDS.min_cost_gained:
        return found
    again = improve(found, best.theta, block)
    return again if again.converged or not found.converged else found


def _stopped(found: OutputErrorFit) -> bool:
    """Whether a shared parameter that only the data determine is on its bound."""
    shared = found.model.system.shared
    ends = zip(shared, found.on_bound[: len(shared)], strict=True)
    return any(math.isinf(item.u) and on_bound for item, on_bound in ends)


def _anew(found: OutputErrorFit, starts: Sequence[FloatArray], block: int) -> OutputErrorFit:
    """Return a better fit from ``starts``, shared parameters (p,), or ``found`` if there is none.

    If all ends are far off, the model is wrong, and a lower cost shows less of why.
    """
    system, before = found.model.system, (found.model, found.fit)
    with np.errstate(over="ignore", invalid="ignore"):  # far from any motion
        try:
            ranked = _ranked(system, starts)
        except Diverged:
            return found
        for start in ranked[:MOST_ANEW]:
            try:
                branch = _branch(
                    system, start, OTHER_ITERATIONS, THRESHOLDS.min_decrease_rough, NEAR
                )
            except Diverged:
                continue
            if not _gross(*branch):
                (least, best), (second, _) = by_cost([branch, before])
                if best is before or second - least < THRESHOLDS.min_cost_gained:
                    return found
                return replace(settled(*branch, block), others=(*found.others, found.fit.theta))
    return found


def drawn(system: System) -> list[FloatArray]:
    """Return shared parameters (p,), natural, of which those that only data determine are drawn.

    The first are the starts that are stated; the others lie farther and farther from them.
    """
    parameters = [item.parameter for item in system.shared]
    low, high = scaled_bounds(parameters)
    spread = np.where([math.isinf(item.u) for item in system.shared], FARTHEST * (high - low), 0.0)
    centre = to_scaled(parameters, np.array([item.start for item in parameters]))
    draws = np.random.default_rng(SEED).standard_normal((DRAWN, len(parameters)))
    draws *= np.linspace(0.0, 1.0, DRAWN)[:, None]
    points = np.clip(centre + spread * draws, low, high)
    return [to_natural(parameters, point) for point in points]


def settled(model: OutputErrorModel, found: Fit, block: int) -> OutputErrorFit:
    """Return the fit continued until it has converged under the noise of its end, or has not.

    ``block`` is the longest correlation of the scores that is accounted for, in samples.
    """
    for enough in (THRESHOLDS.min_decrease_rough, THRESHOLDS.min_decrease):
        model, found = _reweighted(model, found, enough)
    ended = conclude(model, found, block)
    for _ in range(MORE_FITS):
        if np.all(np.abs(ended.left) <= THRESHOLDS.max_left_settled_sd) or _gross(model, ended.fit):
            break
        enough = 0.1 * THRESHOLDS.max_left_settled_sd**2 / ended.fit.cost
        ended = conclude(model, _fit(model, ended.fit.theta, enough, ridges=True), block)
    return ended


def _gross(model: OutputErrorModel, found: Fit) -> bool:
    """Whether the model is far off: a lower cost is then a stranger one, and shows less of why."""
    return not 2.0 * found.cost < THRESHOLDS.max_mean_square_continued * len(model.mask)


def by_cost(branches: Sequence[Branch]) -> list[tuple[float, Branch]]:
    """Return ``branches`` by their cost under one noise, that at the best of them.

    Under noise of its own, an optimum that takes much for noise would win.
    """
    best = branches[0]
    if len(branches) == 1:
        return [(best[1].cost, best)]
    costs: list[float] = []
    for _ in branches:
        model, found = best
        noise = noise_at(model.system, found.theta)
        costs = [
            cost
            if math.isfinite(cost := replace(model, noise=noise).cost(other.theta))
            else math.inf
            for _, other in branches
        ]
        winner = branches[int(np.argmin(costs))]
        if winner is best:
            break
        best = winner
    order = np.argsort(costs, kind="stable")
    return [(costs[int(k)], branches[int(k)]) for k in order]


def _ranked(system: System, starts: Sequence[FloatArray]) -> list[FloatArray]:
    """Return the optima of ``starts`` on a few of the trials, the best first, each once.

    Raises:
        Diverged: the cost of a trial is not finite at any start.
    """
    if len(starts) < 2:
        return list(starts)
    count = len(system.measured)
    few = np.unique(np.linspace(0, count - 1, min(RANKING_TRIALS, count)).astype(int))
    part = SomeTrials(system, tuple(int(k) for k in few))
    ends: list[Branch] = []
    for start in starts:
        try:
            ends.append(
                _branch(part, start, RANKING_ITERATIONS, THRESHOLDS.min_decrease_ranking, DAMPING)
            )
        except Diverged as error:
            if start is starts[-1] and not ends:
                raise Diverged(part.trials[error.trial]) from error
    distinct: list[Branch] = []
    for _, end in by_cost(ends):
        if not _met(
            end[1], distinct, len(system.shared), THRESHOLDS.max_distance_one_optimum_ranking
        ):
            distinct.append(end)
    return [found.theta[: len(system.shared)] for _, found in distinct]


def _branch(
    system: System, start: FloatArray, iterations: int, enough: float, damping: float
) -> Branch:
    """Return the fit from the shared parameters ``start`` (p,), with the noise as at its start.

    Raises:
        Diverged: the cost of a trial is not finite there.
    """
    local = [item.parameter.start for item in system.local]
    for trial in range(len(system.measured)):
        if not np.max(np.abs(system.simulate(trial, start, np.array(local)))) < FINITE:
            raise Diverged(trial)
    theta = np.concatenate([start, np.tile(local, len(system.measured))])
    model = OutputErrorModel(system, noise_at(system, theta))
    return model, _fit(model, theta, enough, damping, iterations)


def _met(found: Fit, others: Sequence[Branch], count: int, same: float) -> bool:
    """Whether ``found`` has ended in one of the ``others``, by the first ``count`` parameters."""
    return any(
        np.allclose(found.scaled[:count], other.scaled[:count], rtol=0.0, atol=same)
        for _, other in others
    )


def _reweighted(model: OutputErrorModel, found: Fit, enough: float) -> Branch:
    """Return the model with the noise as it moves the outputs at ``found``, and its fit.

    If that noise leaves the numbers, as far from the optimum, both stay.
    """
    other, gross = replace(model, noise=noise_at(model.system, found.theta)), _gross(model, found)
    iterations = OTHER_ITERATIONS if gross else MAX_ITERATIONS
    try:
        fitted = _fit(other, found.theta, enough, iterations=iterations, ridges=not gross)
        return other, fitted
    except Diverged:
        return model, found


def _fit(
    model: OutputErrorModel, start: FloatArray, enough: float, damping: float = NEAR,
    iterations: int = MAX_ITERATIONS, *, ridges: bool = False,
) -> Fit:  # fmt: skip
    """Return the fit from ``start`` (p,), natural.

    Raises:
        Diverged: the cost of a trial is not finite there.
    """
    try:
        return fit(
            model, start, max_iterations=iterations, relative_decrease=enough, damping=damping,
            thorough=True, ridges=ridges,
        )  # fmt: skip
    except DataError as error:
        raise Diverged(diverged(model, start)) from error


def diverged(model: OutputErrorModel, theta: FloatArray) -> int:
    """Return the first trial whose simulation leaves the numbers at ``theta`` (p,), natural."""
    parts = [np.sum(np.abs(model.linearise(k, theta)[1])) for k in range(model.trials)]
    return int(np.argmax(~(np.array(parts) < FINITE)))


def conclude(model: OutputErrorModel, best: Fit, block: int) -> OutputErrorFit:
    """Return ``best`` with its covariance from block sums of the scores.

    The scores of innovations add up as in the information. If block sums vary more, the model
    leaves something that remembers, and they count; that they vary less by chance never does. A
    parameter on its bound is taken as free: held, it would lend the others a certainty that the
    data do not have.
    """
    count = len(model.parameters)
    scale = slopes(model.parameters, best.theta)
    information, slope = np.zeros((count, count)), np.zeros(count)
    scores = []
    for trial in range(model.trials):
        error, jacobian = model.linearise(trial, best.theta)
        here = model.columns(trial)
        jacobian = jacobian * scale[here]
        information[np.ix_(here, here)] += jacobian.T @ jacobian
        slope[here] += jacobian.T @ error
        edges = np.arange(0, len(error), block * len(model.system.outputs))
        sums = np.zeros((len(edges), count))
        sums[:, here] = np.add.reduceat(jacobian * error[:, None], edges, axis=0)
        scores.append(sums)
    known = model.known.rows.T @ model.known.rows
    gradient = slope + model.known.rows.T @ model.prior_residuals(best.scaled)
    inverse, seen = _inverted(information + known)
    both = np.ix_(seen, seen)
    varied = np.zeros((count, count))
    blocks = np.concatenate(scores)[:, seen]
    varied[both] = no_less(blocks.T @ blocks, information[both])
    from_data = inverse @ varied @ inverse
    pulls = np.sqrt(model.precision) * (best.scaled - model.prior)
    covariance = from_data + inverse @ model.known.scores @ inverse
    left = _left(NormalEquations(best.cost, gradient, information + known), model, best, covariance)
    return OutputErrorFit(
        model=model,
        fit=best,
        covariance=covariance,
        from_data=from_data,
        inverse=inverse,
        information=information,
        scores=varied,
        slope=slope,
        left=left,
        on_bound=bounds_reached(model, best.scaled),
        pulls=pulls,
        errors=tuple(model.errors(best.theta)),
    )


def _inverted(information: FloatArray) -> tuple[FloatArray, NDArray[np.intp]]:
    """Return the inverse (p, p), 0 for what has no information, and the indices that have some."""
    seen = np.flatnonzero(np.diag(information) > THRESHOLDS.min_information)
    inverse = np.zeros_like(information)
    inverse[np.ix_(seen, seen)] = scaled_pinv(information[np.ix_(seen, seen)])
    return inverse, seen


def _left(
    now: NormalEquations, model: OutputErrorModel, best: Fit, covariance: FloatArray
) -> FloatArray:
    """Return the Newton step (p,) that remains within the bounds, in standard errors.

    In the linearised model the cost would fall by half the square of ``most``, and no parameter has
    more standard errors to go; a direction that ``covariance`` leaves out as unseen has less.
    """
    step = newton_step(now, model, best)
    free = np.flatnonzero(step != 0.0)
    inverse = scaled_pinv(now.information[np.ix_(free, free)])
    most = math.sqrt(max(float(now.gradient[free] @ inverse @ now.gradient[free]), 0.0))
    sds = np.sqrt(np.maximum(np.diag(covariance), np.finfo(float).tiny))
    return np.asarray(np.clip(step / sds, -most, most))
