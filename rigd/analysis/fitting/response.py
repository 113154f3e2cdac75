"""Fits models whose output depends only on the input at the same time, and evaluates the fit.

The model is y = f(x; theta), for example a friction force over a speed. The author of an analysis
gives f with its derivatives by theta. The module does the rest in the same way for all such models:

- the fit of the parameters theta, and their 95 % intervals (from profiles of the cost);
- the verdict on each parameter (whether the data determine it, and why);
- the fitted curve with its 95 % band;
- the tests whether the residuals (fitted minus measured output) look like noise.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np

from rigd.analysis.analysis import Options
from rigd.analysis.fitting import residuals as tests
from rigd.analysis.fitting.agreement import agreement
from rigd.analysis.fitting.directions import directions
from rigd.analysis.fitting.fit import fit
from rigd.analysis.fitting.identification import FittedSubject, identify_model
from rigd.analysis.fitting.interval_width import Spread
from rigd.analysis.fitting.model import (
    FitParameter,
    NormalEquations,
    stacked_normal_equations,
)
from rigd.analysis.fitting.uncertainty import autocorrelation_time
from rigd.analysis.result import (
    BoolArray,
    Curve,
    FloatArray,
    IdentificationResult,
    Preprocessing,
    ResidualTest,
    Signal,
    TrialFit,
)
from rigd.model.errors import DataError

#: f(theta, x): values (n,) in the unit of the output and their derivatives (n, p).
Response = Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]

_CURVE_POINTS: Final = 60
#: Fewer samples of a trial do not determine their scatter.
_FEWEST: Final = 8


@dataclass(frozen=True)
class ResponseQuantity:
    """The name of a parameter, and the excitation that would show it."""

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
    """One trial: (n,) times in s, input, measured output, and which samples count.

    ``otherwise`` are input and output (n,) as another processing has them: how far the parameters
    move with it is in their intervals. ``direction`` (n,) is +1 where the motion is forward and -1
    where it is backward, of a trial whose input and output are taken in the direction of motion:
    that both directions have the model in common is tested.
    """

    label: str
    condition: str
    recording: str
    t_s: FloatArray
    x: FloatArray
    measured: FloatArray
    used: BoolArray
    otherwise: tuple[FloatArray, FloatArray] | None = None
    direction: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class ResponseModel:
    """The residuals (f(x) - measured)/scale of all trials; a ``Model`` for the estimators."""

    parameters: tuple[FitParameter, ...]
    response: Response
    trials: tuple[ResponseTrial, ...]
    scale: float  #: typical size of the output, in its unit

    @cached_property
    def trial_slices(self) -> tuple[slice, ...]:
        """Place of each trial in the stacked residual."""
        ends = np.cumsum([len(trial.t_s) for trial in self.trials]).tolist()
        return tuple(slice(a, b) for a, b in zip([0, *ends], ends, strict=False))

    @cached_property
    def mask(self) -> FloatArray:
        """(n,) of 1 if a sample counts and 0 if not."""
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
    """The words of the report on the model: names, axes, and its parameters in their order."""

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

    ``block_s`` is the longest correlation of the residuals that is accounted for, at the highest
    rate of the trials: of slower ones, longer correlations are.

    Raises:
        DataError: fewer than 8 samples of a trial count, or the cost is not finite.
    """
    for trial in model.trials:
        if np.count_nonzero(trial.used) < _FEWEST:
            raise DataError(
                f"{trial.label} has {np.count_nonzero(trial.used)} samples that count, "
                f"{_FEWEST} are needed",
                hint="record longer trials, or leave this one out",
            )
    period_s = min(float(np.median(np.diff(trial.t_s))) for trial in model.trials)
    reached = model.x[model.mask > 0.0]
    low, high = float(np.min(reached)), float(np.max(reached))
    subject = FittedSubject(
        model=model,
        name=wording.model,
        method=wording.method,
        title=wording.title,
        words=wording.quantities,
        account=account,
        period_s=period_s,
        visited=f"{wording.x.name} from {low:.3g} to {high:.3g} {wording.x.unit}",
        curve=lambda spread: _curve(model, spread, wording, (low, high)),
        trials=lambda theta: _trial_fits(model, theta, wording),
        block_s=block_s,
        others=lambda best: _otherwise(model, best.theta),
        scale=model.scale,
        unit=wording.y.unit,
    )
    result = identify_model(subject, options)
    block = max(1, round(block_s / period_s))
    further = [
        test
        for test in (_agreement(model, result, block), _directions(model, result, wording, block))
        if test is not None
    ]
    return replace(
        result,
        residual_tests=(*result.residual_tests, *further),
        warnings=(*result.warnings, *(test.sentence for test in further if not test.passed)),
    )


