"""The likelihood of a few parameters of an output-error fit, over all its other unknowns.

The other unknowns (constants with what is stated of them, values of each trial) have Gaussian
priors and move the outputs nearly in proportion. With outputs in proportion and the noise known,
the integral over them is the least cost over them but for a constant factor (Gelman et al.,
Bayesian Data Analysis, 3rd ed. 2013, sec. 13.5). The least cost is found by chord steps: the
derivatives of all unknowns are those at an anchor, the residuals those of a new simulation
(Dennis and Schnabel, Numerical Methods for Unconstrained Optimization, 1983, sec. 5.4). One
evaluation so costs one or two simulations without derivatives.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rigd.analysis.fitting.model import scaled_bounds, slopes, to_natural, to_scaled
from rigd.analysis.fitting.uncertainty import scaled_pinv
from rigd.analysis.output_error.estimator import OutputErrorFit
from rigd.analysis.output_error.whitened_residuals import OutputErrorModel
from rigd.analysis.result import FloatArray

LITTLE = 0.05  #: of the statistic: what another step would gain, which is taken as gained
MOST_STEPS = 4
UNSEEN = 1e-9  #: information on a scaled parameter that is none


@dataclass(frozen=True, eq=False)
class Anchor:
    """A point with its derivatives: ``scaled`` (p,), ``jacobians`` (n, q) and ``places`` (q,).

    Jacobians are whitened, in scaled coordinates, one for each trial, of the unknowns at
    ``places`` alone. ``follows`` (r, d) is how the r other unknowns move with the d that are
    sampled; ``information`` (d, d) is that on those, the others eliminated; ``inverse`` (r, r).
    """

    scaled: FloatArray
    jacobians: tuple[FloatArray, ...]
    places: tuple[NDArray[np.intp], ...]
    follows: FloatArray
    information: FloatArray
    inverse: FloatArray

    @staticmethod
    def at(model: OutputErrorModel, theta: FloatArray, sampled: int) -> Anchor:
        """Return the anchor at ``theta`` (p,) natural; the first ``sampled`` are not eliminated."""
        scale, count = slopes(model.parameters, theta), len(theta)
        whole = model.known.rows.T @ model.known.rows
        jacobians, places = [], []
        for trial in range(model.trials):
            here = model.columns(trial)
            jacobian = model.linearise(trial, theta)[1] * scale[here]
            whole[np.ix_(here, here)] += jacobian.T @ jacobian
            jacobians.append(np.ascontiguousarray(jacobian[:, here >= sampled]))
            places.append(here[here >= sampled] - sampled)
        rest = np.arange(sampled, count)
        seen = rest[np.diag(whole)[rest] > UNSEEN]
        inverse = np.zeros((count, count))
        inverse[np.ix_(seen, seen)] = scaled_pinv(whole[np.ix_(seen, seen)])
        among = inverse[sampled:, sampled:]
        follows = -among @ whole[sampled:, :sampled]
        information = whole[:sampled, :sampled] + whole[:sampled, sampled:] @ follows
        return Anchor(
            to_scaled(model.parameters, theta), tuple(jacobians), tuple(places), follows,
            information, among,
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Marginal:
    """The marginal of the first ``sampled`` parameters of ``whole``, in scaled coordinates (d,).

    ``points`` (natural, (p,)) are others beside the end of the fit to take derivatives at, such as
    other optima. ``statistic`` is that of profiles, n ln(S/S_min)
    (:mod:`rigd.analysis.fitting.profile`). ``tempering`` is how much more the scores of the sampled
    parameters vary than those of white residuals do, on average (magnitude adjustment: Pauli,
    Racugno and Ventura, Statistica Sinica 21, 2011; Ribatet, Cooley and Davison, ibid. 22, 2012).
    """

    whole: OutputErrorFit
    sampled: int
    points: Sequence[FloatArray] = ()
    anchors: tuple[Anchor, ...] = field(init=False, repr=False)
    low: FloatArray = field(init=False)
    high: FloatArray = field(init=False)
    centres: FloatArray = field(init=False, repr=False)
    covariances: FloatArray = field(init=False, repr=False)
    tempering: float = field(init=False)

    def __post_init__(self) -> None:
        model, d = self.whole.model, self.sampled
        low, high = scaled_bounds(model.parameters)
        points = (self.whole.fit.theta, *self.points)
        anchors = tuple(Anchor.at(model, point, d) for point in points)
        for name, value in (
            ("anchors", anchors),
            ("low", low[:d]),
            ("high", high[:d]),
            ("tempering", _variance_ratio(self.whole, d)),
        ):
            object.__setattr__(self, name, value)
        covariances = np.array([self._covariance(anchor) for anchor in anchors])
        object.__setattr__(self, "centres", np.array([anchor.scaled[:d] for anchor in anchors]))
        object.__setattr__(self, "covariances", covariances)

    @property
    def samples(self) -> float:
        """Return n of the statistic: rows that count."""
        return float(np.count_nonzero(self.whole.model.mask))

    def log_density(self, scaled: FloatArray) -> float:
        """Return ln of the posterior at ``scaled`` (d,), up to a constant; -inf out of bounds.

        What the estimator maximises with a flat prior in its coordinates within the bounds.
        """
        if np.any(scaled < self.low) or np.any(scaled > self.high):
            return -math.inf
        return -0.5 * self.statistic(scaled) / self.tempering

    def statistic(self, scaled: FloatArray) -> float:
        """Return n ln(S/S_min) at ``scaled`` (d,), S the least cost over all other unknowns."""
        anchor = self._nearest(scaled)
        model, d = self.whole.model, self.sampled
        low, high = scaled_bounds(model.parameters)
        rest = anchor.scaled[d:] + anchor.follows @ (scaled - anchor.scaled[:d])
        enough = LITTLE * self.whole.fit.cost / self.samples
        best = math.inf
        for _ in range(MOST_STEPS):
            rest = np.clip(rest, low[d:], high[d:])
            cost, gradient = self._slope(anchor, np.append(scaled, rest))
            step = -anchor.inverse @ gradient
            gain = -0.5 * float(gradient @ step)
            if not math.isfinite(cost):
                break
            best = min(best, cost - gain) if gain < enough else min(best, cost)
            if gain < enough:
                break
            rest = rest + step
        if not math.isfinite(best):
            return math.inf
        return self.samples * math.log(best / self.whole.fit.cost)

    def _covariance(self, anchor: Anchor) -> FloatArray:
        """Return the covariance (d, d) of the posterior if it is a Gaussian around ``anchor``.

        What the data leave open the bounds hold, and the anchors share it: a uniform density has a
        variance of width^2/12.
        """
        scale = self.samples / (2.0 * self.whole.fit.cost * self.tempering)
        held = np.diag(12.0 * len(self.anchors) / (self.high - self.low) ** 2)
        return np.asarray(scaled_pinv(scale * anchor.information + held))

    def _nearest(self, scaled: FloatArray) -> Anchor:
        def away(anchor: Anchor) -> float:
            moved = scaled - anchor.scaled[: self.sampled]
            return float(moved @ anchor.information @ moved)

        return min(self.anchors, key=away)

    def _slope(self, anchor: Anchor, scaled: FloatArray) -> tuple[float, FloatArray]:
        """Return the cost at ``scaled`` (p,) and its gradient (r,), from ``anchor``."""
        model = self.whole.model
        theta = to_natural(model.parameters, scaled)
        pulls = model.prior_residuals(scaled)
        gradient = model.known.rows.T[self.sampled :] @ pulls
        cost = 0.5 * float(pulls @ pulls)
        with np.errstate(over="ignore", invalid="ignore"):
            for error, noise, jacobian, place in zip(
                model.errors(theta), model.noise, anchor.jacobians, anchor.places, strict=True
            ):
                white = noise.whiten_errors(error).ravel()
                cost += 0.5 * float(white @ white)
                gradient[place] += white @ jacobian
        return cost, gradient


def _variance_ratio(whole: OutputErrorFit, sampled: int) -> float:
    """Return the mean eigenvalue of sandwich over inverse information, 1 or more."""
    inverse, sandwich = whole.inverse[:sampled, :sampled], whole.covariance[:sampled, :sampled]
    seen = np.flatnonzero(np.diag(inverse) > 0.0)
    if seen.size == 0:
        return 1.0
    among = np.ix_(seen, seen)
    return max(1.0, float(np.trace(scaled_pinv(inverse[among]) @ sandwich[among])) / seen.size)
