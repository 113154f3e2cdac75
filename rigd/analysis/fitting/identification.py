"""Identifies any model: fit from several starts, intervals, verdicts, tests of the residuals.

The author of a model gives its residuals with derivatives
(:class:`rigd.analysis.fitting.model.Model`), the words for its parameters, and how its trials and
its curve are drawn. The interval of a parameter joins two contributions in quadrature, on each side
by itself:

- chance: the profile likelihood, or the jackknife over whole trials if that is wider;
- method: how far the parameter moves when the data are processed in other ways.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final, Protocol

import numpy as np

from rigd.analysis.analysis import Options
from rigd.analysis.fitting import residuals as tests
from rigd.analysis.fitting.fit import Fit, Loss, multi_start, named, robust_fit
from rigd.analysis.fitting.identifiability import (
    UNIDENTIFIABLE_LOG_SD,
    Z_95,
    Evidence,
    judge,
    log_sd,
)
from rigd.analysis.fitting.interval_width import Spread
from rigd.analysis.fitting.model import Model, scaled_bounds, slopes, to_scaled
from rigd.analysis.fitting.profile import ProfileScan, axis, natural_ends, scan
from rigd.analysis.fitting.selection import VERY_STRONG, bic
from rigd.analysis.fitting.trial_errors import lasting
from rigd.analysis.fitting.uncertainty import (
    Covariance,
    autocorrelation_time,
    correlation,
    covariance,
    leave_one_trial_out,
    no_less,
)
from rigd.analysis.result import (
    Curve,
    FitOutcome,
    FloatArray,
    Gate,
    IdentificationResult,
    ParameterEstimate,
    Preprocessing,
    Profile,
    StartOutcome,
    TrialFit,
    Verdict,
)

#: A profile reaches so many standard errors to either side, in so many steps.
_REACH: Final = 6.0
_STEPS: Final = 25
#: Relative: costs of fits that the data do not tell apart, whatever they are. At 10,000 samples
#: that are independent it is 2 in -2 ln L.
ALIKE: Final = 2e-4
APART: Final = 0.01  #: in scaled coordinates: nearer ends are one
_LAGS: Final = 50
_LJUNG_BOX_LAGS: Final = 20
_MOVED: Final = "(The choice of the processing moves it that far.)"


class ParameterWords(Protocol):
    """What a report states on a parameter; ``advice`` is the excitation that would show it."""

    @property
    def symbol(self) -> str:
        """The symbol, such as σ_0."""

    @property
    def meaning(self) -> str:
        """What it is, in a few words."""

    @property
    def advice(self) -> str:
        """Which excitation would show it; empty if none is known."""


@dataclass(frozen=True, eq=False)
class Rival:
    """Another model of the same data; ``curve`` and ``others`` as of :class:`FittedSubject`."""

    model: Model
    curve: Callable[[Spread], Curve] | None = None
    others: Callable[[Fit], Sequence[FloatArray]] = lambda _: ()


@dataclass(frozen=True, eq=False)
class FittedSubject:
    """A model with all that a report states and draws of it.

    ``curve`` returns the characteristic with its band, ``trials`` (given the natural parameters)
    measured and fitted output. ``block_s`` is the longest correlation of the residuals that is
    accounted for. ``others`` returns the natural parameters refitted to data that were processed
    in other ways; ``biases`` are sentences on parameters whose place the method is known to move.
    ``memory_s`` is how long the processing alone lets residuals remember: a model whose residuals
    remember longer does not fit. None: it is not known, and errors that last longer widen the
    intervals (:mod:`.lasting`); ``scale`` times a residual is in ``unit``. Nor does one fit that
    any of ``rivals``, models of the same data by name, beats by far (:mod:`.selection`); the band
    of the curve holds that of each rival that is not far worse.
    """

    model: Model
    name: str
    method: str
    title: str
    words: Sequence[ParameterWords]
    account: Preprocessing
    period_s: float
    visited: str
    curve: Callable[[Spread], Curve]
    trials: Callable[[FloatArray], tuple[TrialFit, ...]]
    block_s: float = 0.1
    jackknife: bool = False
    others: Callable[[Fit], Sequence[FloatArray]] = lambda _: ()
    biases: Mapping[str, str] = field(default_factory=dict)
    memory_s: float | None = None
    scale: float = 1.0
    unit: str = ""
    rivals: Mapping[str, Rival] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class _FittedRival:
    """The least squares of a rival, and by how much its BIC is lower."""

    name: str
    gain: float
    rival: Rival
    fit: Fit


def identify_model(subject: FittedSubject, options: Options) -> IdentificationResult:
    """Return the parameters of a model with 95 % intervals and verdicts.

    Raises:
        DataError: the cost is not finite.
    """
    model = subject.model
    fits = multi_start(model, starts=options.starts, seed=options.seed)
    best = robust_fit(model, fits[0], Loss.HUBER if options.robust else Loss.SQUARES)
    block = max(1, round(subject.block_s / subject.period_s))
    cov = covariance(model, best, block)
    error = model.residuals(best.theta)
    inflation = autocorrelation_time(error, model.mask, model.trial_slices, block)
    # Residuals that swing cancel in the block sums and not in the inflation.
    cov = replace(cov, coloured=no_less(cov.coloured, inflation * cov.white))
    rivals = _rivals(subject, fits[0], inflation, options)
    gate = _gate(subject, inflation, rivals)
    lasts = None
    if subject.memory_s is None:
        lasts = lasting(error, model.mask, model.trial_slices, len(model.parameters), block)
    if lasts is not None and lasts.inflation > inflation:
        cov = replace(cov, coloured=cov.coloured * lasts.spread / inflation)
        inflation, gate = lasts.inflation, lasts.gate(subject.unit, subject.scale)
    known = gate is None or gate.outcome is not FitOutcome.MISFIT
    others = subject.others(best) if known else ()
    left_out = leave_one_trial_out(model, best) if known and subject.jackknife else ()
    count = len(model.parameters) if known else 0
    alike = [
        item.theta
        for item in fits
        if item.cost <= best.cost * (1.0 + ALIKE)
        and np.max(np.abs(item.scaled - best.scaled)) > APART
    ]
    scans = [_scan(model, best, cov, inflation, index, alike) for index in range(count)]
    spread = Spread(
        best.theta, slopes(model.parameters, best.theta), cov.coloured, tuple(left_out),
        tuple(others), np.concatenate([np.zeros((0, count)), *(item.accepted for item in scans)]),
    )  # fmt: skip
    pieces = [error[part][model.mask[part] > 0.0] for part in model.trial_slices]
    together = np.concatenate(pieces)
    shortest = min(len(piece) for piece in pieces)
    used = len(together)
    curve = subject.curve(spread)
    close = [item for item in rivals if known and item.gain >= -VERY_STRONG]
    for item in close:
        curve = _holding(curve, subject, item, block)
    return IdentificationResult(
        model=subject.name,
        method=subject.method,
        title=subject.title,
        parameters=tuple(
            _estimate(subject, best, cov, spread, index, found) for index, found in enumerate(scans)
        )
        if known
        else _refused(subject, best),
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
        curve=curve if known else _nothing(curve),
        trials=subject.trials(best.theta),
        profiles=tuple(_profile(model, index, item) for index, item in enumerate(scans)),
        residual_tests=(
            tests.ljung_box(pieces, _LJUNG_BOX_LAGS),
            tests.normality(together, 1.0 / inflation),
            tests.outliers(together),
        ),
        autocorrelation=tests.autocorrelation(pieces, min(_LAGS, shortest - 1), subject.period_s),
        preprocessing=subject.account,
        visited=subject.visited,
        warnings=(*_warnings(model, fits, cov, gate), *_unseparated(subject, close)),
        gate=gate,
    )  # fmt: skip


def _gate(subject: FittedSubject, inflation: float, rivals: Sequence[_FittedRival]) -> Gate | None:
    """Return whether the residuals remember too long, or another model is far better."""
    if subject.memory_s is None:
        return None
    found_s = inflation * subject.period_s
    best = max(rivals, key=lambda item: item.gain, default=None)
    if found_s > subject.memory_s:
        finding = (
            f"its residuals remember {1e3 * found_s:.0f} ms, the processing explains "
            f"{1e3 * subject.memory_s:.0f} ms."
        )
    elif best is not None and best.gain > VERY_STRONG:
        finding = f"{best.name} fits them far better, ΔBIC {best.gain:+.1f}."
    else:
        return Gate(FitOutcome.FITS, "The residuals remember no longer than the processing.")
    return Gate(FitOutcome.MISFIT, f"The model does not fit these data: {finding}", (finding,))


def _rivals(
    subject: FittedSubject, squares: Fit, inflation: float, options: Options
) -> list[_FittedRival]:
    """Return the rivals of a model whose residuals do not remember too long.

    ``squares`` is its fit by least squares, as those of the rivals are, whatever the loss.
    """
    if subject.memory_s is None or inflation * subject.period_s > subject.memory_s:
        return []
    samples = int(np.count_nonzero(subject.model.mask))
    effective = samples * subject.period_s / subject.memory_s

    def score(cost: float, model: Model) -> float:
        return bic(cost, samples, effective, len(model.parameters))

    found = []
    for name, rival in subject.rivals.items():
        best = multi_start(rival.model, starts=options.starts, seed=options.seed)[0]
        gain = score(squares.cost, subject.model) - score(best.cost, rival.model)
        found.append(_FittedRival(name, gain, rival, best))
    return found


def _holding(curve: Curve, subject: FittedSubject, fitted: _FittedRival, block: int) -> Curve:
    """Return ``curve`` with a band that holds that of a rival which the data do not rule out."""
    rival, model, theta = fitted.rival, fitted.rival.model, fitted.fit.theta
    if rival.curve is None:
        return curve
    cov = covariance(model, fitted.fit, block)
    inflation = autocorrelation_time(model.residuals(theta), model.mask, model.trial_slices, block)
    other = rival.curve(
        Spread(
            theta, slopes(model.parameters, theta), no_less(cov.coloured, inflation * cov.white),
            leave_one_trial_out(model, fitted.fit) if subject.jackknife else (),
            tuple(rival.others(fitted.fit)),
        )
    )  # fmt: skip
    return replace(
        curve, low=np.minimum(curve.low, other.low), high=np.maximum(curve.high, other.high)
    )


def _unseparated(subject: FittedSubject, close: Sequence[_FittedRival]) -> tuple[str, ...]:
    """Return a sentence on the rivals that the data do not rule out; none without any."""
    drawn = [item for item in close if item.rival.curve is not None]
    if not drawn:
        return ()
    names = ", ".join(f"{item.name} (ΔBIC {-item.gain:+.1f})" for item in drawn)
    return (
        f"the data do not rule out {names}: the band of the curve holds it too, the intervals of "
        f"the parameters are those of {subject.name} alone",
    )


def _scan(
    model: Model, best: Fit, cov: Covariance, inflation: float, index: int,
    alike: Sequence[FloatArray],
) -> ProfileScan:  # fmt: skip
    """Return the profile of a parameter over what its standard error suggests, within its box.

    The profile reaches over the parameters (p,) of all that fit ``alike``: another one may be
    without effect in some of them, so that no refit leads from one to the other.
    """
    bounds = scaled_bounds(model.parameters)
    ends = [float(to_scaled(model.parameters, theta)[index]) for theta in alike]
    ends.append(float(best.scaled[index]))
    direction = axis(len(model.parameters), index)

    least, most = float(bounds[0][index]), float(bounds[1][index])
    variance = float(cov.coloured[index, index])
    if variance > 0.0:
        reach = _REACH * float(np.sqrt(variance))
        least, most = max(least, min(ends) - reach), min(most, max(ends) + reach)
    grid = np.linspace(least, most, _STEPS)
    return scan(model, best, direction, grid, inflation=inflation, others=alike)


def _estimate(
    subject: FittedSubject,
    best: Fit,
    cov: Covariance,
    spread: Spread,
    index: int,
    found: ProfileScan,
) -> ParameterEstimate:
    parameter, words = subject.model.parameters[index], subject.words[index]
    value = float(best.theta[index])
    alone = natural_ends(subject.model, index, found)
    low, high = _joined(subject.model, float(best.scaled[index]), found, spread, index)
    by_data = math.inf if None in alone else log_sd(*(end or 0.0 for end in alone))
    evidence = Evidence(
        value, low, high, parameter.unit,
        bound=value if cov.on_bound[index] else None,
        bias=subject.biases.get(parameter.name, ""),
        allowed=(parameter.low, parameter.high),
        wider=_MOVED if spread.others and by_data <= UNIDENTIFIABLE_LOG_SD else "",
        data_log_sd=by_data if spread.others else math.inf,
    )  # fmt: skip
    verdict, sentence = judge(evidence)
    sd = float(np.sqrt(cov.coloured[index, index])) * parameter.slope(value)
    estimate = ParameterEstimate(
        parameter.name, words.symbol, parameter.unit, words.meaning, value, *evidence.ends,
        sd if sd > 0.0 else None, verdict, sentence, source="profile",
        flags=("biased by this method",) if evidence.bias else (),
    )  # fmt: skip
    if verdict is Verdict.BIASED:
        return replace(estimate, low=None, high=None, standard_error=None)
    return estimate if estimate.identifiable else replace(estimate, advice=words.advice)


def _joined(
    model: Model, centre: float, found: ProfileScan, spread: Spread, index: int
) -> tuple[float | None, float | None]:
    """Return the ends of an interval in natural units; an end that is open stays open."""

    def scaled(theta: FloatArray) -> FloatArray:
        return to_scaled(model.parameters, theta)[index : index + 1]

    chance, method = (
        Z_95 * float(sd[0]) for sd in (spread.trials_sd(scaled), spread.method_sd(scaled))
    )
    low, high = (
        None if end is None else math.hypot(max(side * (end - centre), chance), method)
        for side, end in ((-1.0, found.low), (1.0, found.high))
    )
    parameter = model.parameters[index]
    return (
        None if low is None else parameter.natural(centre - low),
        None if high is None else parameter.natural(centre + high),
    )


def _refused(subject: FittedSubject, best: Fit) -> tuple[ParameterEstimate, ...]:
    """Return the parameters of a model that does not fit: none has a number."""
    return tuple(
        ParameterEstimate(
            parameter.name, words.symbol, parameter.unit, words.meaning, float(value),
            None, None, None, Verdict.MISFIT, "A model that does not fit gives no number.",
        )
        for parameter, words, value in zip(
            subject.model.parameters, subject.words, best.theta, strict=True
        )
    )  # fmt: skip


def _nothing(curve: Curve) -> Curve:
    """Return ``curve`` without points."""
    nothing = np.zeros(0)
    return replace(curve, x=nothing, y=nothing, low=nothing, high=nothing, seen=())


def _profile(model: Model, index: int, found: ProfileScan) -> Profile:
    parameter = model.parameters[index]
    values = np.array([parameter.natural(float(value)) for value in found.values])
    return Profile(
        parameter.name, parameter.unit, values, found.statistic, found.threshold,
        *natural_ends(model, index, found), log_axis=parameter.low > 0.0,
    )  # fmt: skip


def _warnings(
    model: Model, fits: Sequence[Fit], cov: Covariance, gate: Gate | None
) -> tuple[str, ...]:
    out = [] if gate is None or gate.outcome is FitOutcome.FITS else [gate.sentence]
    if len(fits) > 1 and sum(fit.cost <= fits[0].cost * 1.001 for fit in fits) == 1:
        out.append(f"only one of {len(fits)} starts reached the best cost; try more starts")
    pairs = zip(model.parameters, cov.on_bound, strict=True)
    if held := [parameter.name for parameter, bound in pairs if bound]:
        out.append(f"on the bound of the allowed range: {', '.join(held)}")
    return tuple(out)
