"""Makes the result of a lateral sweep: the rollers' friction, and the speeds that follow."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rigd.analysis.fitting import residuals as tests
from rigd.analysis.fitting.identifiability import Z_95, Evidence, judge
from rigd.analysis.fitting.uncertainty import correlation
from rigd.analysis.output_error.augmented_system import moved_constants
from rigd.analysis.output_error.homogeneity import changes
from rigd.analysis.result import (
    Curve,
    FitOutcome,
    FloatArray,
    IdentificationResult,
    ParameterEstimate,
    Preprocessing,
    Signal,
    StartOutcome,
    TrialFit,
    Verdict,
)
from rigd_analyses.lugre.lateral.coupling import HEIGHT, ROW_DISTANCE, LiftedRows, loop_gain
from rigd_analyses.lugre.lateral.family import LateralIdentification
from rigd_analyses.lugre.lateral.intervals import Ends
from rigd_analyses.lugre.lateral.speeds.errors import Cell, Speeds, Together, together
from rigd_analyses.lugre.lateral.thresholds import LATERAL
from rigd_analyses.lugre.rig.standard_errors import UNEXPLAINED, WINDOW_S
from rigd_analyses.lugre.trials.spikes import spiky

METHOD = "output error: current and lateral speed in; slip, travel and acceleration out"
POINTS = 25
BEYOND = "kinks of the load, law of a lifted row"


@dataclass(frozen=True, eq=False)
class GuideFriction:
    """Friction of the guide in N over the lateral speed: the model (n,), and each trial (trials,).

    ``straight_n`` is that without lateral force. That of a trial is the model's, with the constant
    force that its speed still asks for.
    """

    speed_m_s: FloatArray
    force_n: FloatArray
    straight_n: float
    trial_m_s: FloatArray
    trial_n: FloatArray


@dataclass(frozen=True, eq=False, kw_only=True)
class LateralResult(IdentificationResult):
    """The rollers' friction, with each trial's speed error and the errors taken together.

    ``speeds`` belong to ``cells``. ``coupling`` is the coupling that the data support.
    """

    cells: tuple[Cell, ...]
    together: tuple[Together, ...]
    speeds: tuple[Speeds, ...]
    coupling: str
    guide: GuideFriction

    def shape(self) -> dict[str, object]:
        """Return the fields of the JSON object."""
        return {
            **super().shape(),
            "coupling": self.coupling,
            "speed_error": {
                "trials": self.cells,
                "together": {item.name: item for item in self.together},
            },
        }


@dataclass(frozen=True)
class _Quantity:
    """mu_R_dry, mu_R_vis, or mu_R at one speed: shares of both in its value."""

    name: str
    symbol: str
    unit: str
    meaning: str
    dry: float
    speed_m_s: float

    def value(self, theta: FloatArray, first: int) -> float:
        """Return the value; the rollers' parameters begin at ``first``."""
        return float(self.dry * theta[first] + self.speed_m_s * theta[first + 1])

    def log_gradient(self, theta: FloatArray, first: int) -> FloatArray:
        """Return d(ln value) to the scaled parameters, which are logarithms: (p,)."""
        gradient = np.zeros(len(theta))
        gradient[first] = self.dry * theta[first]
        gradient[first + 1] = self.speed_m_s * theta[first + 1]
        return gradient / self.value(theta, first)


DRY = _Quantity("mu_R_dry", "μ_R,dry", "1", "dry friction of the passive rollers", 1.0, 0.0)
VISCOUS = _Quantity("mu_R_vis", "μ_R,vis", "s/m", "viscous friction of the rollers", 0.0, 1.0)


