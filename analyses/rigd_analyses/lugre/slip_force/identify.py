"""Identifies LuGre parameters with uncertainties from trials of the omni-wheel rig (method A)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from rigd.analysis.fitting import residuals as tests
from rigd.analysis.fitting.fit import Fit, Loss, fit, multi_start, named, robust_fit
from rigd.analysis.fitting.interval_width import Spread
from rigd.analysis.fitting.model import fitted_point, slopes
from rigd.analysis.fitting.uncertainty import (
    Covariance,
    autocorrelation_time,
    correlation,
    covariance,
    leave_one_trial_out,
)
from rigd.analysis.friction import SlipForce
from rigd.analysis.result import (
    FloatArray,
    IdentificationResult,
    ResidualTest,
    Signal,
    StartOutcome,
    TrialFit,
)
from rigd_analyses.lugre.curve import friction_curve, seen, visited_range
from rigd_analyses.lugre.model import LugreModel
from rigd_analyses.lugre.slip_force.agreement import agreement
from rigd_analyses.lugre.slip_force.profiles import polish, profiles, scan_all
from rigd_analyses.lugre.slip_force.verdicts import derived, estimates
from rigd_analyses.lugre.trials.slip_and_traction import (
    Guards,
    ProcessedSweep,
    ProcessedTrial,
    process,
)
from rigd_analyses.lugre.trials.trial import LugreConstants, LugreTrial

METHOD = "A: slip in, traction out"
LAGS = 150
LJUNG_BOX_LAGS = 20


@dataclass(frozen=True)
class Settings:
    """How to identify. ``block_s``: longest correlation of the residuals that is accounted for.

    ``window_steps_s``: the filter windows, as differences to the guards' one, that the method's own
    uncertainty is taken from. The confidence is 95 % throughout.
    """

    starts: int = 8
    seed: int = 1
    loss: Loss = Loss.SQUARES
    block_s: float = 0.15
    window_steps_s: tuple[float, ...] = (-0.010, 0.010)
    guards: Guards = field(default_factory=Guards)


def identify_lugre(
    trials: Sequence[LugreTrial], constants: LugreConstants, settings: Settings | None = None
) -> IdentificationResult:
    """Return the LuGre parameters that ``trials`` support, with intervals and verdicts.

    Takes about 1 s for ten trials of 2 s at 1 kHz. Raises DataError when the recordings cannot
    answer the question (wrong sign, no motion, no rest, missing samples, too few trials).
    """
    settings = Settings() if settings is None else settings
    sweep = process(trials, constants, settings.guards)
    model = LugreModel([t.samples for t in sweep.trials])
    fits = multi_start(model, starts=settings.starts, seed=settings.seed)
    best = polish(model, robust_fit(model, fits[0], settings.loss))

    block = max(1, round(settings.block_s / sweep.trials[0].samples.period_s))
    cov = covariance(model, best, block)
    error = model.residuals(best.theta)
    inflation = autocorrelation_time(error, model.mask, model.trial_slices, block)
    noise = max(t.slip_noise_m_s for t in sweep.trials)
    visited = visited_range(model, best.theta, noise)
    scans = scan_all(model, best, fits, inflation)
    spread = Spread(
        theta=best.theta,
        slopes=slopes(model.parameters, best.theta),
        coloured=cov.coloured,
        left_out=leave_one_trial_out(model, best),
        others=_other_windows(trials, constants, settings, best),
        ridge=scans.accepted,
    )
    used = int(np.count_nonzero(model.mask))
    common = agreement(_by_recording(sweep), best.theta, inflation)
    return IdentificationResult(
        model="lugre",
        method=METHOD,
        title="LuGre friction of the omni-wheel",
        parameters=estimates(model, best, cov, inflation, spread, scans, visited),
        derived=derived(model, best, spread, scans),
        confidence=0.95,
        correlation_names=tuple(p.name for p in model.parameters),
        correlation=correlation(cov.coloured),
        cost=best.cost,
        samples=used,
        effective_samples=used / inflation,
        inflation=float(np.sqrt(inflation)),
        starts=tuple(
            StartOutcome(
                named(model, f.start), named(model, f.theta), f.cost, f.iterations, f.converged
            )
            for f in fits
        ),
        curve=friction_curve(spread, visited, seen(model, best.theta, visited)),
        trials=trial_fits(sweep, model.predict(best.theta)),
        profiles=profiles(scans),
        residual_tests=(
            *_residual_tests(model, error, inflation),
            *([] if common is None else [common]),
        ),
        autocorrelation=tests.autocorrelation(
            _used(model, error), LAGS, sweep.trials[0].samples.period_s
        ),
        preprocessing=sweep.account,
        visited=f"slip from {1e3 * visited[0]:.1f} to {1e3 * visited[1]:.1f} mm/s; beyond it every "
        "statement, V_s included, is extrapolation",
        warnings=_warnings(sweep, fits, cov, common),
        point=fitted_point(
            model.parameters, best.theta, cov.coloured, spread.others, scans.accepted
        ),
    )


def _other_windows(
    trials: Sequence[LugreTrial], constants: LugreConstants, settings: Settings, best: Fit
) -> tuple[FloatArray, ...]:
    """Return the parameters refitted with each of the other filter windows."""
    thetas = []
    for step in settings.window_steps_s:
        guards = replace(settings.guards, window_s=settings.guards.window_s + step)
        sweep = process(trials, constants, guards)
        model = LugreModel([t.samples for t in sweep.trials])
        thetas.append(robust_fit(model, fit(model, best.theta), settings.loss).theta)
    return tuple(thetas)


def trial_fits(sweep: ProcessedSweep, predicted: FloatArray) -> tuple[TrialFit, ...]:
    """Return measured and fitted traction; ``predicted`` is F/F_N (n,) of all trials in turn."""
    ends = np.cumsum([len(trial.t_s) for trial in sweep.trials])[:-1]
    parts = np.split(sweep.constants.normal_force_n * predicted, ends)
    return tuple(_trial_fit(trial, part) for trial, part in zip(sweep.trials, parts, strict=True))


def _trial_fit(trial: ProcessedTrial, fitted: FloatArray) -> TrialFit:
    used = trial.samples.mask > 0.0
    rms, r_squared = tests.goodness(trial.traction_n[used], fitted[used])
    return TrialFit(
        label=trial.label,
        condition=f"{trial.current_a:.2f} A",
        recording=trial.recording,
        output="traction force",
        unit="N",
        t_s=trial.t_s,
        measured=trial.traction_n,
        fitted=fitted,
        used=used,
        rms=rms,
        r_squared=r_squared,
        signals={
            "V_r": Signal("m/s", trial.samples.slip_m_s),
            "wheel_speed": Signal("m/s", trial.wheel_speed_m_s),
            "carriage_speed": Signal("m/s", trial.carriage_speed_m_s),
        },
    )


def _used(model: LugreModel, error: FloatArray) -> list[FloatArray]:
    return [error[part][model.mask[part] > 0.0] for part in model.trial_slices]


def _residual_tests(
    model: LugreModel, error: FloatArray, inflation: float
) -> tuple[ResidualTest, ...]:
    pieces = _used(model, error)
    together = np.concatenate(pieces)
    return (
        tests.ljung_box(pieces, LJUNG_BOX_LAGS),
        tests.normality(together, 1.0 / inflation),
        tests.outliers(together),
    )


def _by_recording(sweep: ProcessedSweep) -> dict[str, list[SlipForce]]:
    found: dict[str, list[SlipForce]] = {}
    for trial in sweep.trials:
        found.setdefault(trial.recording, []).append(trial.samples)
    return found


def _warnings(
    sweep: ProcessedSweep, fits: Sequence[Fit], cov: Covariance, common: ResidualTest | None
) -> tuple[str, ...]:
    out = [] if common is None or common.passed else [common.sentence]
    out += [f"{r.label} was left out: {r.reason}" for r in sweep.account.rejected]
    same = sum(f.cost <= fits[0].cost * 1.001 for f in fits)
    if len(fits) > 1 and same == 1:
        out.append(f"only one of {len(fits)} starts reached the best cost; try more starts")
    names = ("V_s", "mu_c", "mu_s/mu_c", "sigma_0", "sigma_1", "sigma_2")
    held = [name for name, bound in zip(names, cov.on_bound, strict=True) if bound]
    if held:
        out.append(f"on the bound of the allowed range: {', '.join(held)}")
    return tuple(out)
