"""Converts the output of an output-error fit to a result: curve, trials, preprocessing."""

from __future__ import annotations

import math
from collections.abc import Collection

import numpy as np

from rigd.analysis.fitting import residuals as tests
from rigd.analysis.fitting.identifiability import Z_95
from rigd.analysis.fitting.model import fitted_point
from rigd.analysis.fitting.uncertainty import correlation
from rigd.analysis.output_error.augmented_system import moved_constants, own_parameters
from rigd.analysis.output_error.estimator import OutputErrorFit
from rigd.analysis.output_error.homogeneity import changes
from rigd.analysis.report.rounding import span
from rigd.analysis.result import (
    Curve,
    FitOutcome,
    FittedPoint,
    FloatArray,
    IdentificationResult,
    Preprocessing,
    Profile,
    Seen,
    Signal,
    StartOutcome,
    TrialFit,
)
from rigd_analyses.lugre.curve import POINTS
from rigd_analyses.lugre.model import (
    PARAMETERS,
    friction,
    friction_gradient,
)
from rigd_analyses.lugre.quantities import (
    BY_COVARIANCE,
    COULOMB,
    STATIC,
    STRIBECK_SPEED,
    TOTAL_DAMPING,
)
from rigd_analyses.lugre.rig import kernel
from rigd_analyses.lugre.rig.curve_points import seen
from rigd_analyses.lugre.rig.estimates import derived, estimates, refused
from rigd_analyses.lugre.rig.outputs import ACCELERATION, SLIP
from rigd_analyses.lugre.rig.parts import rows_used
from rigd_analyses.lugre.rig.sensors import fitted_rows, sensor_rows
from rigd_analyses.lugre.rig.standard_errors import (
    FRICTION,
    HEIGHT,
    WINDOW_S,
    RigIdentification,
    all_states,
    slip,
)
from rigd_analyses.lugre.rig.system import RigSystem
from rigd_analyses.lugre.trials.spikes import spiky

METHOD = "output error: current in; slip, travel and acceleration out"


def result(found: RigIdentification) -> IdentificationResult:
    """Return the result for a report."""
    family, whole, gate = found.family, found.whole, found.gate
    system = family.system
    count = FRICTION
    samples = sum(error.shape[0] for error in whole.errors)
    fits = gate.outcome is not FitOutcome.MISFIT
    parameters = estimates(found) if fits else refused(found)
    others = derived(found) if fits else []
    known = {item.name for item in (*parameters, *others) if item.quoted is not None}
    white = [
        part[:: len(system.outputs)]
        for part in (whole.model.linearise(k, found.theta)[0] for k in range(len(system.trials)))
    ]
    return IdentificationResult(
        model="lugre",
        method=METHOD,
        title="LuGre friction of the omni-wheel",
        parameters=tuple(parameters),
        derived=tuple(others),
        confidence=0.95,
        correlation_names=tuple(p.name for p in PARAMETERS),
        correlation=correlation(whole.covariance[:count, :count]),
        cost=whole.fit.cost,
        samples=samples,
        effective_samples=float(samples),
        inflation=1.0,
        starts=tuple(
            StartOutcome(
                {p.name: float(x) for p, x in zip(PARAMETERS, start, strict=False)},
                {p.name: float(x) for p, x in zip(PARAMETERS, found.theta, strict=False)},
                whole.fit.cost, whole.fit.iterations, whole.fit.converged,
            )
            for start in family.starts[:1]
        ),
        curve=_curve(found, seen(found)),
        trials=_trial_fits(system, whole),
        profiles=_profile_rows(found),
        residual_tests=(
            tests.ljung_box(white, 20), tests.outliers(np.concatenate(white)), *found.tests
        ),
        autocorrelation=tests.autocorrelation(white, family.block, system.period_s),
        preprocessing=_account(found),
        visited=f"slip from {span(*found.visited, 'm/s')}; "
        "beyond it every statement, V_s included, is extrapolation",
        warnings=(
            *([] if gate.outcome is FitOutcome.FITS else [gate.sentence, *gate.findings[1:]]),
            *(changes(found.tests) if fits else ()),
            *(f"{item.label} was left out: {item.reason}" for item in family.rejected),
            *spiky([item.trial for item in system.trials]),
        ),
        gate=gate,
        alarms=found.alarms,
        point=_point(found) if fits else None,
        budget=_budget(found, known),
    )  # fmt: skip


def _point(found: RigIdentification) -> FittedPoint:
    """Return the friction at which the fit ended, for programs that simulate it."""
    accepted = [line.accepted[:, :FRICTION] for line in found.scans.values()]
    return fitted_point(
        PARAMETERS, found.theta[:FRICTION], found.whole.covariance[:FRICTION, :FRICTION],
        [other[:FRICTION] for other in found.variants],
        np.concatenate([np.empty((0, FRICTION)), *accepted]),
    )  # fmt: skip


