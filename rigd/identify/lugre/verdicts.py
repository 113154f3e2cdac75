"""Estimates of the LuGre parameters with their intervals, verdicts and advice."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from rigd.identify.fit import Fit, fit
from rigd.identify.identifiability import Evidence, advise, fisher, judge
from rigd.identify.lugre.advice import OUT_OF_REACH, candidates
from rigd.identify.lugre.model import (
    MU_C,
    PARAMETERS,
    RATIO,
    SIGMA_0,
    SIGMA_1,
    SIGMA_2,
    V_S,
    LugreModel,
)
from rigd.identify.lugre.quantities import (
    BY_COVARIANCE,
    PROFILED,
    TOTAL_DAMPING,
    Quantity,
)
from rigd.identify.lugre.spread import Spread
from rigd.identify.profile import ProfileScan, axis, scan
from rigd.identify.result import FloatArray, ParameterEstimate, Profile, Verdict
from rigd.identify.uncertainty import Covariance

Z_95 = 1.959964
GRID_POINTS = 19
POLISH_ROUNDS = 3
POLISH_GAIN = 1e-6  #: a relative gain in cost too small to move any verdict
#: Widest range a profile looks at, as factors of the estimate; an end beyond it counts as open.
FRICTION_FACTORS = (0.05, 20.0)
RATIO_GRID = np.concatenate([np.linspace(0.0, 0.5, 11), np.geomspace(0.6, 4.0, 7)])
INDEX = {"V_s": V_S, "mu_c": MU_C, "mu_s": RATIO, "sigma_0": SIGMA_0, "sigma_1": SIGMA_1}
INDEX["sigma_2"] = SIGMA_2

#: Against known truths (lugre.md section 5, and benchmarks/identify.py).
BIASES = {
    "sigma_1": "Biased by this method: the smoothing smears the jump of the slip at the current "
    "step, where sigma_1 acts; against known truths the estimate was +12 to +45 % off whatever its "
    "standard error. Do not use it as a measurement.",
    "sigma_1+sigma_2": "Biased by this method through sigma_1, by up to +8 % against known truths.",
}


@dataclass(frozen=True)
class Scans:
    """Profiles of V_s, mu_c, mu_s (logarithms) and of ln(mu_s/mu_c)."""

    speed: ProfileScan
    coulomb: ProfileScan
    static: ProfileScan
    ratio: ProfileScan


def polish(model: LugreModel, best: Fit) -> Fit:
    """Return the best fit found by walking along the V_s ridge, where plain steps crawl."""
    speed = PROFILED[0]
    direction = np.array(speed.direction, dtype=np.float64)
    for _ in range(POLISH_ROUNDS):
        found = scan(model, best, direction, _grid(speed, best.theta), inflation=1.0)
        lowest = found.thetas[int(np.argmin(found.statistic))]
        better = fit(model, lowest, weights=best.weights)
        if not better.cost < best.cost * (1.0 - POLISH_GAIN):
            break
        best = replace(better, start=best.start)
    return best


def scan_all(model: LugreModel, best: Fit, inflation: float) -> Scans:
    """Return the four profiles that decide on V_s, mu_c, mu_s and the Stribeck effect."""
    speed, coulomb, static = (
        scan(
            model, best, np.array(q.direction, dtype=np.float64), _grid(q, best.theta),
            inflation=inflation,
        )
        for q in PROFILED
    )  # fmt: skip
    ratio_grid = np.unique(np.append(RATIO_GRID, best.theta[RATIO]))
    ratio = scan(model, best, axis(6, RATIO), ratio_grid, inflation=inflation)
    return Scans(speed, coulomb, static, ratio)


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

    def helpful(name: str) -> str:
        computed = advise(INDEX[name], best.theta, current, tests, noise)
        return " ".join(text for text in (OUT_OF_REACH.get(name, ""), computed) if text)

    found = [
        _profiled(q, s, model, cov, spread, visited)
        for q, s in zip(PROFILED, (scans.speed, scans.coulomb, scans.static), strict=True)
    ]
    found += [_by_covariance(q, model, cov, spread) for q in BY_COVARIANCE]
    return tuple(
        entry if entry.verdict is Verdict.IDENTIFIABLE else _with_advice(entry, helpful(entry.name))
        for entry in found
    )


def derived(
    model: LugreModel, best: Fit, spread: Spread, scans: Scans
) -> tuple[ParameterEstimate, ...]:
    """Return the height of the Stribeck effect and sigma_1 + sigma_2."""
    mu_c = float(best.theta[MU_C])
    rise = mu_c * math.expm1(best.theta[RATIO])
    low, high = scans.ratio.low, scans.ratio.high
    if low is None or high is None:
        verdict = Verdict.UNIDENTIFIABLE
        sentence = (
            "mu_s = mu_c fits these data as well: a Stribeck effect is not shown."
            if low is None
            else f"It is above {mu_c * math.expm1(low):.2g}, but the data do not limit it upwards."
        )
        ends: tuple[float | None, float | None] = (None, None)
    else:
        method = Z_95 * float(spread.method_sd(_height)[0])
        down = math.hypot(method, rise - mu_c * math.expm1(low))
        up = math.hypot(method, mu_c * math.expm1(high) - rise)
        ends = (rise - down, rise + up)
        verdict, sentence = judge(Evidence(rise, *ends, "1"))
        ends = ends if verdict in (Verdict.IDENTIFIABLE, Verdict.WEAK) else (None, None)
    stribeck = ParameterEstimate(
        "mu_s-mu_c", "μ_s - μ_c", "1", "height of the Stribeck effect", rise, *ends,
        None, verdict, sentence, "profile",
        advice="" if verdict is Verdict.IDENTIFIABLE else OUT_OF_REACH["mu_s-mu_c"],
    )  # fmt: skip
    return stribeck, _by_covariance(TOTAL_DAMPING, model, None, spread)


def profiles(scans: Scans) -> tuple[Profile, ...]:
    """Return the profiles for a report, in units."""
    logs = zip(PROFILED, (scans.speed, scans.coulomb, scans.static), strict=True)
    out = [
        Profile(
            q.name, q.unit, np.exp(s.values), s.statistic, s.threshold,
            _exp(s.low), _exp(s.high),
        )
        for q, s in logs
    ]  # fmt: skip
    r = scans.ratio
    ratio = Profile(
        "ln(mu_s/mu_c)", "1", r.values, r.statistic, r.threshold, r.low, r.high, log_axis=False
    )
    return (*out, ratio)


def _profiled(
    quantity: Quantity,
    found: ProfileScan,
    model: LugreModel,
    cov: Covariance,
    spread: Spread,
    visited: tuple[float, float],
) -> ParameterEstimate:
    """Return an estimate whose interval is the profile's, widened by the method's own spread."""
    value = quantity.value(spread.theta)
    method = Z_95 * float(spread.method_sd(quantity.log)[0])
    low = None if found.low is None else value * math.exp(
        -math.hypot(method, max(math.log(value) - found.low, 0.0))
    )  # fmt: skip
    high = None if found.high is None else value * math.exp(
        math.hypot(method, max(found.high - math.log(value), 0.0))
    )  # fmt: skip
    bound = value if quantity.name != "mu_s" and cov.on_bound[INDEX[quantity.name]] else None
    if quantity.name != "V_s":
        low = None if _speed_on_bound(found, found.low) else low
        high = None if _speed_on_bound(found, found.high) else high
    verdict, sentence = judge(Evidence(value, low, high, quantity.unit, bound))
    flags: tuple[str, ...] = ()
    if quantity.name == "V_s" and not visited[0] <= value <= visited[1]:
        flags = ("outside the visited slip range",)
        if value > visited[1]:
            verdict = Verdict.UNIDENTIFIABLE
            sentence += f" It lies beyond the visited slip, {visited[1]:.3g} m/s: extrapolation."
    known = verdict in (Verdict.IDENTIFIABLE, Verdict.WEAK)
    error = spread.standard_error(quantity.log, quantity.log_gradient(spread.theta))
    return ParameterEstimate(
        quantity.name, quantity.symbol, quantity.unit, quantity.meaning, value,
        low if known else None, high if known else None,
        float(error[0]) * value if known else None, verdict, sentence, "profile", flags,
    )  # fmt: skip


def _by_covariance(
    quantity: Quantity, model: LugreModel, cov: Covariance | None, spread: Spread
) -> ParameterEstimate:
    value = quantity.value(spread.theta)
    low, high, error = (
        float(x[0]) for x in spread.interval(quantity.log, quantity.log_gradient(spread.theta))
    )
    ends = (math.exp(low), math.exp(high))
    bias = BIASES.get(quantity.name, "")
    bound = value if cov is not None and cov.on_bound[INDEX[quantity.name]] else None
    verdict, sentence = judge(Evidence(value, *ends, quantity.unit, bound, bias))
    known = verdict in (Verdict.IDENTIFIABLE, Verdict.WEAK)
    return ParameterEstimate(
        quantity.name, quantity.symbol, quantity.unit, quantity.meaning, value,
        ends[0] if known else None, ends[1] if known else None,
        error * value if known else None, verdict, sentence, "covariance",
        ("biased by this method",) if bias else (),
    )  # fmt: skip


def _speed_on_bound(found: ProfileScan, end: float | None) -> bool:
    """Whether an end of the interval is there only because V_s may not grow any further."""
    if end is None:
        return False
    nearest = int(np.argmin(np.abs(found.values - end)))
    return bool(found.thetas[nearest, V_S] >= PARAMETERS[V_S].high * (1.0 - 1e-6))


def _height(theta: FloatArray) -> FloatArray:
    return np.array([theta[MU_C] * math.expm1(theta[RATIO])])


def _with_advice(entry: ParameterEstimate, advice: str) -> ParameterEstimate:
    return replace(entry, advice=advice)


def _grid(quantity: Quantity, theta: FloatArray) -> FloatArray:
    """Return the logarithms to profile, the estimate among them."""
    value = quantity.value(theta)
    if quantity.name == "V_s":
        ends = np.log([1e-4, 10.0])
        points = np.linspace(ends[0], ends[1], GRID_POINTS)
    else:
        near = np.linspace(-0.3, 0.3, 13)
        far = np.log([FRICTION_FACTORS[0], 0.1, 0.2, 0.4, 0.6, 1.6, 2.5, 5.0, 10.0, 20.0])
        points = math.log(value) + np.concatenate([near, far])
    return np.unique(np.append(points, math.log(value)))


def _exp(value: float | None) -> float | None:
    return None if value is None else math.exp(value)
