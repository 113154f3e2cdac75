"""Gives each LuGre parameter its estimate, its interval, its verdict and advice on further tests.

A verdict states whether the data and the method determine the parameter.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from rigd.analysis.fitting.fit import Fit
from rigd.analysis.fitting.identifiability import (
    UNIDENTIFIABLE_LOG_SD,
    WORTHWHILE_SHRINK,
    Advice,
    Evidence,
    advise,
    fisher,
    judge,
    log_sd,
)
from rigd.analysis.fitting.interval_width import Spread
from rigd.analysis.fitting.profile import ProfileScan
from rigd.analysis.fitting.uncertainty import Covariance
from rigd.analysis.result import FloatArray, ParameterEstimate, Verdict
from rigd_analyses.lugre.model import MU_C, PARAMETERS, RATIO, V_S, LugreModel
from rigd_analyses.lugre.quantities import (
    BY_COVARIANCE,
    PROFILED,
    TOTAL_DAMPING,
    Quantity,
)
from rigd_analyses.lugre.slip_force.advice import OUT_OF_REACH, SMOOTHED, candidates
from rigd_analyses.lugre.slip_force.profiles import Scans, speed_on_bound

Z_95 = 1.959964
KNOWN = (Verdict.IDENTIFIABLE, Verdict.WEAK)
FINER_COUNTS = "The method moves it, not the tests: more of them do not help. Encoders with finer \
counts do, as they allow a shorter filter window."

#: Against known truths (lugre.md section 5, and benchmarks/identify.py).
BIASES = {
    "sigma_1": "Biased by this method: the smoothing smears the jump of the slip at the current "
    "step, where sigma_1 acts; against known truths the estimate was +12 to +45 % off at any "
    "standard error. Do not use it as a measurement.",
    "sigma_1+sigma_2": "Biased by this method through sigma_1, by up to +8 % against known truths.",
}


@dataclass(frozen=True)
class _Judged:
    """An estimate, and the standard deviation of its logarithm (infinite if it is open).

    ``method_sd`` is the part of it that more data do not shrink.
    """

    entry: ParameterEstimate
    log_sd: float
    method_sd: float


def estimates(
    model: LugreModel,
    best: Fit,
    cov: Covariance,
    inflation: float,
    spread: Spread,
    scans: Scans,
    visited: tuple[float, float],
) -> tuple[ParameterEstimate, ...]:
    """Return V_s, mu_c, mu_s, sigma_0, sigma_1, sigma_2 with intervals and verdicts."""
    current = fisher(model, best.theta, cov.residual_sd) / inflation
    tests = candidates(model.trials, visited[1])
    noise = cov.residual_sd * math.sqrt(inflation)

    def advised(quantity: Quantity, judged: _Judged) -> ParameterEstimate:
        direction = spread.slopes * quantity.log_gradient(best.theta)[0]
        help_ = advise(direction, best.theta, current, tests, noise)
        return replace(judged.entry, advice=_advice(judged, help_))

    found = [advised(PROFILED[0], _speed(scans, cov, spread, visited))]
    found += [
        advised(q, _friction(q, s, scans, cov, spread, visited))
        for q, s in zip(PROFILED[1:], (scans.coulomb, scans.static), strict=True)
    ]
    found += [advised(q, _by_covariance(q, cov, spread)) for q in BY_COVARIANCE]
    return tuple(found)


def _advice(judged: _Judged, computed: Advice | None) -> str:
    """Return what would help; a computed test only if it leaves the parameter known."""
    entry = judged.entry
    if entry.verdict is Verdict.IDENTIFIABLE:
        return ""
    if entry.verdict is Verdict.UNRESOLVED:
        return FINER_COUNTS
    if entry.verdict is not Verdict.BIASED and computed is not None:
        remaining = computed.remaining(judged.log_sd, judged.method_sd)
        if remaining <= min(UNIDENTIFIABLE_LOG_SD, judged.log_sd / WORTHWHILE_SHRINK):
            shrink = judged.log_sd / remaining
            return f"{computed.sentence}: predicted to shrink its interval {shrink:.1f} times."
    return SMOOTHED if entry.verdict is Verdict.BIASED else OUT_OF_REACH.get(entry.name, "")


def derived(
    model: LugreModel, best: Fit, spread: Spread, scans: Scans
) -> tuple[ParameterEstimate, ...]:
    """Return the height of the Stribeck effect and sigma_1 + sigma_2."""
    mu_c = float(best.theta[MU_C])
    rise = mu_c * math.expm1(best.theta[RATIO])
    low, high = scans.ratio.low, scans.ratio.high
    ends: tuple[float | None, float | None] = (None, None)
    verdict = Verdict.UNIDENTIFIABLE
    if low is None:
        sentence = (
            "mu_s = mu_c fits these data as well: a Stribeck effect is not shown, and they support "
            "a model with four parameters only."
        )
    elif high is None or scans.speed.low is None or scans.speed.high is None:
        sentence = (
            "There is a Stribeck effect, but the data do not limit its height: it depends on V_s, "
            "which they leave open."
        )
    else:
        method = Z_95 * float(spread.method_sd(_height)[0])
        down = math.hypot(method, rise - mu_c * math.expm1(low))
        up = math.hypot(method, mu_c * math.expm1(high) - rise)
        ends = (max(rise - down, 0.0), rise + up)
        verdict, sentence = judge(Evidence(rise, *ends, "1"))
        ends = ends if verdict in KNOWN else (None, None)
    stribeck = ParameterEstimate(
        "mu_s-mu_c", "μ_s - μ_c", "1", "height of the Stribeck effect", rise, *ends,
        None, verdict, sentence, "profile",
        advice="" if verdict is Verdict.IDENTIFIABLE else OUT_OF_REACH["mu_s-mu_c"],
    )  # fmt: skip
    return stribeck, _by_covariance(TOTAL_DAMPING, None, spread).entry


def _speed(scans: Scans, cov: Covariance, spread: Spread, visited: tuple[float, float]) -> _Judged:
    """Return V_s; outside of the visited slip it is extrapolation with any interval."""
    quantity = PROFILED[0]
    value = quantity.value(spread.theta)
    bounds = (PARAMETERS[V_S].low, PARAMETERS[V_S].high)
    judged = _profiled(
        quantity, scans.speed, _widened(quantity, scans.speed, spread), spread, bounds,
        value if cov.on_bound[V_S] else None,
    )  # fmt: skip
    if visited[0] <= value <= visited[1]:
        return judged
    side, end = ("below", visited[0]) if value < visited[0] else ("beyond", visited[1])
    found = _extrapolated(judged, f"It lies {side} the visited slip, {end:.3g} m/s")
    return replace(found, entry=replace(found.entry, flags=("outside the visited slip range",)))


def _extrapolated(judged: _Judged, why: str) -> _Judged:
    """Return ``judged`` without a number: ``why`` it is no more than an extrapolation."""
    entry = replace(
        judged.entry, low=None, high=None, standard_error=None, verdict=Verdict.UNIDENTIFIABLE,
        sentence=f"{judged.entry.sentence} {why}: extrapolation.",
    )  # fmt: skip
    return _Judged(entry, math.inf, judged.method_sd)


def _friction(
    quantity: Quantity,
    found: ProfileScan,
    scans: Scans,
    cov: Covariance,
    spread: Spread,
    visited: tuple[float, float],
) -> _Judged:
    """Return mu_c or mu_s, each open on the side on which V_s is.

    If V_s itself lies outside of the visited slip on that side, it is extrapolation.
    With V_s free to grow, what is left of the Stribeck effect at the highest slip may be any part
    of it, so that mu_c has no lower end; with V_s free to fall, the rise towards standstill may be
    any height, so that mu_s has no upper end. The ends of their own profiles then show only where
    the box of V_s stopped them.
    """
    low, high = _widened(quantity, found, spread)
    why = ""
    if quantity.name == "mu_c":
        bounds = (PARAMETERS[MU_C].low, PARAMETERS[MU_C].high)
        if scans.speed.high is None or speed_on_bound(found, found.low, PARAMETERS[V_S].high):
            low, why = (
                None,
                "V_s is open upwards, and mu_c with it downwards, also with a closed profile.",
            )
    else:
        coulomb = _widened(PROFILED[1], scans.coulomb, spread)[0]
        most = PARAMETERS[MU_C].high * math.exp(PARAMETERS[RATIO].high)
        bounds = (PARAMETERS[MU_C].low, most)
        low = None if low is None else max(low, coulomb or bounds[0])
        if scans.speed.low is None or speed_on_bound(found, found.high, PARAMETERS[V_S].low):
            high, why = (
                None,
                "V_s is open downwards, and mu_s with it upwards, also with a closed profile.",
            )
    on_bound = cov.on_bound[MU_C] or (quantity.name == "mu_s" and cov.on_bound[RATIO])
    bound = quantity.value(spread.theta) if on_bound else None
    judged = _profiled(quantity, found, (low, high), spread, bounds, bound, why)
    speed = float(spread.theta[V_S])
    if quantity.name == "mu_c" and speed > visited[1]:
        return _extrapolated(judged, "It is g far above V_s, which lies beyond the visited slip")
    if quantity.name == "mu_s" and speed < visited[0]:
        return _extrapolated(judged, "It is g far below V_s, which lies below the visited slip")
    return judged


def _widened(
    quantity: Quantity, found: ProfileScan, spread: Spread
) -> tuple[float | None, float | None]:
    """Return the ends of a profile of a logarithm, joined with the method's own spread."""
    centre = math.log(quantity.value(spread.theta))
    method = Z_95 * float(spread.method_sd(quantity.log)[0])
    low, high = found.low, found.high
    return (
        None if low is None else math.exp(centre - math.hypot(method, max(centre - low, 0.0))),
        None if high is None else math.exp(centre + math.hypot(method, max(high - centre, 0.0))),
    )