def result(found: LateralIdentification) -> LateralResult:
    """Return the result for a report."""
    whole, gate, system = found.whole, found.gate, found.system
    fits = gate.outcome is not FitOutcome.MISFIT
    slow, fast = found.range_m_s[0], found.range_m_s[-1]
    at = [
        _Quantity(
            f"mu_R({text} m/s)", f"μ_R at {text} m/s", "1",
            "friction of the rollers at this lateral speed", 1.0, speed,
        )
        for text, speed in zip(in_words(found.range_m_s), found.range_m_s, strict=True)
    ]  # fmt: skip
    speeds, cells = found.speeds, found.cells
    first = len(system.rig.shared)
    white = [
        part[:: len(system.outputs)]
        for part in (whole.model.linearise(k, whole.fit.theta)[0] for k in range(len(cells)))
    ]
    samples = sum(len(error) for error in whole.errors)
    pair = whole.covariance[first : first + 2, first : first + 2]
    return LateralResult(
        model="lugre-lateral",
        method=METHOD,
        title="Lateral friction of omni-wheel rollers",
        parameters=(_estimate(found, DRY, ends.dry), _estimate(found, VISCOUS, ends.viscous))
        if (ends := found.ends)
        else tuple(_refused(found, item) for item in (DRY, VISCOUS)),
        derived=tuple(_estimate(found, *item) for item in zip(at, ends.at, strict=True))
        if ends
        else (),
        confidence=0.95,
        correlation_names=(DRY.name, VISCOUS.name),
        correlation=correlation(pair),
        cost=whole.fit.cost,
        samples=samples,
        effective_samples=float(samples),
        inflation=1.0,
        starts=(_start(found),),
        curve=_curve(found, slow, fast if fits else slow),
        trials=tuple(
            _trial_fit(found, k, item, speed)
            for k, (item, speed) in enumerate(zip(cells, speeds, strict=True))
        ),
        profiles=(),
        residual_tests=(
            tests.ljung_box(white, 20),
            tests.outliers(np.concatenate(white)),
            *found.tests,
        ),
        autocorrelation=tests.autocorrelation(white, found.family.block, system.rig.period_s),
        preprocessing=_account(found),
        visited=f"lateral speeds from {slow:.2f} to {fast:.2f} m/s",
        warnings=_warnings(found, cells, fast),
        gate=gate,
        alarms=found.alarms,
        cells=cells,
        together=together(cells),
        speeds=speeds,
        coupling=_coupling(found),
        guide=_guide(found, fast),
    )


def in_words(speeds_m_s: Sequence[float]) -> list[str]:
    """Return lateral speeds with two digits behind the point, or as many as tell them apart."""
    for digits in (2, 3, 4):
        texts = [f"{speed:.{digits}f}" for speed in speeds_m_s]
        if len(set(texts)) == len(texts):
            break
    return texts


def _guide(found: LateralIdentification, fast: float) -> GuideFriction:
    system, shared = found.system, found.shared
    speed = np.linspace(-fast, fast, 8 * POINTS + 1)
    at = np.array([float(np.mean(item)) for item in system.speeds])
    return GuideFriction(
        speed, system.guide_friction(shared, speed),
        float(system.guide_friction(shared, np.zeros(1))[0]), at,
        system.guide_friction(shared, at) - found.forces_n,
    )  # fmt: skip


def _reaches(
    found: LateralIdentification, quantity: _Quantity, ends: Ends
) -> tuple[float | None, float | None]:
    """Return how far the logarithm's interval reaches down and up; None if it is open.

    That is the profile under every law that the data allow: noise and constants. With it go the
    filter of the current, what is not explained, and if something was added, single trials.
    """
    first, theta = len(found.system.rig.shared), found.whole.fit.theta
    value, gradient = quantity.value(theta, first), quantity.log_gradient(theta, first)
    besides = Z_95 * math.hypot(
        _method(found, quantity), found.by_unexplained(gradient), found.by_assumptions(gradient)
    )
    trials = Z_95 * found.by_trials(gradient)

    def reach(ratio: float) -> float:
        return math.hypot(max(math.log(ratio), trials), besides)

    return (
        None if ends.low is None else reach(max(value / ends.low, 1.0)),
        None if ends.high is None else reach(max(ends.high / value, 1.0)),
    )


def _method(found: LateralIdentification, quantity: _Quantity) -> float:
    """Return the root mean square change of the logarithm with other filters of the current."""
    value = quantity.value(found.whole.fit.theta, len(found.system.rig.shared))
    return found.by_method(lambda other: math.log(quantity.value(other, 1) / value))


def _budget(
    found: LateralIdentification, quantity: _Quantity, reach: float = 0.0
) -> list[tuple[str, float]]:
    """Return the sources of the standard uncertainty of the logarithm, the largest first.

    What makes the interval reach further than they all is owed to kinks and laws.
    """
    first, theta = len(found.system.rig.shared), found.whole.fit.theta
    gradient = quantity.log_gradient(theta, first)
    shares = {name: math.sqrt(share) for name, share in found.whole.budget(gradient).items()}
    shares["filter of the current"] = _method(found, quantity)
    shares[UNEXPLAINED] = found.by_unexplained(gradient)
    shares |= {item.constant: abs(item.held) for item in found.assumed(gradient)}
    beyond = (reach / Z_95) ** 2 - sum(share**2 for share in shares.values())
    shares[BEYOND] = math.sqrt(max(beyond, 0.0))
    return sorted(shares.items(), key=lambda item: -item[1])


