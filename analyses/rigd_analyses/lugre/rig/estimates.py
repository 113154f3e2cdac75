"""Makes estimates with intervals and verdicts of what output error found."""

from __future__ import annotations

import math
from dataclasses import replace

from rigd.analysis.fitting.identifiability import UNIDENTIFIABLE_LOG_SD, Z_95, Evidence, judge
from rigd.analysis.fitting.profile import ProfileScan
from rigd.analysis.result import (
    ParameterEstimate,
    Verdict,
)
from rigd_analyses.lugre.model import (
    MU_C,
    PARAMETERS,
)
from rigd_analyses.lugre.quantities import (
    BY_COVARIANCE,
    COULOMB,
    STATIC,
    STRIBECK_SPEED,
    TOTAL_DAMPING,
    Quantity,
    height,
)
from rigd_analyses.lugre.rig.standard_errors import FRICTION, HEIGHT, RigIdentification

FARTHEST = 50.0  #: of a logarithm: an end beyond it is open
BY_METHOD = (
    "These data alone close the interval; another filter of the current, single trials or what is "
    "left unexplained widen it."
)


def estimates(found: RigIdentification) -> list[ParameterEstimate]:
    """Return V_s, mu_c, mu_s, sigma_0, sigma_1, sigma_2 with intervals and verdicts."""
    speed = _profiled(found, STRIBECK_SPEED, found.scans["V_s"])
    side = _outside(found)
    if side:
        speed = _open(speed, f"It lies {side} the visited slip: extrapolation.")
        speed = replace(speed, flags=("outside the visited slip range",))
    friction_lines = [
        _profiled(found, quantity, line)
        if (line := found.scans.get(quantity.name)) is not None
        else _extrapolated(found, quantity, side)
        for quantity in (COULOMB, STATIC)
    ]
    return [speed, *friction_lines, *(_by_covariance(found, item) for item in BY_COVARIANCE)]


def derived(found: RigIdentification) -> list[ParameterEstimate]:
    """Return the height of the Stribeck effect and sigma_1 + sigma_2."""
    theta = found.theta[:FRICTION]
    rise = height(theta)
    ratio, line = found.scans["ratio"], found.scans["V_s"]
    ends: tuple[float | None, float | None] = (None, None)
    verdict = Verdict.UNIDENTIFIABLE
    if ratio.low is None:
        sentence = (
            "mu_s = mu_c fits these data as well: a Stribeck effect is not shown, and they support "
            "a model with four parameters only."
        )
    elif ratio.high is None or _outside(found) or None in (line.low, line.high):
        sentence = (
            "There is a Stribeck effect, but the data do not limit its height: it depends on V_s, "
            "which they leave open."
        )
    else:
        error = Z_95 * found.error(HEIGHT) * rise
        low = float(theta[MU_C]) * math.expm1(ratio.low)
        high = float(theta[MU_C]) * math.expm1(ratio.high)
        ends = (max(min(low, rise - error), 0.0), max(high, rise + error))
        verdict, sentence = judge(Evidence(rise, *ends, "1"))
    known = verdict in (Verdict.IDENTIFIABLE, Verdict.WEAK)
    entry = ParameterEstimate(
        HEIGHT.name, HEIGHT.symbol, HEIGHT.unit, HEIGHT.meaning, rise,
        *(ends if known else (None, None)), None, verdict, sentence, "profile",
        shares=found.shares(HEIGHT) if known else (),
    )  # fmt: skip
    return [entry, _by_covariance(found, TOTAL_DAMPING)]


def refused(found: RigIdentification) -> list[ParameterEstimate]:
    """Return the parameters without numbers: the model does not fit."""
    return [
        ParameterEstimate(
            quantity.name, quantity.symbol, quantity.unit, quantity.meaning,
            quantity.value(found.theta[:FRICTION]), None, None, None, Verdict.MISFIT,
            found.gate.sentence,
        )
        for quantity in (STRIBECK_SPEED, COULOMB, STATIC, *BY_COVARIANCE)
    ]  # fmt: skip