def one_way(model: ResponseModel, direction: float) -> ResponseModel:
    """Return ``model`` of the samples forward (1.0) or backward (-1.0) alone.

    Trials with fewer of them than determine their scatter are left out.
    """
    trials = (
        replace(trial, used=trial.used & (trial.direction == direction)) for trial in model.trials
    )
    kept = tuple(trial for trial in trials if np.count_nonzero(trial.used) >= _FEWEST)
    return replace(model, trials=kept)


def _directions(
    model: ResponseModel, result: IdentificationResult, wording: Wording, block: int
) -> ResidualTest | None:
    """Return the test whether both directions share the model; None if all goes one way."""
    each = [trial.direction for trial in model.trials if trial.direction is not None]
    if len(each) < len(model.trials) or not all(one_way(model, x).trials for x in (1.0, -1.0)):
        return None
    theta = np.array([item.estimate for item in result.parameters])
    fitted = model.response(theta, model.x)[0]
    found = directions(model, theta, np.concatenate(each), fitted, model.scale, block)
    return None if found is None else found.test(wording.y.name, wording.y.unit)


def _otherwise(model: ResponseModel, theta: FloatArray) -> tuple[FloatArray, ...]:
    """Return the parameters (p,) refitted to the trials as otherwise processed, if any is."""
    if all(trial.otherwise is None for trial in model.trials):
        return ()
    trials = tuple(
        trial if trial.otherwise is None
        else replace(trial, x=trial.otherwise[0], measured=trial.otherwise[1])
        for trial in model.trials
    )  # fmt: skip
    return (fit(replace(model, trials=trials), theta).theta,)


def _agreement(
    model: ResponseModel, result: IdentificationResult, block: int
) -> ResidualTest | None:
    """Return the test whether all recordings share their parameters; None for only one."""
    trials: dict[str, list[ResponseTrial]] = {}
    for trial in model.trials:
        trials.setdefault(trial.recording, []).append(trial)
    if len(trials) < 2:
        return None
    together = replace(model, trials=tuple(trial for part in trials.values() for trial in part))
    apart = {name: replace(model, trials=tuple(part)) for name, part in trials.items()}
    theta = np.array([item.estimate for item in result.parameters])
    return agreement(
        together, apart, theta,
        lambda error: autocorrelation_time(error, together.mask, together.trial_slices, block),
    )  # fmt: skip


def _curve(
    model: ResponseModel, spread: Spread, wording: Wording, visited: tuple[float, float]
) -> Curve:
    x = np.linspace(*visited, _CURVE_POINTS)
    y, gradient = model.response(spread.theta, x)
    low, high = spread.band(lambda theta: model.response(theta, x)[0], gradient)
    return Curve(
        "friction_curve", wording.x.name, wording.x.unit, wording.y.name, wording.y.unit,
        x, y, low, high,
    )  # fmt: skip


def _trial_fits(model: ResponseModel, theta: FloatArray, wording: Wording) -> tuple[TrialFit, ...]:
    found = []
    for trial in model.trials:
        fitted = model.response(theta, trial.x)[0]
        rms, r_squared = tests.goodness(trial.measured[trial.used], fitted[trial.used])
        found.append(
            TrialFit(
                trial.label, trial.condition, wording.y.name, wording.y.unit,
                trial.t_s, trial.measured, fitted, trial.used, rms, r_squared, trial.recording,
                {wording.x.name: Signal(wording.x.unit, trial.x)},
            )
        )  # fmt: skip
    return tuple(found)
