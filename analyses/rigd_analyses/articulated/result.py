"""Makes the result of a fit of the robot: parameters with intervals, or why there is none."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, TypeVar

import numpy as np

from rigd.analysis.fitting import residuals as tests
from rigd.analysis.fitting.identifiability import Z_95, Evidence, judge
from rigd.analysis.fitting.uncertainty import correlation
from rigd.analysis.output_error.augmented_system import own_parameters
from rigd.analysis.output_error.estimator import OutputErrorFit
from rigd.analysis.output_error.homogeneity import changes
from rigd.analysis.output_error.pipeline import Family, Identification
from rigd.analysis.result import (
    Curve,
    FitOutcome,
    FloatArray,
    IdentificationResult,
    ParameterEstimate,
    Preprocessing,
    Signal,
    StartOutcome,
    Track,
    TrialFit,
    Verdict,
)
from rigd_analyses.articulated.checks import silences
from rigd_analyses.articulated.family import RobotFamily
from rigd_analyses.articulated.reading import RobotTrial
from rigd_analyses.articulated.robot import CAMERA, RecordedRobot
from rigd_analyses.articulated.system import (
    CONTACTS,
    RATIO,
    SHARED,
    UNITS,
    RobotSystem,
    Run,
)
from rigd_analyses.articulated.thresholds import ROBOT

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
SLIDING: Final = "Record stepped starts (straight_speeds with start=stepped) and fast circles."
BY_LAW: Final = (
    "μ_s is that of a law with a jump. Its interval holds, too, for contacts that let go "
    "gradually, as far as these data do not rule them out."
)
NO_SLIDING: Final = (
    "Not determined by these tests: no contact slides in them; the largest force is {share:.2f} "
    "times the load."
)
#: What is said of the evaluation of every robot.
OF_ALL: Final = (
    "Torques are means over ten frames of the camera. Frames in which a marker is taken "
    "for another, or is not seen, do not count.",
    "Scale and latency of the camera are fitted, and constants within their uncertainties. "
    "So is the inertia of the rotors in each trial, without its stated value: a torque "
    "that is sampled between the setpoints of a ramp misses a part that looks like it.",
)
FITTED: Final = ("k_lon", "k_lat", "k_roll", "mu_d", "mu_s")
POINTS: Final = 25
WHEELS: Final = ("front right", "front left", "rear right", "rear left")
TRANSIENT_S: Final = 3.0  #: of a circle, before its radius is taken
TURN: Final = 6.0  #: rad: what turns more is a circle
LJUNG_BOX_LAGS, LAGS = 20, 50
F = TypeVar("F", bound=Family[Any])


def result(found: Identification[RobotFamily]) -> IdentificationResult:
    """Return the result for a report."""
    system, fit = found.family.system, found.whole
    runs = all_runs(system, fit)
    share = max(float(np.max(run.share)) for run in runs)
    return stated(
        found,
        model="articulated",
        title="Contacts of the articulated robot",
        parameters=tuple(_estimate(found, name, share) for name in FITTED),
        gradients={name: _gradient(name, len(fit.covariance)) for name in FITTED},
        curve=_curve(found, share),
        trials=tuple(_trial_fit(system, fit, k, runs[k]) for k in range(len(system.trials))),
        preprocessing=_account(found, runs),
        visited=f"contact forces up to {share:.2f} of the load, if none slid",
        notes=(BY_LAW,) if _is_given(found) else (),
    )


def stated(
    found: Identification[F], *, model: str, title: str, parameters: tuple[ParameterEstimate, ...],
    gradients: Mapping[str, FloatArray], curve: Curve, trials: tuple[TrialFit, ...],
    preprocessing: Preprocessing, visited: str, notes: tuple[str, ...],
) -> IdentificationResult:  # fmt: skip
    """Return the result of a robot, of any number of modules, with all that its fit shows.

    ``gradients`` (p,) are d(logarithm)/d(scaled) of the parameters whose correlation is stated, and
    ``notes`` the warnings of its own.
    """
    system, fit, gate = found.family.system, found.whole, found.gate
    shown = system.motors  # x of the first marker
    white = [
        noise.whiten_errors(error)[:, shown]
        for noise, error in zip(fit.model.noise, fit.errors, strict=True)
    ]
    samples = sum(error.size for error in fit.errors)
    by_log = np.array(list(gradients.values()))
    return IdentificationResult(
        model=model,
        method=METHOD,
        title=title,
        parameters=parameters,
        derived=(),
        confidence=0.95,
        correlation_names=tuple(gradients),
        correlation=correlation(by_log @ fit.covariance @ by_log.T),
        cost=fit.fit.cost,
        samples=samples,
        effective_samples=float(samples),
        inflation=1.0,
        starts=(start_of(fit, system.names),),
        curve=curve,
        trials=trials,
        profiles=(),
        residual_tests=(
            tests.ljung_box(white, LJUNG_BOX_LAGS),
            tests.outliers(np.concatenate(white)),
            *found.tests,
        ),
        autocorrelation=tests.autocorrelation(
            white, min(LAGS, min(len(item) for item in white) - 1), system.trials[0].period_s
        ),
        preprocessing=preprocessing,
        visited=visited,
        warnings=(
            *(() if gate.outcome is FitOutcome.FITS else (gate.sentence, *gate.findings[1:])),
            *(() if gate.outcome is FitOutcome.MISFIT else changes(found.tests)),
            *silences(system.trials),
            *camera_scales(fit),
            *notes,
        ),
        gate=gate,
        alarms=found.alarms,
    )


def all_runs(system: RobotSystem, fit: OutputErrorFit) -> list[Run]:
    """Return the fitted simulation of each trial."""
    theta, shared = own_parameters(fit), len(system.shared)
    local = theta[shared:].reshape(len(system.trials), -1)
    return [system.run(k, theta[:shared], local[k]) for k in range(len(system.trials))]


def camera_scales(fit: OutputErrorFit) -> list[str]:
    """Return a sentence on each axis of the camera whose scale is another."""
    found, names = [], [item.parameter.name for item in fit.model.system.shared]
    for axis in ("x", "y"):
        place = names.index(f"scale_{axis}")
        scale, sd = float(fit.fit.theta[place]), math.sqrt(float(fit.covariance[place, place]))
        if abs(scale) > ROBOT.min_camera_scale_sd * sd:
            found.append(
                f"The camera's scale along {axis} is {100 * scale:+.2f} % ± {100 * sd:.2f} % off; "
                "it is fitted, and the numbers are free of it."
            )
    return found


def _gradient(name: str, count: int) -> FloatArray:
    """Return the derivative (p,) of the logarithm of a parameter to the scaled ones."""
    gradient = np.zeros(count)
    gradient[SHARED.index("mu_d" if name == "mu_s" else name)] = 1.0
    if name == "mu_s":
        gradient[SHARED.index(RATIO)] = 1.0
    return gradient


def value_of(fit: OutputErrorFit, name: str) -> float:
    """Return a parameter of FITTED in its unit."""
    found = dict(zip(SHARED, fit.fit.theta.tolist(), strict=False))
    return float(found["mu_d"] * found[RATIO]) if name == "mu_s" else float(found[name])


def error_of(found: Identification[RobotFamily], name: str) -> float:
    """Return the standard error of the logarithm; infinite if the data hold nothing on it."""
    return error_along(found, _gradient(name, len(found.whole.covariance)))


def error_along(found: Identification[F], gradient: FloatArray) -> float:
    """Return the standard error of a logarithm, by its ``gradient``; infinite if nothing shows."""
    fit, shared = found.whole, len(found.family.system.shared)
    moved = found.by_unexplained(gradient[:shared])
    variance = float(gradient @ fit.covariance @ gradient)
    chance = max(math.sqrt(max(variance, 0.0)), found.by_trials(gradient))
    seen = np.all(np.diag(fit.covariance)[np.flatnonzero(gradient)] > 0.0)
    return math.hypot(chance, moved) if seen and variance > 0.0 else math.inf


def _estimate(found: Identification[RobotFamily], name: str, share: float) -> ParameterEstimate:
    fit, gate = found.whole, found.gate
    value, error = value_of(fit, name), error_of(found, name)
    labels = (name, WORDS[name][0], UNITS[name], WORDS[name][1], value)
    misfit = gate.outcome is FitOutcome.MISFIT
    if not misfit and not math.isfinite(error) and name.startswith("mu"):
        sentence = NO_SLIDING.format(share=share)
        return ParameterEstimate(
            *labels[:4], math.nan, None, None, None, Verdict.UNIDENTIFIABLE, sentence,
            advice=SLIDING,
        )  # fmt: skip
    place = SHARED.index(RATIO if name == "mu_s" else name)
    allowed = fit.model.parameters[SHARED.index("mu_d" if name == "mu_s" else name)]
    return estimated(
        found, labels, _gradient(name, len(fit.covariance)), (allowed.low, allowed.high),
        on_bound=bool(fit.on_bound[place]), advice=ADVICE.get(name, SLIDING),
    )  # fmt: skip


def estimated(
    found: Identification[F], labels: tuple[str, str, str, str, float], gradient: FloatArray,
    allowed: tuple[float, float], *, on_bound: bool, advice: str,
) -> ParameterEstimate:  # fmt: skip
    """Return a contact parameter with its interval, or why it has none.

    ``labels`` are name, symbol, unit, meaning and value; ``gradient`` (p,) is d(log)/d(scaled).
    """
    gate, value, unit = found.gate, labels[4], labels[2]
    if gate.outcome is FitOutcome.MISFIT:
        return ParameterEstimate(*labels, None, None, None, Verdict.MISFIT, gate.sentence)
    error = error_along(found, gradient)
    reach = math.exp(min(Z_95 * error, 50.0))
    bound = value if on_bound else None
    verdict, sentence = judge(
        Evidence(value, value / reach, value * reach, unit, bound=bound, allowed=allowed)
    )
    if verdict not in (Verdict.IDENTIFIABLE, Verdict.WEAK):
        return ParameterEstimate(*labels, None, None, None, verdict, sentence, advice=advice)
    return ParameterEstimate(
        *labels, value / reach, value * reach, value * error, verdict, sentence,
        shares=found.whole.shares(gradient),
    )  # fmt: skip


def _is_given(found: Identification[RobotFamily]) -> bool:
    """Return whether mu_s gets a number."""
    return found.gate.outcome is not FitOutcome.MISFIT and math.isfinite(error_of(found, "mu_s"))


def _load(fit: OutputErrorFit) -> float:
    """Return the load of a wheel in N."""
    found = dict(zip(SHARED, fit.fit.theta, strict=False))
    return float((found["body_mass"] + 4.0 * found["wheel_mass"]) * found["gravity"] / 4.0)


def _curve(found: Identification[RobotFamily], share: float) -> Curve:
    """Return the longitudinal force over the slip; no point if the model does not fit."""
    fit = found.whole
    value, error = value_of(fit, "k_lon"), min(error_of(found, "k_lon"), 10.0)
    static = value_of(fit, "mu_s") if math.isfinite(error_of(found, "mu_s")) else math.inf
    most = min(share, static) * _load(fit) / value
    return force_curve(found, value, error, most, ", up to the largest force before it slides")


def force_curve(
    found: Identification[F], k_lon: float, error: float, most_m_s: float, note: str
) -> Curve:
    """Return the force of a wheel over slip up to ``most_m_s``; no point if the model misfits.

    ``k_lon`` is in N s/m, and ``error`` the standard error of its logarithm.
    """
    points = POINTS if found.gate.outcome is not FitOutcome.MISFIT else 0
    slip, reach = np.linspace(0.0, most_m_s, points), math.exp(Z_95 * error)
    return Curve(
        name="longitudinal_force", x_name="slip", x_unit="m/s", y_name="force", y_unit="N",
        x=slip, y=k_lon * slip, low=k_lon * slip / reach, high=k_lon * slip * reach,
        note=f"Of one wheel{note}. Band: 95 %.",
    )  # fmt: skip


def _trial_fit(system: RobotSystem, fit: OutputErrorFit, index: int, run: Run) -> TrialFit:
    signals = {
        "right_torque": Signal("N m", system.measured[index][:, 0]),
        **{
            f"{name} of the {wheel}": Signal("N", run.forces[:, k, axis])
            for k, wheel in enumerate(WHEELS)
            for axis, name in enumerate(("force along", "force across"))
        },
        "sliding contacts": Signal("1", np.sum(run.forces[:, :, 2], axis=1)),
    }
    return drawn(system, fit, index, "front", signals)


def drawn(
    system: RecordedRobot, fit: OutputErrorFit, index: int, module: str,
    signals: Mapping[str, Signal],
) -> TrialFit:  # fmt: skip
    """Return one trial with ``signals``, drawn as the way of the marker of the first ``module``."""
    trial, measured, shown = system.trials[index], system.measured[index], system.motors
    fitted: FloatArray = measured + fit.errors[index]
    used, place = trial.seen[:, 0], slice(shown, shown + 2)
    rms, r_squared = tests.goodness(measured[used, shown], fitted[used, shown])
    return TrialFit(
        label=trial.label,
        condition="",
        recording=trial.recording,
        output=f"x of the {module} marker",
        unit="m",
        t_s=trial.t_s,
        measured=measured[:, shown],
        fitted=fitted[:, shown],
        used=used,
        rms=rms,
        r_squared=r_squared,
        track=Track(
            f"the {module} marker",
            np.where(trial.seen[:, :2], measured[:, place], np.nan),
            fitted[:, place],
        ),
        signals=signals,
    )


def start_of(fit: OutputErrorFit, names: Sequence[str]) -> StartOutcome:
    """Return where a fit of the shared parameters ``names`` began and ended."""
    unknowns = fit.model.system.shared
    return StartOutcome(
        {item.parameter.name: item.parameter.start for item in unknowns},
        dict(zip(names, fit.fit.theta.tolist(), strict=False)),
        fit.fit.cost, fit.fit.iterations, fit.fit.converged,
    )  # fmt: skip


def fitted_values(fit: OutputErrorFit, names: Sequence[str], unit_of: Callable[[str], str]) -> (
    list[str]
):  # fmt: skip
    """Return a sentence on each shared parameter of ``names``: value and standard error."""
    every = [item.parameter.name for item in fit.model.system.shared]
    errors, found = np.sqrt(np.diag(fit.covariance)), []
    for name in names:
        value, sd = float(fit.fit.theta[every.index(name)]), float(errors[every.index(name)])
        sd *= 1.0 if name in CAMERA else value
        unit = "" if unit_of(name) == "1" else f" {unit_of(name)}"
        found.append(f"{name}: {value:.6g} ± {sd:.2g}{unit} (standard error)")
    return found


def _account(found: Identification[RobotFamily], runs: Sequence[Run]) -> Preprocessing:
    system = found.family.system
    return Preprocessing(
        statements=(
            "The robot is simulated from the measured speeds of its motors. A contact slides from "
            "μ_s times its load on; the force is then μ_d times it, a third less at once.",
            *OF_ALL,
            *fitted_values(found.whole, SHARED[len(CONTACTS) :], UNITS.__getitem__),
            *_radii(system, runs),
        ),
        settings={"certain_grip": found.family.grip},
        per_trial={
            item.label: {
                "frames": float(len(item.poses)),
                "seen": float(np.sum(item.seen[:, 0])),
                "largest force over load, if none slid": float(np.max(run.share)),
                "time with a sliding contact in s": float(
                    item.period_s * np.count_nonzero(np.any(run.forces[:, :, 2] > 0.0, axis=1))
                ),
            }
            for item, run in zip(system.trials, runs, strict=True)
        },
        rejected=(),
    )  # fmt: skip


def _radii(system: RobotSystem, runs: Sequence[Run]) -> list[str]:
    """Return the mean radii of each circle, measured, simulated and kinematic, and their worth."""
    half_track = system.constants["half_track"][0]
    circles = [
        Circle(item, run.pose[:, :3], item.speeds)
        for item, run in zip(system.trials, runs, strict=True)
    ]
    return radii(circles, half_track, 0)


@dataclass(frozen=True, eq=False)
class Circle:
    """A trial, the simulated poses (n, 3) of a module, and speeds of its right and left wheels."""

    trial: RobotTrial
    pose: FloatArray
    speeds: FloatArray


def radii(circles: Sequence[Circle], half_track_m: float, module: int) -> list[str]:
    """Return the mean radii of a module in each trial that is a circle, and their worth."""
    found = []
    for circle in circles:
        item, pose, first = circle.trial, circle.pose, 3 * module
        late = (item.t_s > TRANSIENT_S) & item.seen[:, first]
        if np.ptp(pose[:, 2]) < TURN or np.count_nonzero(late) < POINTS:
            continue
        radius, sd = mean_radius(item.poses[late, first : first + 2])
        simulated, _ = mean_radius(pose[late, :2])
        found.append(
            f"{item.label}: mean radius of the {item.modules[module]} marker {radius:.4f} ± "
            f"{Z_95 * sd:.4f} m as the camera shows it (95 %), {simulated:.4f} m simulated, "
            f"{kinematic_radius(circle.speeds[item.at[late]], half_track_m):.4f} m "
            "kinematic: if no wheel slips along."
        )
    if found:
        found.append(
            "A mean radius alone is a poor target: it changes by 0.03 % for 1 % of k_lat, and by "
            "0.5 % for a camera whose one scale is 1 % off."
        )
    return found


def kinematic_radius(speeds: FloatArray, half_track_m: float) -> float:
    """Return the radius in m of the circle of a module whose wheels do not slip along.

    R = b (w_r + w_l) / (w_r - w_l), with the mean speeds of the right and the left motor of
    ``speeds`` (n, 2) in rad/s: the paper's 0.445 m for 200 and 100 rad/s (section 3).
    """
    right, left = np.mean(speeds, axis=0)
    return abs(half_track_m * float((right + left) / (right - left)))


def mean_radius(points: FloatArray) -> tuple[float, float]:
    """Return the radius in m of the circle through ``points`` (n, 2), and its standard error."""
    matrix = np.column_stack([2.0 * points, np.ones(len(points))])
    square = np.sum(points**2, axis=1)
    a, b, c = np.linalg.lstsq(matrix, square, rcond=None)[0]
    radius = math.sqrt(float(c + a * a + b * b))
    off = np.hypot(points[:, 0] - a, points[:, 1] - b) - radius
    return radius, float(np.std(off)) / math.sqrt(len(points))