def _labels(found: LateralIdentification, quantity: _Quantity) -> tuple[str, str, str, str, float]:
    value = quantity.value(found.whole.fit.theta, len(found.system.rig.shared))
    return quantity.name, quantity.symbol, quantity.unit, quantity.meaning, value


def _refused(found: LateralIdentification, quantity: _Quantity) -> ParameterEstimate:
    labels = _labels(found, quantity)
    return ParameterEstimate(*labels, None, None, None, Verdict.MISFIT, found.gate.sentence)


def _estimate(found: LateralIdentification, quantity: _Quantity, ends: Ends) -> ParameterEstimate:
    labels, first = _labels(found, quantity), len(found.system.rig.shared)
    value = labels[-1]
    down, up = _reaches(found, quantity, ends)
    bounds = [k for k, on in enumerate(found.whole.on_bound[first : first + 2]) if on]
    alone = {DRY.name: [0], VISCOUS.name: [1]}.get(quantity.name)
    bound = value if alone is not None and alone[0] in bounds else None
    evidence = Evidence(
        value,
        None if down is None else value * math.exp(-down),
        None if up is None else value * math.exp(up),
        quantity.unit,
        bound,
    )
    verdict, sentence = judge(evidence)
    known = verdict in (Verdict.IDENTIFIABLE, Verdict.WEAK)
    low, high = evidence.ends
    if not known or down is None or up is None:
        return ParameterEstimate(
            *labels, None, None, None, verdict, sentence,
            advice="Record more lateral speeds, in both directions.",
        )  # fmt: skip
    source, most = _budget(found, quantity, max(down, up))[0]
    sentence += f" Most of it ({100.0 * Z_95 * most:.2g} %) comes from: {source}."
    sd = 0.5 * (down + up) / Z_95 * value
    gradient = quantity.log_gradient(found.whole.fit.theta, first)
    return ParameterEstimate(
        *labels, low, high, sd, verdict, sentence,
        shares=(*found.whole.shares(gradient), *found.assumed(gradient)),
    )  # fmt: skip


def _curve(found: LateralIdentification, low: float, high: float) -> Curve:
    """Return mu_R over the lateral speed; no point if ``low`` is ``high``.

    Between the slowest and the fastest speed the reach of the band is as at both.
    """
    at = () if found.ends is None else found.ends.at
    speed = np.linspace(low, high, POINTS if high > low and len(at) == 2 else 0)
    first, theta = len(found.system.rig.shared), found.whole.fit.theta
    each = [_Quantity("", "", "1", "", 1.0, float(x)) for x in speed]
    centre = np.array([item.value(theta, first) for item in each])
    reaches = [
        [math.inf if x is None else x for x in _reaches(found, item, ends)]
        for item, ends in zip(each[:: len(each) - 1] if each else (), at, strict=False)
    ]
    down, up = (
        np.interp(speed, [low, high], [item[side] for item in reaches]) if each else np.zeros(0)
        for side in (0, 1)
    )
    return Curve(
        name="roller_friction", x_name="v_z", x_unit="m/s", y_name="mu_R", y_unit="1",
        x=speed, y=centre, low=centre * np.exp(-down), high=centre * np.exp(up),
        note=f"Lateral speeds from {low:.2f} to {high:.2f} m/s. Band: 95 %, pointwise.",
    )  # fmt: skip


def _trial_fit(found: LateralIdentification, index: int, row: Cell, speed: Speeds) -> TrialFit:
    driven = found.system.rig.trials[index]
    rms, r_squared = tests.goodness(speed.measured, speed.included)
    return TrialFit(
        label=row.label,
        condition=f"{row.current_a:.2f} A",
        recording=driven.trial.recording,
        output="carriage speed",
        unit="m/s",
        t_s=speed.t_s,
        measured=speed.measured,
        fitted=speed.included,
        used=np.ones(len(speed.t_s), dtype=np.bool_),
        rms=rms,
        r_squared=r_squared,
        signals={
            "error_if_ignored": Signal("m/s", speed.measured - speed.ignored),
            "motor_current": Signal("A", driven.trial.motor_current_a[driven.part]),
        },
    )


