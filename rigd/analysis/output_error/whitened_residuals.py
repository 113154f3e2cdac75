"""Defines the residuals of output error: whitened outputs, and what is known of constants."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rigd.analysis.fitting.model import FitParameter, NormalEquations, slopes, to_scaled
from rigd.analysis.output_error.innovations import Whitener
from rigd.analysis.output_error.system import System
from rigd.analysis.result import FloatArray

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
    """Whitened residuals of all trials and of the constants, as the fit asks.

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
    _columns: tuple[NDArray[np.intp], ...] = field(init=False, repr=False)

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
        rows, count, own = int(ends[-1]), len(shared), len(local)
        first = np.arange(count)
        columns = [
            np.concatenate([first, count + own * k + np.arange(own)]) for k in range(len(trials))
        ]
        slices += [slice(rows + k, rows + k + 1) for k in range(len(both.aim))]
        for name, value in (
            ("parameters", parameters),
            ("prior", prior),
            ("precision", precision),
            ("known", both),
            ("trial_slices", tuple(slices)),
            ("_columns", tuple(columns)),
            ("mask", np.ones(rows + len(both.aim))),
        ):
            object.__setattr__(self, name, value)

    @property
    def trials(self) -> int:
        """Return the number of trials."""
        return len(self.system.measured)

    def columns(self, trial: int) -> NDArray[np.intp]:
        """Return which parameters one trial depends on, (p + l,)."""
        return self._columns[trial]

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


def noise_at(system: System, theta: FloatArray) -> tuple[Whitener, ...]:
    """Return what whitens each trial close to ``theta``: shared, then local parameters (p,)."""
    shared, local = len(system.shared), len(system.local)
    found = []
    for trial in range(len(system.measured)):
        first = shared + local * trial
        at = system.deviations(trial, theta[:shared], theta[first : first + local])
        found.append(Whitener.of(at))
    return tuple(found)
