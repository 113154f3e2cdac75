"""Output-error estimation: measured input in, predicted outputs out, constants with doubt.

A rig family brings a :class:`rigd.analysis.system.System`: it simulates each trial from the
measured input and returns the outputs with their exact sensitivities. Three kinds of unknowns are
fitted together:

- free parameters, which only the data determine;
- constants with an uncertainty u: each adds the residual (value - stated value) / u, so that the
  data may correct what they determine better, and what is left open widens the interval;
- local values of each trial (the begin of a position between two counts, an initial bristle).

Noise of the input makes the residuals of a simulated output drift, which plain least squares would
take for information. The residuals are whitened by the Kalman filter of the small deviations from
the simulated motion (:mod:`rigd.analysis.innovations`), with the noise that input and sensors show
themselves: the prediction error method (Ljung, System Identification, 2nd ed. 1999, sec. 7.4).
Covariances are sandwiches with block sums of the scores (HAC).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from rigd.analysis.fit import DAMPING, Fit, fit
from rigd.analysis.innovations import Whitener
from rigd.analysis.model import FitParameter, NormalEquations, slopes, to_scaled
from rigd.analysis.result import FloatArray
from rigd.analysis.system import SomeTrials, System
from rigd.analysis.uncertainty import RELATIVE_RANK, bounds_reached, scaled_pinv
from rigd.model.errors import DataError

SAME = 0.05  #: in scaled coordinates: two starts have ended in one optimum
ENOUGH = 1e-7  #: relative decrease of the cost below which a fit ends
ROUGH = 1e-5  #: and below which one ends that is repeated with a better filter of the noise
NEAR = 1e-8  #: first damping near an optimum
MAX_ITERATIONS = 40
OTHER_ITERATIONS = 12  #: of a second optimum, until it is known to be near as good
RANKING_TRIALS = 3  #: from the first to the last; the starts are ranked by these
RANKING_ITERATIONS = 8
RANKING_DECREASE = 1e-2
REFINED = 2  #: optima that all trials refine
RANKING_SAME = 0.2
HOPELESS = 30.0  #: in -ln L: an optimum that is so much worse does not come back
UNSEEN = 1e-9  #: information on a scaled parameter that is none
FINITE = 1e120  #: information beyond it: the simulation has left the numbers


@dataclass(frozen=True, eq=False)
class Knowledge:
    """What is known of parameters (p,) besides the data: residuals ``rows`` (r, p) @ scaled - aim.

    ``scores`` (p, p) is the covariance of ``rows``' times these residuals: rows'rows, or more.
    """

    rows: FloatArray
    aim: FloatArray
    scores: FloatArray

    def joined(self, other: Knowledge) -> Knowledge:
        """Return what is known from both."""
        rows, aim = np.vstack([self.rows, other.rows]), np.append(self.aim, other.aim)
        return Knowledge(rows, aim, self.scores + other.scores)


@dataclass(frozen=True, eq=False)
class OutputErrorModel:
    """Whitened residuals of all trials and of the constants, as :mod:`rigd.analysis.fit` asks.

    The parameters are the shared ones, then the local ones trial by trial. Residuals are of unit
    variance; the last rows are those of what is stated of constants, then those of ``elsewhere``.
    ``noise`` whitens each trial.
    """

    system: System
    noise: tuple[Whitener, ...]
    elsewhere: Knowledge | None = None
    parameters: tuple[FitParameter, ...] = field(init=False)
    prior: FloatArray = field(init=False, repr=False)
    precision: FloatArray = field(init=False, repr=False)
    known: Knowledge = field(init=False, repr=False)  #: stated, then from elsewhere
    trial_slices: tuple[slice, ...] = field(init=False, repr=False)
    mask: FloatArray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        shared, local = self.system.shared, self.system.local
        trials = self.system.measured
        unknowns = [*shared, *(item for _ in trials for item in local)]
        parameters = tuple(item.parameter for item in unknowns)
        precision = np.array([1.0 / item.u**2 for item in unknowns])  # 0 of a free one
        ends = np.cumsum([item.size for item in trials])
        slices = [slice(int(e) - t.size, int(e)) for e, t in zip(ends, trials, strict=True)]
        prior = to_scaled(parameters, np.array([item.start for item in parameters]))
        stated = np.diag(np.sqrt(precision))[precision > 0.0]
        both = Knowledge(stated, stated @ prior, np.diag(precision))
        both = both if self.elsewhere is None else both.joined(self.elsewhere)
        rows = int(ends[-1])
        slices += [slice(rows + k, rows + k + 1) for k in range(len(both.aim))]
        for name, value in (
            ("parameters", parameters),
            ("prior", prior),
            ("precision", precision),
            ("known", both),
            ("trial_slices", tuple(slices)),
            ("mask", np.ones(rows + len(both.aim))),
        ):
            object.__setattr__(self, name, value)

    @property
    def trials(self) -> int:
        """Return the number of trials."""
        return len(self.system.measured)

    def columns(self, trial: int) -> NDArray[np.intp]:
        """Return which parameters one trial depends on, (p + l,)."""
        shared, local = len(self.system.shared), len(self.system.local)
        return np.concatenate(
            [np.arange(shared), shared + local * trial + np.arange(local)]
        ).astype(np.intp)

    def errors(self, theta: FloatArray) -> list[FloatArray]:
        """Return prediction minus measurement of each trial, (n, m), in the outputs' units."""
        return [self._simulate(k, theta) - self.system.measured[k] for k in range(self.trials)]

    def residuals(self, theta: FloatArray) -> FloatArray:
        """Return the whitened residuals, (n,)."""
        white = [
            noise.whiten_errors(error).ravel()
            for noise, error in zip(self.noise, self.errors(theta), strict=True)
        ]
        return np.concatenate([*white, self.prior_residuals(to_scaled(self.parameters, theta))])

    def jacobian(self, theta: FloatArray) -> FloatArray:
        """Return d(residuals)/d(theta), (n, p)."""
        out = np.zeros((len(self.mask), len(self.parameters)))
        for trial, part in zip(range(self.trials), self.trial_slices, strict=False):
            out[part, self.columns(trial)] = self.linearise(trial, theta)[1]
        rows = self.known.rows
        out[len(out) - len(rows) :] = rows / slopes(self.parameters, theta)
        return out

    def linearise(self, trial: int, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the whitened residuals (n m,) of one trial and their derivatives (n m, p + l)."""
        error, jacobian = self._raw(trial, theta)
        white = self.noise[trial].whiten(np.concatenate([error[:, :, None], jacobian], axis=2))
        return white[:, :, 0].ravel(), white[:, :, 1:].reshape(error.size, -1)

    def cost(self, theta: FloatArray, weights: FloatArray | None = None) -> float:
        """Return half the sum of squared residuals."""
        with np.errstate(over="ignore", invalid="ignore"):
            squares = self.residuals(theta) ** 2
        return 0.5 * float(np.sum(squares if weights is None else weights * squares))

    def normal_equations(
        self, theta: FloatArray, weights: FloatArray | None = None
    ) -> NormalEquations:
        """Return cost, gradient and information, trial by trial."""
        pulls = self.prior_residuals(to_scaled(self.parameters, theta))
        rows = self.known.rows / slopes(self.parameters, theta)
        gradient, information = rows.T @ pulls, rows.T @ rows
        cost = 0.5 * float(pulls @ pulls)
        for trial, part in zip(range(self.trials), self.trial_slices, strict=False):
            error, jacobian = self._raw(trial, theta)
            used = np.ones_like(error) if weights is None else weights[part].reshape(error.shape)
            share, by, of_trial = self.noise[trial].normal_equations(error, jacobian, used)
            if not (math.isfinite(share) and np.max(np.abs(of_trial)) < FINITE):
                return NormalEquations(math.inf, gradient, information)
            here = self.columns(trial)
            cost += share
            gradient[here] += by
            information[np.ix_(here, here)] += of_trial
        return NormalEquations(cost, gradient, information)

    def _raw(self, trial: int, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return prediction minus measurement of one trial (n, m), and the derivatives."""
        shared, here = len(self.system.shared), self.columns(trial)
        predicted, jacobian = self.system.linearise(trial, theta[:shared], theta[here[shared:]])
        return predicted - self.system.measured[trial], jacobian

    def _simulate(self, trial: int, theta: FloatArray) -> FloatArray:
        shared = len(self.system.shared)
        return self.system.simulate(trial, theta[:shared], theta[self.columns(trial)[shared:]])

    def prior_residuals(self, scaled: FloatArray) -> FloatArray:
        """Return by how many uncertainties parameters (p,) are off what is known, (r,)."""
        return np.asarray(self.known.rows @ scaled - self.known.aim)


#: A fit with the model, and so the noise, that it was made with.
Branch = tuple[OutputErrorModel, Fit]


@dataclass(frozen=True, eq=False)
class OutputErrorFit:
    """The end of the fit and how far it may be off; matrices (p, p) in scaled coordinates.

    ``covariance`` is the sandwich, of which ``from_data`` is the part of the noise; ``pulls`` (p,)
    is by how many of its own uncertainties each constant was moved, 0 for a free parameter.
    ``information``, ``scores`` and ``slope`` (p,) are of these data alone, without what is known of
    constants: J'J of the whitened Jacobian, the covariance of J'e, and J'e itself.
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
    on_bound: tuple[bool, ...]
    pulls: FloatArray
    errors: tuple[FloatArray, ...]
    others: tuple[FloatArray, ...] = ()

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


def estimate(system: System, starts: Sequence[FloatArray], block: int) -> OutputErrorFit:
    """Return the best fit from ``starts``, each the shared parameters (p,) in natural units.

    A few trials rank the starts; all trials refine the best optima that differ. ``block`` is the
    longest correlation of the scores that is accounted for, in samples.

    Raises:
        DataError: the cost is not finite at any start.
    """
    branches: list[Branch] = []
    for start in _ranked(system, starts)[:REFINED]:
        iterations = OTHER_ITERATIONS if branches else MAX_ITERATIONS
        branch = _branch(system, start, iterations, ROUGH, NEAR)
        if not _met(branch[1], branches, len(system.shared), SAME):
            branches.append(branch)
    best = min(likelihood(*branch) for branch in branches)
    near = [branch for branch in branches if likelihood(*branch) < best + HOPELESS]
    for enough in (ROUGH, ENOUGH):
        near = [_reweighted(*branch, enough) for branch in near]
    near.sort(key=lambda branch: likelihood(*branch))
    others = tuple(found.theta for _, found in near[1:])
    return replace(conclude(*near[0], block), others=others)


def improve(found: OutputErrorFit, theta: FloatArray, block: int) -> OutputErrorFit:
    """Return the fit continued from ``theta`` (p,), a better point than the end of ``found``."""
    model, best = found.model, _fit(found.model, theta, ROUGH)
    for enough in (ROUGH, ENOUGH):
        model, best = _reweighted(model, best, enough)
    return replace(conclude(model, best, block), others=(*found.others, found.fit.theta))


def _ranked(system: System, starts: Sequence[FloatArray]) -> list[FloatArray]:
    """Return the optima of ``starts`` on a few of the trials, the best first, each once.

    Raises:
        DataError: the cost is not finite at any start.
    """
    if len(starts) < 2:
        return list(starts)
    count = len(system.measured)
    few = np.unique(np.linspace(0, count - 1, min(RANKING_TRIALS, count)).astype(int))
    part = SomeTrials(system, tuple(int(k) for k in few))
    ends: list[Branch] = []
    for start in starts:
        try:
            ends.append(_branch(part, start, RANKING_ITERATIONS, RANKING_DECREASE, DAMPING))
        except DataError:
            if start is starts[-1] and not ends:
                raise
    distinct: list[Branch] = []
    for end in sorted(ends, key=lambda branch: likelihood(*branch)):
        if not _met(end[1], distinct, len(system.shared), RANKING_SAME):
            distinct.append(end)
    return [found.theta[: len(system.shared)] for _, found in distinct]


def _branch(
    system: System, start: FloatArray, iterations: int, enough: float, damping: float
) -> Branch:
    """Return the fit from the shared parameters ``start`` (p,), with the noise as at its start.

    Raises:
        DataError: the cost is not finite there.
    """
    local = [item.parameter.start for item in system.local]
    for trial in range(len(system.measured)):
        if not np.max(np.abs(system.simulate(trial, start, np.array(local)))) < FINITE:
            raise DataError(
                "the simulation leaves the numbers at the start of a fit",
                hint="a constant or a signal is far from what the rig has: compare both with the "
                "rig (`rigd report FILE` shows signals, `rigd identify FILE --set` corrects "
                "constants)",
            )
    theta = np.concatenate([start, np.tile(local, len(system.measured))])
    model = OutputErrorModel(system, noise_at(system, theta))
    found = fit(model, theta, max_iterations=iterations, relative_decrease=enough, damping=damping)
    return model, found


def _met(found: Fit, others: Sequence[Branch], count: int, same: float) -> bool:
    """Whether ``found`` has ended in one of the ``others``, by the first ``count`` parameters."""
    return any(
        np.allclose(found.scaled[:count], other.scaled[:count], rtol=0.0, atol=same)
        for _, other in others
    )


def noise_at(system: System, theta: FloatArray) -> tuple[Whitener, ...]:
    """Return what whitens each trial close to ``theta``: shared, then local parameters (p,)."""
    shared, local = len(system.shared), len(system.local)
    found = []
    for trial in range(len(system.measured)):
        first = shared + local * trial
        at = system.deviations(trial, theta[:shared], theta[first : first + local])
        found.append(Whitener.of(at))
    return tuple(found)


def _reweighted(model: OutputErrorModel, found: Fit, enough: float) -> Branch:
    """Return the model with the noise as it moves the outputs at ``found``, and its fit."""
    model = replace(model, noise=noise_at(model.system, found.theta))
    return model, _fit(model, found.theta, enough)


def likelihood(model: OutputErrorModel, found: Fit) -> float:
    """Return -ln L up to a constant: costs under different noise do not compare."""
    return found.cost - sum(noise.log_scale for noise in model.noise)


def _fit(model: OutputErrorModel, start: FloatArray, enough: float, damping: float = NEAR) -> Fit:
    return fit(
        model, start, max_iterations=MAX_ITERATIONS, relative_decrease=enough, damping=damping
    )


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
    seen = np.flatnonzero(np.diag(information + known) > UNSEEN)
    both = np.ix_(seen, seen)
    inverse, varied = np.zeros((count, count)), np.zeros((count, count))
    inverse[both] = scaled_pinv((information + known)[both])
    varied[both] = _score_covariance(information[both], np.concatenate(scores)[:, seen])
    from_data = inverse @ varied @ inverse
    pulls = np.sqrt(model.precision) * (best.scaled - model.prior)
    return OutputErrorFit(
        model=model,
        fit=best,
        covariance=from_data + inverse @ model.known.scores @ inverse,
        from_data=from_data,
        inverse=inverse,
        information=information,
        scores=varied,
        slope=slope,
        on_bound=bounds_reached(model, best.scaled),
        pulls=pulls,
        errors=tuple(model.errors(best.theta)),
    )


def _score_covariance(information: FloatArray, blocks: FloatArray) -> FloatArray:
    """Return the covariance (p, p) of the scores: of ``blocks`` (b, p), no less than white ones.

    Both are compared in the directions in which they differ most (simultaneous diagonalisation).
    """
    scale = np.sqrt(np.maximum(np.diag(information), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(information / np.outer(scale, scale))
    known = values > RELATIVE_RANK * values[-1]
    root = (vectors[:, known] * np.sqrt(values[known])) * scale[:, None]
    whiten = (vectors[:, known] / np.sqrt(values[known])) / scale[:, None]
    among = whiten.T @ (blocks.T @ blocks) @ whiten
    ratio, directions = np.linalg.eigh(among)
    turned = root @ directions
    return np.asarray((turned * np.maximum(ratio, 1.0)) @ turned.T)
