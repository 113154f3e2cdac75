"""Makes the result of a fit of the robot: parameters with intervals, or why there is none."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from rigd.analysis import residuals as tests
from rigd.analysis.identifiability import Z_95, Evidence, judge
from rigd.analysis.output_error import OutputErrorFit
from rigd.analysis.result import (
    Curve,
    FitOutcome,
    FloatArray,
    Gate,
    IdentificationResult,
    ParameterEstimate,
    Preprocessing,
    Signal,
    StartOutcome,
    TrialFit,
    TrialRejection,
    Verdict,
)
from rigd.analysis.simple_gate import judge_fit
from rigd.analysis.uncertainty import correlation
from rigd_analyses.articulated.system import CAMERA, CONTACTS, SHARED, UNITS, RobotSystem

METHOD: Final = "output error: motor speeds in; motor torques and camera poses out"
WORDS: Final = {
    "k_lon": ("k_lon", "longitudinal contact force over slip speed, of a wheel"),
    "k_lat": ("k_lat", "lateral contact force over lateral speed, of a wheel"),
    "k_roll": ("k_roll", "lever of the rolling resistance"),
    "mu_s": ("μ_s", "share of the load from which a contact slides"),
    "mu_d": ("μ_d", "share of the load that a sliding contact carries"),
}
ADVICE: Final = {
    "k_lon": "Record circles, and straight runs at several speeds.",
    "k_lat": "Record circles: straight runs hold no lateral force.",
    "k_roll": "Record straight runs at several speeds.",
}
SLIDING: Final = (
    "Not determined by these tests: only trials in which no contact slides are fitted, and in them "
    "it acts nowhere."
)
POINTS: Final = 25
LJUNG_BOX_LAGS, LAGS = 20, 50
SHOWN: Final = 2  #: output that is drawn: x of the front marker


def result(
    system: RobotSystem, fit: OutputErrorFit, grip: float, rejected: Sequence[TrialRejection]
) -> IdentificationResult:
    """Return the result for a report; ``rejected`` are the trials that were left out."""
    gate = judge_fit(fit, [item.label for item in system.trials])
    if not fit.converged:
        gate = Gate(FitOutcome.MISFIT, f"No number is given: {fit.unsettled}.", (fit.unsettled,))
    white = [
        noise.whiten_errors(error)[:, SHOWN]
        for noise, error in zip(fit.model.noise, fit.errors, strict=True)
    ]
    samples = sum(error.size for error in fit.errors)
    both = fit.covariance[: len(CONTACTS), : len(CONTACTS)]
    return IdentificationResult(
        model="articulated",
        method=METHOD,
        title="Contacts of the articulated robot",
        parameters=(
            *(_estimate(fit, gate, index) for index in range(len(CONTACTS))),
            *(_sliding(name) for name in ("mu_s", "mu_d")),
        ),
        derived=(),
        confidence=0.95,
        correlation_names=CONTACTS,
        correlation=correlation(both),
        cost=fit.fit.cost,
        samples=samples,
        effective_samples=float(samples),
        inflation=1.0,
        starts=(_start(fit),),
        curve=_curve(fit, gate, grip * _load(fit)),
        trials=tuple(_trial_fit(system, fit, k) for k in range(len(system.trials))),
        profiles=(),
        residual_tests=(
            tests.ljung_box(white, LJUNG_BOX_LAGS),
            tests.outliers(np.concatenate(white)),
        ),
        autocorrelation=tests.autocorrelation(
            white, min(LAGS, min(len(item) for item in white) - 1), system.trials[0].period_s
        ),
        preprocessing=_account(system, fit, grip, tuple(rejected)),
        visited=f"contact forces up to {grip:g} of the load",
        warnings=() if gate.outcome is FitOutcome.FITS else (gate.sentence, *gate.findings[1:]),
        gate=gate,
    )


def _error(fit: OutputErrorFit, index: int) -> float:
    """Return the standard error of the logarithm; infinite if the data hold nothing on it."""
    variance = float(fit.covariance[index, index])
    return math.sqrt(variance) if variance > 0.0 else math.inf


def _estimate(fit: OutputErrorFit, gate: Gate, index: int) -> ParameterEstimate:
    name, value, error = SHARED[index], float(fit.fit.theta[index]), _error(fit, index)
    labels = (name, WORDS[name][0], UNITS[name], WORDS[name][1], value)
    if gate.outcome is FitOutcome.MISFIT:
        return ParameterEstimate(*labels, None, None, None, Verdict.MISFIT, gate.sentence)
    reach = math.exp(min(Z_95 * error, 50.0))
    parameter = fit.model.parameters[index]
    verdict, sentence = judge(
        Evidence(
            value, value / reach, value * reach, UNITS[name],
            bound=value if fit.on_bound[index] else None, allowed=(parameter.low, parameter.high),
        )
    )  # fmt: skip
    if verdict not in (Verdict.IDENTIFIABLE, Verdict.WEAK):
        return ParameterEstimate(
            *labels, None, None, None, verdict, sentence, advice=ADVICE[name]
        )  # fmt: skip
    return ParameterEstimate(
        *labels, value / reach, value * reach, value * error, verdict, sentence
    )  # fmt: skip


def _sliding(name: str) -> ParameterEstimate:
    symbol, meaning = WORDS[name]
    return ParameterEstimate(
        name, symbol, "1", meaning, math.nan, None, None, None, Verdict.UNIDENTIFIABLE, SLIDING
    )  # fmt: skip


def _load(fit: OutputErrorFit) -> float:
    """Return the load of a wheel in N."""
    found = dict(zip(SHARED, fit.fit.theta, strict=False))
    return float((found["body_mass"] + 4.0 * found["wheel_mass"]) * found["gravity"] / 4.0)


def _curve(fit: OutputErrorFit, gate: Gate, most_n: float) -> Curve:
    """Return the longitudinal force over the slip; no point if the model does not fit."""
    value, error = float(fit.fit.theta[0]), min(_error(fit, 0), 10.0)
    points = POINTS if gate.outcome is not FitOutcome.MISFIT else 0
    slip = np.linspace(0.0, most_n / value, points)
    reach = math.exp(Z_95 * error)
    return Curve(
        name="longitudinal_force", x_name="slip", x_unit="m/s", y_name="force", y_unit="N",
        x=slip, y=value * slip, low=value * slip / reach, high=value * slip * reach,
        note="Of one wheel, as far as its contact certainly grips. Band: 95 %.",
    )  # fmt: skip


def _trial_fit(system: RobotSystem, fit: OutputErrorFit, index: int) -> TrialFit:
    trial = system.trials[index]
    measured = system.measured[index]
    fitted: FloatArray = measured + fit.errors[index]
    used = trial.seen[:, 0]
    rms, r_squared = tests.goodness(measured[used, SHOWN], fitted[used, SHOWN])
    return TrialFit(
        label=trial.label,
        condition="",
        recording=trial.recording,
        output="x of the front marker",
        unit="m",
        t_s=trial.t_s,
        measured=measured[:, SHOWN],
        fitted=fitted[:, SHOWN],
        used=used,
        rms=rms,
        r_squared=r_squared,
        signals={"right_torque": Signal("N m", measured[:, 0])},
    )


def _start(fit: OutputErrorFit) -> StartOutcome:
    unknowns = fit.model.system.shared
    return StartOutcome(
        {item.parameter.name: item.parameter.start for item in unknowns},
        dict(zip(SHARED, fit.fit.theta.tolist(), strict=False)),
        fit.fit.cost, fit.fit.iterations, fit.fit.converged,
    )  # fmt: skip


def _account(
    system: RobotSystem, fit: OutputErrorFit, grip: float, rejected: tuple[TrialRejection, ...]
) -> Preprocessing:
    errors = np.sqrt(np.diag(fit.covariance))
    fitted = []
    for index in range(len(CONTACTS), len(SHARED)):
        name, value = SHARED[index], float(fit.fit.theta[index])
        sd = float(errors[index]) * (1.0 if name in CAMERA else value)
        unit = "" if UNITS[name] == "1" else f" {UNITS[name]}"
        fitted.append(f"{name}: {value:.6g} ± {sd:.2g}{unit} (standard error)")
    return Preprocessing(
        statements=(
            "The robot is simulated from the measured speeds of its motors.",
            "Torques are means over ten frames of the camera. Frames in which a marker is taken "
            "for another, or is not seen, do not count.",
            "Scale and latency of the camera are fitted, and constants within their uncertainties. "
            "So is the inertia of the rotors, without its stated value: a torque that is sampled "
            "between the setpoints of a ramp misses a part that looks like it.",
            *fitted,
        ),
        settings={"certain_grip": grip},
        per_trial={
            item.label: {"frames": float(len(item.poses)), "seen": float(np.sum(item.seen[:, 0]))}
            for item in system.trials
        },
        rejected=rejected,
    )
