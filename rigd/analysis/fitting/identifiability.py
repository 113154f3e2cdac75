"""Judges whether the data determine a parameter, gives the reason, and advises on further tests.

If only its bounds, its start or the form of the model decide a parameter, a report must not print
it as a number among others. The module makes the verdict from the interval, and the advice from the
Fisher information that a candidate excitation would add.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from rigd.analysis.fitting.model import Model, slopes
from rigd.analysis.fitting.uncertainty import scaled_pinv
from rigd.analysis.result import FloatArray, Verdict

Z_95 = 1.959964
UNIDENTIFIABLE_LOG_SD = 0.35  #: a 95 % factor of two either way
WEAK_LOG_SD = 0.10
WORTHWHILE_SHRINK = 1.5  #: advice that shrinks a standard error by less is not worth a test


#: What leaves an interval too wide, by the verdict.
_ALLOWS = {
    Verdict.UNIDENTIFIABLE: "data allow",
    Verdict.UNRESOLVED: "method allows",
    Verdict.CONSTANTS: "constants allow",
}


@dataclass(frozen=True)
class Evidence:
    """The basis of the verdict on one parameter; ``low``/``high`` is None if the end is open.

    ``bound`` is the end of the box the estimate sits on, if any. ``bias`` is a sentence on a bias
    that the method is known to have for this parameter, empty if none. ``allowed`` is the range
    that the parameter may have at all: an end that reaches it is open, since the data did not stop
    it. ``wider`` names what keeps an interval wide or open that a profile alone would close, and
    ``data_log_sd`` is the standard deviation of the logarithm that the data alone leave. ``owed``
    names the constant that makes the interval too wide, empty if it is not the constants.
    """

    estimate: float
    low: float | None
    high: float | None
    unit: str
    bound: float | None = None
    bias: str = ""
    allowed: tuple[float, float] = (-math.inf, math.inf)
    wider: str = ""
    data_log_sd: float = math.inf
    owed: str = ""

    @property
    def ends(self) -> tuple[float | None, float | None]:
        """Return ``low`` and ``high`` within ``allowed``, None if the data do not stop them."""
        least, most = self.allowed
        low = None if self.low is None or self.low <= least else self.low
        high = None if self.high is None or self.high >= most else self.high
        return low, high

    @property
    def log_sd(self) -> float:
        """Return the standard deviation of the logarithm; infinite if the data give none.

        That is if an end is open, and if the bound or a refit that never moves decided.
        """
        low, high = self.ends
        if low is None or high is None or self.bound is not None or high <= low:
            return math.inf
        return log_sd(low, high)

    @property
    def undetermined(self) -> Verdict:
        """What an interval that is too wide is owed to: the constants, this method, these tests."""
        if self.owed:
            return Verdict.CONSTANTS
        resolved = self.data_log_sd <= UNIDENTIFIABLE_LOG_SD and self.bound is None
        return Verdict.UNRESOLVED if resolved else Verdict.UNIDENTIFIABLE


def judge(evidence: Evidence) -> tuple[Verdict, str]:
    """Return the verdict and the reason for it.

    Not identifiable: on a bound, an open end, or a standard deviation of the logarithm above 0.35;
    by this method if the data alone would leave less, by these constants if exact ones would.
    """
    (low, high), unit = evidence.ends, _unit(evidence.unit)
    wider = "".join(f" {reason}" for reason in (evidence.wider, evidence.owed) if reason)
    if low is None or high is None:
        side = "neither upwards nor downwards"
        if high is not None:
            side = f"not downwards (at most {high:.3g}{unit})"
        elif low is not None:
            side = f"not upwards (at least {low:.3g}{unit})"
        what = "method does" if evidence.undetermined is Verdict.UNRESOLVED else "data do"
        return evidence.undetermined, f"The {what} not limit it: {side}.{wider}"
    if evidence.bound is not None:
        return (
            Verdict.UNIDENTIFIABLE,
            f"The estimate sits on the bound {evidence.bound:.3g}{unit} of its allowed range: "
            "the bound decided, not the data.",
        )
    if high <= low:
        return (
            Verdict.UNIDENTIFIABLE,
            f"Every refit ends at {low:.3g}{unit} with any data: they did not decide.",
        )
    spread = log_sd(low, high)
    if spread > UNIDENTIFIABLE_LOG_SD:
        what = _ALLOWS[evidence.undetermined]
        return (
            evidence.undetermined,
            f"The {what} anything from {low:.3g} to {high:.3g}{unit}.{wider}",
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


@dataclass(frozen=True)
class Advice:
    """The candidate that helps most, and the factor by which it reduces the standard error."""

    sentence: str
    shrink: float

    def remaining(self, log_sd: float, method_sd: float) -> float:
        """Return the standard deviation left of ``log_sd`` when the test is added.

        The part that comes from the method, ``method_sd``, stays with any recording.
        """
        if not math.isfinite(log_sd):
            return math.inf
        chance = math.sqrt(max(log_sd**2 - method_sd**2, 0.0))
        return math.hypot(chance / self.shrink, method_sd)


def predicted_sd(information: FloatArray, direction: FloatArray) -> float:
    """Return the Cramer-Rao standard deviation of ``direction @ scaled``."""
    variance = float(direction @ scaled_pinv(information) @ direction)
    return math.sqrt(max(variance, 0.0))


def fisher(model: Model, theta: FloatArray, residual_sd: float) -> FloatArray:
    """Return the Fisher information (p, p) in scaled coordinates at ``theta``."""
    jacobian = model.jacobian(theta) * slopes(model.parameters, theta)
    return (jacobian * model.mask[:, None]).T @ jacobian / residual_sd**2


def advise(
    direction: FloatArray,
    theta: FloatArray,
    current: FloatArray,
    candidates: Sequence[Candidate],
    residual_sd: float,
) -> Advice | None:
    """Return which candidate would help the combination ``direction @ scaled`` (p,) most.

    ``current`` (p, p) is the Fisher information of the data at hand (with its inflation); a
    candidate adds to it. None: none shrinks the standard deviation by 1.5 or more.
    """
    now = predicted_sd(current, direction)
    best = Advice("", 1.0)
    for candidate in candidates:
        added = current + fisher(candidate.model, theta, residual_sd)
        then = predicted_sd(added, direction)
        if then > 0.0 and now / then > best.shrink:
            best = Advice(candidate.sentence, now / then)
    return best if best.shrink >= WORTHWHILE_SHRINK else None


def _unit(unit: str) -> str:
    return "" if unit == "1" else f" {unit}"
