"""Makes the result of a fit of a chain: contacts of each module, or why there is none."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from rigd.analysis.fitting import residuals as tests
from rigd.analysis.fitting.identifiability import Z_95, Evidence, judge
from rigd.analysis.fitting.uncertainty import correlation
from rigd.analysis.output_error.augmented_system import own_parameters
from rigd.analysis.output_error.estimator import OutputErrorFit
from rigd.analysis.output_error.homogeneity import changes
from rigd.analysis.output_error.pipeline import Identification
from rigd.analysis.result import (
    Curve,
    FitOutcome,
    FloatArray,
    IdentificationResult,
    ParameterEstimate,
    Preprocessing,
    Signal,
    Track,
    TrialFit,
    Verdict,
)
from rigd_analyses.articulated.chain.family import ChainFamily
from rigd_analyses.articulated.chain.geometry import RAW
from rigd_analyses.articulated.chain.needs import KINDS
from rigd_analyses.articulated.chain.suspects import Fitted
from rigd_analyses.articulated.chain.system import (
    UNITS,
    ChainSystem,
    Run,
    contact_name,
    unit_of,
)
from rigd_analyses.articulated.checks import silences
from rigd_analyses.articulated.result import (
    ADVICE,
    LAGS,
    LJUNG_BOX_LAGS,
    METHOD,
    POINTS,
    WORDS,
    Circle,
    camera_scales,
    fitted_values,
    radii,
    start_of,
)
from rigd_analyses.articulated.robot import CAMERA
from rigd_analyses.articulated.system import FREE

WHEEL_NAMES: Final = ("front right", "front left", "rear right", "rear left")
NO_SLIDING: Final = (
    "Trials in which a contact may slide are left out, so μ_s and μ_d get no number: the analysis "
    "`articulated` gives them, of two modules whose front one drives."
)


def result(found: Identification[ChainFamily], grip: float) -> IdentificationResult:
    """Return the result for a report; ``grip`` is the share of its load that a contact carries."""
    system, fit, gate = found.family.system, found.whole, found.gate
    theta = own_parameters(fit)
    at, shown = Fitted(system, theta), system.motors  # x of the first marker is drawn
    runs = at.runs
    white = [
        noise.whiten_errors(error)[:, shown]
        for noise, error in zip(fit.model.noise, fit.errors, strict=True)
    ]
    names = tuple(contact_name(kind, k) for kind, k in system.layout.contacts)
    by_log = np.array([gradient_of(system, name, len(fit.covariance)) for name in names])
    shares = [
        system.loads(k, at.shared, at.local(k)).max(axis=0) for k in range(len(system.trials))
    ]
    largest = float(np.max(shares))
    samples = sum(error.size for error in fit.errors)
    return IdentificationResult(
        model="articulated-chain",
        method=METHOD,
        title=f"Contacts of the articulated robot of {system.layout.modules} modules",
        parameters=tuple(_estimates(found)),
        derived=(),
        confidence=0.95,
        correlation_names=names,
        correlation=correlation(by_log @ fit.covariance @ by_log.T),
        cost=fit.fit.cost,
        samples=samples,
        effective_samples=float(samples),
        inflation=1.0,
        starts=(start_of(fit, system.names),),
        curve=_curve(found, largest),
        trials=tuple(_trial_fit(at, fit, k, runs[k]) for k in range(len(system.trials))),
        profiles=(),
        residual_tests=(
            tests.ljung_box(white, LJUNG_BOX_LAGS),
            tests.outliers(np.concatenate(white)),
            *found.tests,
        ),
        autocorrelation=tests.autocorrelation(
            white, min(LAGS, min(len(item) for item in white) - 1), system.trials[0].period_s
        ),
        preprocessing=_account(found, runs, [float(np.max(item)) for item in shares], grip),
        visited=f"contact forces up to {largest:.2f} of the load",
        warnings=(
            *(() if gate.outcome is FitOutcome.FITS else (gate.sentence, *gate.findings[1:])),
            *(() if gate.outcome is FitOutcome.MISFIT else changes(found.tests)),
            *silences(system.trials),
            *camera_scales(fit),
            NO_SLIDING,
        ),
        gate=gate,
        alarms=found.alarms,
    )


def gradient_of(system: ChainSystem, name: str, count: int) -> FloatArray:
    """Return the derivative (count,) of the logarithm of a contact parameter to the scaled ones."""
    kind, _, number = name.rpartition("_")
    gradient, contacts = np.zeros(count), list(system.layout.contacts)
    first = system.layout.of_kind(kind)[0]
    gradient[contacts.index((kind, int(number) - 1))] = 1.0
    if not system.known:
        gradient[contacts.index((kind, first))] = 1.0
    return gradient


def value_of(system: ChainSystem, fit: OutputErrorFit, name: str) -> float:
    """Return a contact parameter of one module in its unit."""
    kind, _, number = name.rpartition("_")
    raw = system.raw(fit.fit.theta[: len(system.shared)])
    return float(raw[len(RAW) * (int(number) - 1) + RAW.index(kind)])


def error_of(found: Identification[ChainFamily], gradient: FloatArray) -> float:
    """Return the standard error of a logarithm, by its ``gradient``; infinite if nothing shows."""
    fit, shared = found.whole, len(found.family.system.shared)
    moved = found.by_unexplained(gradient[:shared])
    variance = float(gradient @ fit.covariance @ gradient)
    chance = max(math.sqrt(max(variance, 0.0)), found.by_trials(gradient))
    seen = np.all(np.diag(fit.covariance)[np.flatnonzero(gradient)] > 0.0)
    return math.hypot(chance, moved) if seen and variance > 0.0 else math.inf


def _estimates(found: Identification[ChainFamily]) -> list[ParameterEstimate]:
    """Return the contacts of each module; if one is not known by itself, the mean of its kind."""
    system, fit, estimates = found.family.system, found.whole, list[ParameterEstimate]()
    for kind in KINDS:
        modules, count = system.layout.of_kind(kind), len(fit.covariance)
        names = [contact_name(kind, k) for k in modules]
        values = np.array([value_of(system, fit, name) for name in names])
        slopes = np.array([gradient_of(system, name, count) for name in names])
        symbol, meaning = WORDS[kind]
        own = []
        for name, k, value, slope in zip(names, modules, values.tolist(), slopes, strict=True):
            words = f"{meaning}; {system.layout.names[k]} module"
            labels = (name, f"{symbol} {k + 1}", UNITS[kind], words, value)
            own.append(_estimate(found, labels, slope, kind, fit.on_bound[_place(system, kind, k)]))
        estimates += own
        if len(own) > 1 and any(item.verdict is Verdict.UNIDENTIFIABLE for item in own):
            words = (
                f"{meaning}; mean of modules {', '.join(str(k + 1) for k in modules)}, because "
                "these data do not tell them apart"
            )
            labels = (kind, symbol, UNITS[kind], words, float(np.mean(values)))
            estimates.append(_estimate(found, labels, values @ slopes / values.sum(), kind, False))
    return estimates


def _place(system: ChainSystem, kind: str, module: int) -> int:
    return list(system.layout.contacts).index((kind, module))


def _estimate(
    found: Identification[ChainFamily], labels: tuple[str, str, str, str, float],
    gradient: FloatArray, kind: str, on_bound: bool,
) -> ParameterEstimate:  # fmt: skip
    gate, value, error = found.gate, labels[-1], error_of(found, gradient)
    if gate.outcome is FitOutcome.MISFIT:
        return ParameterEstimate(*labels, None, None, None, Verdict.MISFIT, gate.sentence)
    reach, (least, most, _) = math.exp(min(Z_95 * error, 50.0)), FREE[kind]
    verdict, sentence = judge(
        Evidence(
            value, value / reach, value * reach, UNITS[kind],
            bound=value if on_bound else None, allowed=(least, most),
        )
    )  # fmt: skip
    if verdict not in (Verdict.IDENTIFIABLE, Verdict.WEAK):
        return ParameterEstimate(
            *labels, None, None, None, verdict, sentence, advice=ADVICE[kind]
        )  # fmt: skip
    return ParameterEstimate(
        *labels, value / reach, value * reach, value * error, verdict, sentence,
        shares=found.whole.shares(gradient),
    )  # fmt: skip


def _curve(found: Identification[ChainFamily], share: float) -> Curve:
    """Return the longitudinal force over the slip of the first module that drives."""
    system, fit = found.family.system, found.whole
    module = system.layout.of_kind("k_lon")[0]
    name = contact_name("k_lon", module)
    value = value_of(system, fit, name)
    error = min(error_of(found, gradient_of(system, name, len(fit.covariance))), 10.0)
    points = POINTS if found.gate.outcome is not FitOutcome.MISFIT else 0
    load = float(system.wheel_loads(fit.fit.theta[: len(system.shared)])[4 * module])
    slip = np.linspace(0.0, share * load / value, points)
    reach = math.exp(Z_95 * error)
    return Curve(
        name="longitudinal_force", x_name="slip", x_unit="m/s", y_name="force", y_unit="N",
        x=slip, y=value * slip, low=value * slip / reach, high=value * slip * reach,
        note=f"Of one wheel of the {system.layout.names[module]} module. Band: 95 %.",
    )  # fmt: skip


def _trial_fit(at: Fitted, fit: OutputErrorFit, index: int, run: Run) -> TrialFit:
    system = at.system
    trial, measured, shown = system.trials[index], system.measured[index], system.motors
    fitted: FloatArray = measured + fit.errors[index]
    used, name = trial.seen[:, 0], system.layout.names[0]
    rms, r_squared = tests.goodness(measured[used, shown], fitted[used, shown])
    along, across = system.forces(index, run)
    return TrialFit(
        label=trial.label,
        condition="",
        recording=trial.recording,
        output=f"x of the {name} marker",
        unit="m",
        t_s=trial.t_s,
        measured=measured[:, shown],
        fitted=fitted[:, shown],
        used=used,
        rms=rms,
        r_squared=r_squared,
        track=Track(
            f"the {name} marker",
            np.where(trial.seen[:, :2], measured[:, shown : shown + 2], np.nan),
            fitted[:, shown : shown + 2],
        ),
        signals={
            f"force {way} of the {wheel}, {module} module": Signal("N", part[:, 4 * k + wheel_at])
            for k, module in enumerate(system.layout.names)
            for wheel_at, wheel in enumerate(WHEEL_NAMES)
            for way, part in (("along", along), ("across", across))
        },
    )


def _account(
    found: Identification[ChainFamily], runs: list[Run], shares: list[float], grip: float
) -> Preprocessing:
    system, fit = found.family.system, found.whole
    layout = system.layout
    drives = sorted({motor.module for motor in layout.motors})
    driven = ", ".join(layout.names[k] for k in drives)
    return Preprocessing(
        statements=(
            f"The robot of {layout.modules} modules, of which motors drive {driven}, is simulated "
            "from the measured speeds of its motors. Each wheel bears a quarter of its own module, "
            "and no contact slides. So k_roll of a module is as much too small as its stated mass "
            "is too large: nothing else shows the load.",
            "Contacts of modules count as alike within a factor of e; the data decide by how much "
            "they differ.",
            "Torques are means over ten frames of the camera. Frames in which a marker is taken "
            "for another, or is not seen, do not count.",
            "Scale and latency of the camera are fitted, and constants within their uncertainties. "
            "So is the inertia of the rotors in each trial, without its stated value: a torque "
            "that is sampled between the setpoints of a ramp misses a part that looks like it.",
            *fitted_values(fit, (*system.sizes, *CAMERA), unit_of),
            *_radii(system, runs, drives[0]),
        ),
        settings={"certain_grip": grip},
        per_trial={
            item.label: {
                "frames": float(len(item.poses)),
                "seen": float(np.sum(item.seen[:, 0])),
                "largest force over load": share,
            }
            for item, share in zip(system.trials, shares, strict=True)
        },
        rejected=found.family.rejected,
    )


def _radii(system: ChainSystem, runs: list[Run], module: int) -> list[str]:
    """Return the mean radii of the first module that drives, if it does so on both sides."""
    own = [
        [
            k
            for k, item in enumerate(system.layout.motors)
            if (item.module, item.side) == (module, s)
        ]
        for s in (0, 1)
    ]
    if not all(own):
        return []
    circles = []
    for item, run in zip(system.trials, runs, strict=True):
        speeds = np.column_stack([np.mean(item.speeds[:, part], axis=1) for part in own])
        circles.append(Circle(item, run.pose[:, 3 * module : 3 * module + 3], speeds))
    half_track = system.constants[system.layout.key(module, "half_track")][0]
    return radii(circles, half_track, module)
