"""What the data know about a parameter, in one word and one sentence, and what would help.

A parameter that only its bounds, its start or the model's form decides must not be printed as a
number among others. The verdict is made from the interval; the advice from the Fisher information
that a candidate excitation would add.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rigd.identify.model import Model, slopes
from rigd.identify.result import FloatArray, Verdict
from rigd.identify.uncertainty import scaled_pinv

Z_95 = 1.959964
UNIDENTIFIABLE_LOG_SD = 0.35  #: lugre.md section 5: a 95 % factor of two either way
WEAK_LOG_SD = 0.10
WORTHWHILE_SHRINK = 1.5  #: advice that shrinks a standard error by less is not worth a test


@dataclass(frozen=True)
class Evidence:
    """All that a verdict on one parameter rests on; ``low``/``high`` None where the end is open.

    ``bound`` is the end of the box the estimate sits on, if any. ``bias`` is a sentence on a bias
    that the method is known to have for this parameter, empty if none.
    """

    estimate: float
    low: float | None
    high: float | None
    unit: str
    bound: float | None = None
    bias: str = ""


def judge(evidence: Evidence) -> tuple[Verdict, str]:
    """Return the verdict and the reason for it.

    Not identifiable: on a bound, an open end, or a standard deviation of the logarithm above 0.35.
    """
    low, high, unit = evidence.low, evidence.high, _unit(evidence.unit)
    if low is None or high is None:
        side = {
            (True, True): "neither upwards nor downwards",
            (True, False): f"not downwards (at most {_text(high)}{unit})",
            (False, True): f"not upwards (at least {_text(low)}{unit})",
        }[(low is None, high is None)]
        return Verdict.UNIDENTIFIABLE, f"The data do not limit it: {side}."
    if evidence.bound is not None:
        return (
            Verdict.UNIDENTIFIABLE,
            f"The estimate sits on the bound {evidence.bound:.3g}{unit} of its allowed range: "
            "the bound decided, not the data.",
        )
    spread = log_sd(low, high)
    if spread > UNIDENTIFIABLE_LOG_SD:
        return (
            Verdict.UNIDENTIFIABLE,
            f"The data allow anything from {low:.3g} to {high:.3g}{unit}.",
        )
    if evidence.bias:
        return Verdict.BIASED, evidence.bias
    if spread > WEAK_LOG_SD:
        return (
            Verdict.WEAK,
            f"Known to a factor of {math.exp(Z_95 * spread):.2f}; other parameters can stand in "
            "for it.",
        )
    return Verdict.IDENTIFIABLE, f"Known to ±{100 * Z_95 * spread:.2g} % by these data."


def log_sd(low: float, high: float) -> float:
    """Return the standard deviation of the logarithm that a 95 % interval stands for."""
    if low <= 0.0 or high <= low:
        return math.inf if low <= 0.0 else 0.0
    return math.log(high / low) / (2.0 * Z_95)


@dataclass(frozen=True)
class Candidate:
    """An excitation that could be recorded: what to do, in words, and a model of its samples."""

    sentence: str
    model: Model


def predicted_sd(information: FloatArray) -> FloatArray:
    """Return the Cramer-Rao standard deviations (p,) in scaled coordinates."""
    return np.asarray(np.sqrt(np.maximum(np.diag(scaled_pinv(information)), 0.0)))


def fisher(model: Model, theta: FloatArray, residual_sd: float) -> FloatArray:
    """Return the Fisher information (p, p) in scaled coordinates at ``theta``."""
    jacobian = model.jacobian(theta) * slopes(model.parameters, theta)
    return (jacobian * model.mask[:, None]).T @ jacobian / residual_sd**2


def advise(
    index: int,
    theta: FloatArray,
    current: FloatArray,
    candidates: Sequence[Candidate],
    residual_sd: float,
) -> str:
    """Return which candidate would help parameter ``index`` most, and by how much.

    ``current`` (p, p) is the Fisher information of the data at hand (with its inflation); a
    candidate adds to it. An empty string: none shrinks the standard deviation by 1.5 or more.
    """
    now = predicted_sd(current)[index]
    best_shrink, best = 1.0, ""
    for candidate in candidates:
        added = current + fisher(candidate.model, theta, residual_sd)
        then = predicted_sd(added)[index]
        shrink = now / then if then > 0.0 else 1.0
        if shrink > best_shrink:
            best_shrink, best = shrink, candidate.sentence
    if best_shrink < WORTHWHILE_SHRINK:
        return ""
    return f"{best}: predicted to shrink its standard error {best_shrink:.1f} times."


def _unit(unit: str) -> str:
    return "" if unit == "1" else f" {unit}"


def _text(value: float | None) -> str:
    return "?" if value is None else f"{value:.3g}"
