"""A model whose output follows from its input sample by sample, and all there is to say of its fit.

y = f(x; theta): a friction force over a speed, say. The author of an analysis gives f with its
derivatives; fit, intervals, verdicts, band and residual tests are the same for all such models.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np

from rigd.analysis import residuals as tests
from rigd.analysis.analysis import Options
from rigd.analysis.fit import Fit, Loss, multi_start, named, robust_fit
from rigd.analysis.identifiability import Evidence, judge
from rigd.analysis.model import (
    FitParameter,
    NormalEquations,
    scaled_bounds,
    slopes,
    stacked_normal_equations,
)
from rigd.analysis.profile import ProfileScan, axis, natural_ends, scan
from rigd.analysis.result import (
    BoolArray,
    Curve,
    FloatArray,
    IdentificationResult,
    ParameterEstimate,
    Preprocessing,
    Profile,
    Signal,
    StartOutcome,
    TrialFit,
)
from rigd.analysis.uncertainty import (
    Covariance,
    autocorrelation_time,
    correlation,
    covariance,
    delta_sd,
)
from rigd.model.errors import DataError

#: f(theta, x): values (n,) in the unit of the output and their derivatives (n, p).
Response = Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]

Z_95: Final = 1.959964
#: A profile reaches so many standard errors to either side, in so many steps.
_REACH: Final = 6.0
_STEPS: Final = 25
_CURVE_POINTS: Final = 60
_LAGS: Final = 50
_LJUNG_BOX_LAGS: Final = 20
#: Fewer samples of a trial say nothing of their scatter.
_FEWEST: Final = 8


@dataclass(frozen=True)
class ResponseQuantity:
    """What a parameter is called, and the excitation that would show it."""

    symbol: str
    meaning: str
    advice: str


@dataclass(frozen=True)
class Axis:
    """Name and unit of input or output."""

    name: str
    unit: str


@dataclass(frozen=True, eq=False)
class ResponseTrial:
    """One trial: (n,) even times in s, input, measured output, and which samples count."""

    label: str
    condition: str
    recording: str
    t_s: FloatArray
    x: FloatArray
    measured: FloatArray
    used: BoolArray


@dataclass(frozen=True, eq=False)
class ResponseModel:
    """The residuals (f(x) - measured)/scale of all trials; a :class:`rigd.analysis.model.Model`."""

    parameters: tuple[FitParameter, ...]
    response: Response
    trials: tuple[ResponseTrial, ...]
    scale: float  #: typical size of the output, in its unit

    @cached_property
    def trial_slices(self) -> tuple[slice, ...]:
        """Where each trial stands in the stacked residual."""
        ends = np.cumsum([len(trial.t_s) for trial in self.trials]).tolist()
        return tuple(slice(a, b) for a, b in zip([0, *ends], ends, strict=False))

    @cached_property
    def mask(self) -> FloatArray:
        """(n,) of 1 where a sample counts and 0 elsewhere."""
        return np.concatenate([trial.used for trial in self.trials]).astype(np.float64)

    @cached_property
    def x(self) -> FloatArray:
        """(n,) input of all trials."""
        return np.concatenate([trial.x for trial in self.trials])

    @cached_property
    def _measured(self) -> FloatArray:
        return np.concatenate([trial.measured for trial in self.trials])

    def residuals(self, theta: FloatArray) -> FloatArray:
        """Return the stacked residuals (n,)."""
        return (self.response(theta, self.x)[0] - self._measured) / self.scale

    def jacobian(self, theta: FloatArray) -> FloatArray:
        """Return d(residuals)/d(theta), (n, p)."""
        return self.response(theta, self.x)[1] / self.scale

    def cost(self, theta: FloatArray, weights: FloatArray | None = None) -> float:
        """Return 1/2 r'Wr."""
        error = self.residuals(theta)
        return 0.5 * float(np.sum(self._weights(weights) * error**2))

    def normal_equations(
        self, theta: FloatArray, weights: FloatArray | None = None
    ) -> NormalEquations:
        """Return cost, gradient and information."""
        return stacked_normal_equations(
            self.residuals(theta), self.jacobian(theta), self._weights(weights)
        )

    def _weights(self, weights: FloatArray | None) -> FloatArray:
        return self.mask if weights is None else self.mask * weights


@dataclass(frozen=True)
class Wording:
    """What a report says of the model: names, axes, and its parameters in their order."""

    model: str
    method: str
    title: str
    x: Axis
    y: Axis
    quantities: tuple[ResponseQuantity, ...]