def _curve(found: RigIdentification, data: tuple[Seen, ...]) -> Curve:
    """Return g with its band: the region of noise and constants, and the filter's choice."""
    theta = found.theta[:FRICTION]
    points = 0 if found.gate.outcome is FitOutcome.MISFIT else POINTS
    slip = np.geomspace(max(found.visited[0], 1e-6), found.visited[1], points)

    def log_g(theta: FloatArray) -> FloatArray:
        return np.asarray(np.log(friction(theta, slip)))

    def gradient(theta: FloatArray) -> FloatArray:
        return friction_gradient(theta, slip) / friction(theta, slip)[:, None]

    centre = friction(theta, slip)
    moved = [log_g(other[:FRICTION]) - np.log(centre) for other in found.variants]
    method = np.mean(np.square(moved), axis=0) if moved else np.zeros(points)
    method += np.array([found.besides(row[None]) ** 2 for row in gradient(theta)])
    besides = Z_95 * np.sqrt(method + found.weight_u**2)
    below, above = (np.hypot(part, besides) for part in found.region(log_g, gradient))
    return Curve(
        seen=data if points else (),
        name="friction_curve", x_name="V_r", x_unit="m/s", y_name="g", y_unit="1",
        x=slip, y=centre,
        low=centre * np.exp(-below), high=centre * np.exp(above),
        note=f"Visited slip: {span(*found.visited, 'm/s')}; "
        "beyond it the curve would be extrapolation and is not drawn. Band: 95 %, pointwise.",
    )  # fmt: skip


def _trial_fits(system: RigSystem, whole: OutputErrorFit) -> tuple[TrialFit, ...]:
    fits = []
    states = all_states(system, whole)
    for driven, error, state in zip(system.trials, whole.errors, states, strict=True):
        measured, fitted = driven.measured[:, SLIP], (driven.measured + error)[:, SLIP]
        rms, r_squared = tests.goodness(measured, fitted)
        fits.append(
            TrialFit(
                label=driven.label,
                condition=f"{driven.trial.current_a:.2f} A",
                recording=driven.trial.recording,
                output="slip travel",
                unit="m",
                t_s=driven.trial.t_s[driven.part],
                measured=measured,
                fitted=fitted,
                used=np.ones(len(measured), dtype=np.bool_),
                rms=rms,
                r_squared=r_squared,
                signals={
                    "V_r": Signal("m/s", slip(system, whole, state)),
                    "carriage_speed": Signal("m/s", state[:, kernel.SPEED]),
                    "acceleration": Signal("m/s^2", driven.measured[:, ACCELERATION]),
                },
            )
        )
    return tuple(fits)


def _profile_rows(found: RigIdentification) -> tuple[Profile, ...]:
    def natural(value: float | None) -> float | None:
        return None if value is None else math.exp(value)

    rows = [
        Profile(
            quantity.name, quantity.unit, np.exp(line.values), line.statistic, line.threshold,
            natural(line.low), natural(line.high),
        )
        for quantity in (STRIBECK_SPEED, COULOMB, STATIC)
        if (line := found.scans.get(quantity.name)) is not None
    ]  # fmt: skip
    if (line := found.scans.get("ratio")) is not None:
        rows.append(
            Profile(
                "ln(mu_s/mu_c)", "1", line.values, line.statistic, line.threshold, line.low,
                line.high, log_axis=False,
            )
        )  # fmt: skip
    return tuple(rows)


def _account(found: RigIdentification) -> Preprocessing:
    system, whole, rejected = found.family.system, found.whole, found.family.rejected
    samples = sum(len(error) for error in whole.errors)
    return Preprocessing(
        statements=(
            "The rig is simulated from the measured current; nothing that moves is differentiated "
            "or smoothed. The current's own noise is filtered between its jumps.",
            f"{samples} samples of {len(system.trials)} trials count, from the current step until "
            "something else than the motor holds the carriage; left out: "
            f"{len(rejected)} trials.",
            *moved_constants(system.shared, whole),
        ),
        settings={
            "current_window_s": WINDOW_S,
            **sensor_rows(system),
            **fitted_rows(system, own_parameters(whole)),
        },
        per_trial={
            driven.label: {
                "begin_s": float(driven.trial.t_s[driven.part.start]),
                "end_s": float(driven.trial.t_s[driven.part.stop - 1]),
                "samples_used": float(len(driven.measured)),
                "slip_travel_rms_m": float(np.sqrt(np.mean(error[:, SLIP] ** 2))),
            }
            for driven, error in zip(system.trials, whole.errors, strict=True)
        },
        rejected=rejected,
        rows={item.label: rows_used(item.trial, item.part) for item in system.trials},
    )


def _budget(found: RigIdentification, known: Collection[str]) -> dict[str, dict[str, float]]:
    """Return the relative standard uncertainties of the ``known`` parameters by their sources."""
    quantities = (STRIBECK_SPEED, COULOMB, STATIC, *BY_COVARIANCE, HEIGHT, TOTAL_DAMPING)
    return {
        item.name: {source: u for source, u in found.budget(item).items() if u > 0.0}
        for item in quantities
        if item.name in known
    }