def _profiled(
    quantity: Quantity,
    found: ProfileScan,
    ends: tuple[float | None, float | None],
    spread: Spread,
    allowed: tuple[float, float],
    bound: float | None,
    why: str = "",
) -> _Judged:
    """Return an estimate with the interval ``ends``; ``why`` they are wider than the profile."""
    value = quantity.value(spread.theta)
    wider = why or _profile_alone(found)
    alone = math.inf
    if found.low is not None and found.high is not None and not why:
        alone = log_sd(math.exp(found.low), math.exp(found.high))
    evidence = Evidence(
        value, *ends, quantity.unit, bound, allowed=allowed, wider=wider, data_log_sd=alone
    )
    verdict, sentence = judge(evidence)
    known = verdict in KNOWN
    low, high = evidence.ends
    error = spread.standard_error(quantity.log, quantity.log_gradient(spread.theta))
    entry = ParameterEstimate(
        quantity.name, quantity.symbol, quantity.unit, quantity.meaning, value,
        low if known else None, high if known else None,
        float(error[0]) * value if known else None, verdict, sentence, "profile",
    )  # fmt: skip
    return _Judged(entry, evidence.log_sd, float(spread.method_sd(quantity.log)[0]))


def _profile_alone(found: ProfileScan) -> str:
    """Return the range of the profile without the other sources, empty if it is open too."""
    low, high = (None if end is None else f"{math.exp(end):.3g}" for end in (found.low, found.high))
    if low is not None and high is not None:
        closes = f"closes, {low} to {high}"
    elif low is not None or high is not None:
        closes = f"closes below at {low}" if low is not None else f"closes above at {high}"
    else:
        return ""
    return f"(The profile alone {closes}; the choice of the filter window moves it further.)"