def identify_response(
    model: ResponseModel,
    wording: Wording,
    options: Options,
    account: Preprocessing,
    *,
    block_s: float = 0.1,
) -> IdentificationResult:
    """Return the parameters of ``model`` with 95 % intervals from profiles, and verdicts.

    ``block_s`` is the longest correlation of the residuals that is accounted for.

    Raises:
        DataError: fewer than 8 samples of a trial count, or the cost is not finite.
    """
    used = int(np.count_nonzero(model.mask))
    for trial in model.trials:
        if np.count_nonzero(trial.used) < _FEWEST:
            raise DataError(
                f"{trial.label} has {np.count_nonzero(trial.used)} samples that count, "
                f"{_FEWEST} are needed",
                hint="record longer trials, or leave this one out",
            )
    fits = multi_start(model, starts=options.starts, seed=options.seed)
    loss = Loss.HUBER if options.robust else Loss.SQUARES
    best = robust_fit(model, fits[0], loss)
    period_s = float(np.median(np.diff(model.trials[0].t_s)))
    block = max(1, round(block_s / period_s))
    cov = covariance(model, best, block)
    error = model.residuals(best.theta)
    inflation = autocorrelation_time(error, model.mask, model.trial_slices, block)
    scans = [_scan(model, best, cov, inflation, i) for i in range(len(model.parameters))]
    pieces = [error[part][model.mask[part] > 0.0] for part in model.trial_slices]
    together = np.concatenate(pieces)
    shortest = min(len(piece) for piece in pieces)
    reached = model.x[model.mask > 0.0]
    low, high = float(np.min(reached)), float(np.max(reached))
    return IdentificationResult(
        model=wording.model,
        method=wording.method,
        title=wording.title,
        parameters=tuple(
            _estimate(model, best, cov, i, item, quantity)
            for i, (item, quantity) in enumerate(zip(scans, wording.quantities, strict=True))
        ),
        derived=(),
        confidence=0.95,
        correlation_names=tuple(parameter.name for parameter in model.parameters),
        correlation=correlation(cov.coloured),
        cost=best.cost,
        samples=used,
        effective_samples=used / inflation,
        inflation=float(np.sqrt(inflation)),
        starts=tuple(
            StartOutcome(
                named(model, fit.start), named(model, fit.theta), fit.cost, fit.iterations,
                fit.converged,
            )
            for fit in fits
        ),
        curve=_curve(model, best, cov, wording, (low, high)),
        trials=_trial_fits(model, best, wording),
        profiles=tuple(_profile(model, i, item) for i, item in enumerate(scans)),
        residual_tests=(
            tests.ljung_box(pieces, min(_LJUNG_BOX_LAGS, max(1, shortest // 4))),
            tests.normality(together, 1.0 / inflation),
            tests.outliers(together),
        ),
        autocorrelation=tests.autocorrelation(pieces, min(_LAGS, shortest - 1), period_s),
        preprocessing=account,
        visited=f"{wording.x.name} from {low:.3g} to {high:.3g} {wording.x.unit}",
        warnings=_warnings(model, fits, cov),
    )  # fmt: skip


def _scan(
    model: ResponseModel, best: Fit, cov: Covariance, inflation: float, index: int
) -> ProfileScan:
    """Return the profile of a parameter over what its standard error suggests, within its box."""
    bounds = scaled_bounds(model.parameters)
    least, most = float(bounds[0][index]), float(bounds[1][index])
    sd = float(np.sqrt(cov.coloured[index, index]))
    if sd > 0.0:
        centre = float(best.scaled[index])
        least, most = max(least, centre - _REACH * sd), min(most, centre + _REACH * sd)
    grid = np.linspace(least, most, _STEPS)
    return scan(model, best, axis(len(model.parameters), index), grid, inflation=inflation)


def _estimate(
    model: ResponseModel,
    best: Fit,
    cov: Covariance,
    index: int,
    found: ProfileScan,
    quantity: ResponseQuantity,
) -> ParameterEstimate:
    parameter = model.parameters[index]
    value = float(best.theta[index])
    low, high = natural_ends(model, index, found)
    evidence = Evidence(
        value,
        low,
        high,
        parameter.unit,
        bound=value if cov.on_bound[index] else None,
        allowed=(parameter.low, parameter.high),
    )
    verdict, sentence = judge(evidence)
    sd = float(np.sqrt(cov.coloured[index, index])) * parameter.slope(value)
    estimate = ParameterEstimate(
        parameter.name,
        quantity.symbol,
        parameter.unit,
        quantity.meaning,
        value,
        *evidence.ends,
        sd if sd > 0.0 else None,
        verdict,
        sentence,
        source="profile",
    )
    return estimate if estimate.identifiable else replace(estimate, advice=quantity.advice)


def _curve(
    model: ResponseModel,
    best: Fit,
    cov: Covariance,
    wording: Wording,
    visited: tuple[float, float],
) -> Curve:
    x = np.linspace(*visited, _CURVE_POINTS)
    y, derivative = model.response(best.theta, x)
    band = Z_95 * delta_sd(derivative * slopes(model.parameters, best.theta), cov.coloured)
    return Curve(
        "friction_curve", wording.x.name, wording.x.unit, wording.y.name, wording.y.unit,
        x, y, y - band, y + band,
    )  # fmt: skip


def _trial_fits(model: ResponseModel, best: Fit, wording: Wording) -> tuple[TrialFit, ...]:
    found = []
    for trial in model.trials:
        fitted = model.response(best.theta, trial.x)[0]
        rms, r_squared = tests.goodness(trial.measured[trial.used], fitted[trial.used])
        found.append(
            TrialFit(
                trial.label, trial.condition, wording.y.name, wording.y.unit,
                trial.t_s, trial.measured, fitted, trial.used, rms, r_squared, trial.recording,
                {wording.x.name: Signal(wording.x.unit, trial.x)},
            )
        )  # fmt: skip
    return tuple(found)


def _profile(model: ResponseModel, index: int, found: ProfileScan) -> Profile:
    parameter = model.parameters[index]
    values = np.array([parameter.natural(float(value)) for value in found.values])
    return Profile(
        parameter.name, parameter.unit, values, found.statistic, found.threshold,
        *natural_ends(model, index, found), log_axis=parameter.low > 0.0,
    )  # fmt: skip


def _warnings(model: ResponseModel, fits: Sequence[Fit], cov: Covariance) -> tuple[str, ...]:
    out = []
    if len(fits) > 1 and sum(fit.cost <= fits[0].cost * 1.001 for fit in fits) == 1:
        out.append(f"only one of {len(fits)} starts reached the best cost; try more starts")
    pairs = zip(model.parameters, cov.on_bound, strict=True)
    if held := [parameter.name for parameter, bound in pairs if bound]:
        out.append(f"on the bound of the allowed range: {', '.join(held)}")
    return tuple(out)