def _outside(found: RigIdentification) -> str:
    """Return on which side of the visited slip V_s lies, empty if within."""
    speed, (low, high) = STRIBECK_SPEED.value(found.theta[:FRICTION]), found.visited
    return "below" if speed < low else "beyond" if speed > high else ""


def _extrapolated(found: RigIdentification, quantity: Quantity, side: str) -> ParameterEstimate:
    """Return a friction that V_s leaves outside of the visited slip, without a number."""
    return ParameterEstimate(
        quantity.name, quantity.symbol, quantity.unit, quantity.meaning,
        quantity.value(found.theta[:FRICTION]), None, None, None, Verdict.UNIDENTIFIABLE,
        f"V_s lies {side} the visited slip: this friction would be extrapolation.", "profile",
    )  # fmt: skip


def _profiled(found: RigIdentification, quantity: Quantity, line: ProfileScan) -> ParameterEstimate:
    """Return an estimate whose interval is the profile's, widened by the filter's choice."""
    value = quantity.value(found.theta[:FRICTION])
    centre = math.log(value)
    # The sandwich may be wider than the curvature that the profile follows.
    error = found.error(quantity)
    low = (
        None
        if line.low is None
        else centre - max(Z_95 * error, _joined(found, quantity, centre - line.low))
    )
    high = (
        None
        if line.high is None
        else centre + max(Z_95 * error, _joined(found, quantity, line.high - centre))
    )
    box = PARAMETERS[quantity.index] if quantity.index is not None else PARAMETERS[MU_C]
    return _entry(
        found, quantity, value,
        Evidence(
            value,
            None if low is None else math.exp(low),
            None if high is None else math.exp(high),
            quantity.unit,
            allowed=(box.low, box.high),
            data_log_sd=_by_line(found, quantity, line, centre),
        ),
        error, "profile",
    )  # fmt: skip


def _by_line(
    found: RigIdentification, quantity: Quantity, line: ProfileScan, centre: float
) -> float:
    """Return the standard error of the logarithm that the profile alone stands for."""
    if line.low is None or line.high is None:
        return math.inf
    return math.hypot(max(centre - line.low, line.high - centre) / Z_95, found.weight(quantity))


def _joined(found: RigIdentification, quantity: Quantity, reach: float) -> float:
    return math.hypot(max(reach, 0.0), Z_95 * found.method(quantity), Z_95 * found.weight(quantity))


def _by_covariance(found: RigIdentification, quantity: Quantity) -> ParameterEstimate:
    value = quantity.value(found.theta[:FRICTION])
    error = found.error(quantity)
    others = Z_95 * math.hypot(found.method(quantity), found.weight(quantity))
    below, above = (math.hypot(part, others) for part in found.ridge(quantity))
    on_bound = quantity.index is not None and found.whole.on_bound[quantity.index]
    evidence = Evidence(
        value, value * math.exp(-below) if below < FARTHEST else None,
        value * math.exp(above) if above < FARTHEST else None,
        quantity.unit, value if on_bound else None,
        data_log_sd=found.by_data(quantity),
    )  # fmt: skip
    return _entry(found, quantity, value, evidence, error, "covariance")


def _entry(
    found: RigIdentification,
    quantity: Quantity,
    value: float,
    evidence: Evidence,
    error: float,
    source: str,
) -> ParameterEstimate:
    evidence = replace(evidence, owed=found.owed(quantity, evidence.log_sd))
    if evidence.data_log_sd <= UNIDENTIFIABLE_LOG_SD < evidence.log_sd:
        evidence = replace(evidence, wider=BY_METHOD)
    verdict, sentence = judge(evidence)
    known = verdict in (Verdict.IDENTIFIABLE, Verdict.WEAK)
    low, high = evidence.ends
    return ParameterEstimate(
        quantity.name, quantity.symbol, quantity.unit, quantity.meaning, value,
        low if known else None, high if known else None, error * value if known else None,
        verdict, sentence, source, shares=found.shares(quantity),
    )  # fmt: skip


def _open(entry: ParameterEstimate, why: str) -> ParameterEstimate:
    return replace(
        entry, low=None, high=None, standard_error=None, verdict=Verdict.UNIDENTIFIABLE,
        sentence=f"{entry.sentence} {why}",
    )  # fmt: skip