def _start(found: LateralIdentification) -> StartOutcome:
    unknowns = found.system.shared
    return StartOutcome(
        {item.parameter.name: item.parameter.start for item in unknowns},
        {
            item.parameter.name: float(x)
            for item, x in zip(unknowns, found.whole.fit.theta, strict=False)
        },
        found.whole.fit.cost, found.whole.fit.iterations, found.whole.fit.converged,
    )  # fmt: skip


def _coupling(found: LateralIdentification) -> str:
    rows, gain = found.system.rows, found.family.gains[found.family.rival]
    if found.rows_known:
        return f"{rows.value}; ln L of the other way is {gain:.0f} lower"
    return (
        f"{rows.value}; the other way fits these data almost as well (ln L {gain:.1f} lower), and "
        "the intervals hold both"
    )


def _warnings(
    found: LateralIdentification, cells: tuple[Cell, ...], fast: float
) -> tuple[str, ...]:
    gate, system = found.gate, found.system
    lines = [] if gate.outcome is FitOutcome.FITS else [gate.sentence, *gate.findings[1:]]
    if found.ends is not None:
        lines += changes(found.tests)
    lines += [f"{item.label} was left out: {item.reason}" for item in found.family.rejected]
    lines += spiky([driven.trial for driven in system.rig.trials])
    signs = {math.copysign(1.0, item.lateral_speed_m_s) for item in cells
             if item.lateral_speed_m_s != 0.0}  # fmt: skip
    if len(signs) < 2:
        lines.append(
            "The bridge moves in one direction only: the friction of the guide and that of the "
            "rollers are separated by the stated guide_friction alone."
        )
    turned = max(found.family.gains[rows, not system.turned] for rows in LiftedRows)
    if not system.turned and turned < LATERAL.min_gain_ln_l:
        lines.append("These data do not show which sign the lateral speed has.")
    theta = system.coupling(found.shared)
    s = np.array([DRY.value(theta, 0) + VISCOUS.value(theta, 0) * fast])
    gain = float(loop_gain(s, theta)[0])
    if system.rows is LiftedRows.PRINTED and gain >= LATERAL.max_loop_gain:
        lines.append(
            f"The loop of Eqs. 22, 25 and 26 has the gain {gain:.2f} at {fast:.2f} m/s and locks "
            f"at 1: look at guide_height ({theta[HEIGHT]:.3g} m) and row_distance "
            f"({theta[ROW_DISTANCE]:.3g} m)."
        )
    return tuple(lines)


def _friction(found: LateralIdentification) -> str:
    """Return where the friction along the guide is from."""
    along = ", ".join(
        f"{item.parameter.name} {value:.4g}"
        for item, value in zip(found.system.shared, found.whole.fit.theta, strict=False)
        if not math.isfinite(item.u) and not item.parameter.name.startswith("mu_R")
    )
    if found.family.friction is not None:
        return found.family.friction.sentence + (f" Here: {along}." if along else "")
    return (
        "The longitudinal friction is fitted along; its own intervals and verdicts come from "
        f"drives without lateral motion. Here: {along}."
    )


def _account(found: LateralIdentification) -> Preprocessing:
    whole, system = found.whole, found.system
    rows = {
        f"u of {quantity.name} from {name}": part
        for quantity in (DRY, VISCOUS)
        for name, part in _budget(found, quantity)[:6]
        if part > 0.0
    }
    return Preprocessing(
        statements=(
            "The rig is simulated from the measured current and the measured lateral speed; "
            "nothing that moves is differentiated or smoothed.",
            f"Rollers: {_coupling(found)}.",
            _friction(found),
            *moved_constants(system.shared, whole),
        ),
        settings={"current_window_s": WINDOW_S, **rows},
        per_trial={
            trial.trial.label: {
                "lateral_speed_m_s": float(np.mean(speed)),
                "begin_s": float(driven.trial.t_s[driven.part.start]),
                "end_s": float(driven.trial.t_s[driven.part.stop - 1]),
            }
            for trial, speed, driven in zip(
                found.family.trials, system.speeds, system.rig.trials, strict=True
            )
        },
        rejected=found.family.rejected,
    )
