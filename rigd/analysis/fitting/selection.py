"""Compares models of the same data: BIC with an effective sample size, and cross-validation.

With k parameters, n samples worth m independent ones, and the sum of squares S,

    BIC = m ln(S/n) + k ln(m)

(G. Schwarz, Annals of Statistics 6, 1978). A difference below 2 is not worth more than a bare
mention, one above 10 is very strong evidence (R. E. Kass and A. E. Raftery, Journal of the American
Statistical Association 90, 1995).
The processing makes samples resemble their neighbours, so that m is far below n; with m = n
each further parameter would seem to be supported.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from rigd.analysis.fitting.fit import Fit, multi_start, named
from rigd.analysis.fitting.model import Model
from rigd.analysis.fitting.uncertainty import (
    autocorrelation_time,
    bounds_reached,
    leave_one_trial_out,
)
from rigd.analysis.result import FloatArray, ModelScore

#: A smaller difference of BIC does not separate two models.
TIE: Final = 2.0
#: A larger one is very strong evidence.
VERY_STRONG: Final = 10.0
#: Of samples: what white residuals seem to remember by chance is less.
LEAST_MEMORY: Final = 3.0
#: Standard errors by which the errors of cross-validation must differ to be distinguished.
CLEAR: Final = 2.0


@dataclass(frozen=True, eq=False)
class Contender:
    """A model with the name and title to call it by, and its characteristic for a figure."""

    name: str
    title: str
    model: Model
    curve: Callable[[FloatArray], FloatArray]


@dataclass(frozen=True, eq=False)
class _Tried:
    """A score whose ``delta_bic`` is the BIC itself, and (trials,) sums of squares left out."""

    score: ModelScore
    left_out: FloatArray


def compare(
    contenders: Sequence[Contender], *, starts: int, seed: int, window: int, max_lag: int
) -> tuple[tuple[ModelScore, ...], tuple[str, ...]]:
    """Return the scores, lowest BIC first, and what the data support, in sentences.

    All models have the same samples. ``window`` is the length of the processing in samples: so
    many samples count as one, and residuals of a model that fits remember no longer. ``max_lag``
    is the longest memory that is tested.

    Raises:
        DataError: the cost of a model is not finite at its start.
    """
    tried = [_try(item, starts, seed, window, max_lag) for item in contenders]
    tried.sort(key=lambda item: item.score.delta_bic)
    fitting = [item.score.delta_bic for item in tried if item.score.fits]
    least = min(fitting or [item.score.delta_bic for item in tried])
    tried = [
        replace(item, score=replace(item.score, delta_bic=item.score.delta_bic - least))
        for item in tried
    ]
    return tuple(item.score for item in tried), tuple(_sentences(tried))


def bic(cost: float, samples: int, effective: float, parameters: int) -> float:
    """Return the BIC of a fit with ``cost`` = S/2."""
    return effective * math.log(2.0 * cost / samples) + parameters * math.log(effective)


def left_out_squares(model: Model, fitted: Fit) -> FloatArray:
    """Return the weighted sums of squares (trials,) of each trial under the fit to all others."""
    squares = []
    for part, theta in zip(model.trial_slices, leave_one_trial_out(model, fitted), strict=True):
        squares.append(float(np.sum(model.mask[part] * model.residuals(theta)[part] ** 2)))
    return np.array(squares)


def _try(item: Contender, starts: int, seed: int, window: int, max_lag: int) -> _Tried:
    model = item.model
    best = multi_start(model, starts=starts, seed=seed)[0]
    samples = int(np.count_nonzero(model.mask))
    left_out = left_out_squares(model, best)
    memory = autocorrelation_time(
        model.residuals(best.theta), model.mask, model.trial_slices, max_lag
    )
    held = zip(model.parameters, bounds_reached(model, best.scaled), strict=True)
    score = ModelScore(
        name=item.name,
        title=item.title,
        parameters=len(model.parameters),
        delta_bic=bic(best.cost, samples, samples / window, len(model.parameters)),
        cv_error=float(np.sqrt(np.sum(left_out) / samples)),
        fits=memory <= max(window, LEAST_MEMORY),
        on_bound=tuple(parameter.name for parameter, bound in held if bound),
        estimates=named(model, best.theta),
        curve=item.curve(best.theta),
    )
    return _Tried(score, left_out)


def _sentences(tried: Sequence[_Tried]) -> list[str]:
    scores = [item.score for item in tried]
    fitting = [score for score in scores if score.fits]
    if not fitting:
        best = _named(scores[0])
        return [
            f"None of the {len(scores)} models fits: the residuals of each remember longer than "
            f"the processing explains. The least bad is {best}."
        ]
    alike = sorted((s for s in fitting if s.delta_bic < TIE), key=lambda s: s.parameters)
    out = [_supported(alike)]
    most, fewest = alike[-1].parameters, alike[0].parameters
    more = [s for s in scores if s.parameters > most and s.delta_bic >= TIE and s.fits]
    fewer = [s for s in scores if s.parameters < fewest]
    if more:
        out.append(f"More parameters are not supported: {_listed(more)}.")
    if fewer:
        out.append(f"Fewer do not suffice: {_listed(fewer[:1])}.")
    out.append(_cross_validated(tried, alike))
    return out


def _supported(alike: Sequence[ModelScore]) -> str:
    best = min(alike, key=lambda score: score.delta_bic)
    if len(alike) == 1:
        return f"The data support {best.parameters} parameters: {best.name}."
    names = " and ".join(_named(score) for score in alike)
    worst = max(score.delta_bic for score in alike)
    return f"The data do not separate {names}: ΔBIC {worst:.1f}."


def _cross_validated(tried: Sequence[_Tried], alike: Sequence[ModelScore]) -> str:
    """Return whether the error on trials that were left out agrees with the BIC."""
    least = min(tried, key=lambda item: item.score.cv_error)
    chosen = min(
        (item for item in tried if item.score in alike), key=lambda item: item.score.cv_error
    )
    gain = 100.0 * (chosen.score.cv_error / least.score.cv_error - 1.0)
    difference = chosen.left_out - least.left_out
    spread = float(np.std(difference, ddof=1)) * math.sqrt(len(difference))
    if least is chosen:
        return f"Cross-validation over trials agrees: {chosen.score.name} has the least error."
    if float(np.sum(difference)) > CLEAR * spread:
        return (
            f"Cross-validation over trials disagrees: {_named(least.score)} predicts trials that "
            f"were left out {gain:.1f} % better than {chosen.score.name}. Record more trials."
        )
    return (
        f"Cross-validation over trials agrees: {_named(least.score)} predicts trials that were "
        f"left out {gain:.1f} % better than {chosen.score.name}, which is within chance."
    )


def _named(score: ModelScore) -> str:
    return f"{score.name} ({score.parameters} parameters)"


def _listed(scores: Sequence[ModelScore]) -> str:
    return ", ".join(f"{s.name} ({s.parameters}) ΔBIC {s.delta_bic:+.1f}" for s in scores)