def _by_covariance(quantity: Quantity, cov: Covariance | None, spread: Spread) -> _Judged:
    value = quantity.value(spread.theta)
    gradient = quantity.log_gradient(spread.theta)
    low, high, error = (float(x[0]) for x in spread.interval(quantity.log, gradient))
    by_data = [float(x[0]) for x in replace(spread, others=()).interval(quantity.log, gradient)]
    ends = (math.exp(low), math.exp(high))
    bias = BIASES.get(quantity.name, "")
    index = None if quantity.index is None else PARAMETERS[quantity.index]
    on_bound = cov is not None and quantity.index is not None and cov.on_bound[quantity.index]
    allowed = (0.0, math.inf) if index is None else (index.low, index.high)
    alone = (by_data[1] - by_data[0]) / (2.0 * Z_95)
    wider = "(The choice of the filter window moves it that far.)"
    evidence = Evidence(
        value, *ends, quantity.unit, value if on_bound else None, bias, allowed,
        wider if alone <= UNIDENTIFIABLE_LOG_SD else "", alone,
    )  # fmt: skip
    verdict, sentence = judge(evidence)
    known = verdict in KNOWN
    entry = ParameterEstimate(
        quantity.name, quantity.symbol, quantity.unit, quantity.meaning, value,
        ends[0] if known else None, ends[1] if known else None,
        error * value if known else None, verdict, sentence, "covariance",
        ("biased by this method",) if bias else (),
    )  # fmt: skip
    return _Judged(entry, evidence.log_sd, float(spread.method_sd(quantity.log)[0]))


def _height(theta: FloatArray) -> FloatArray:
    return np.array([theta[MU_C] * math.expm1(theta[RATIO])])
