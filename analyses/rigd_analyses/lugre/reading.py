"""Converts recordings of the omni-wheel rig to the arrays that its identification needs."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from rigd.analysis import ConfigError, DataError, Options
from rigd.analysis.fitting.fit import Loss
from rigd.analysis.recordings.source import RecordedSweep, TrialInfo, Unusable
from rigd.analysis.result import FloatArray, IdentificationResult, TrialRejection
from rigd_analyses.lugre.conclusion import identify_output_error
from rigd_analyses.lugre.needs import DRIVE, NEEDS
from rigd_analyses.lugre.rig.family import RigFit, fit_group
from rigd_analyses.lugre.slip_force.by_law import LUGRE, compare_by_law, identify_by_law
from rigd_analyses.lugre.slip_force.identify import Settings, identify_lugre
from rigd_analyses.lugre.slip_force_check import checked
from rigd_analyses.lugre.trials.known_constants import Known, RigConstants
from rigd_analyses.lugre.trials.resolution import Rounding, count
from rigd_analyses.lugre.trials.spikes import spiky, without_spikes
from rigd_analyses.lugre.trials.trial import LugreConstants, LugreTrial

#: What a person calls a trial, by its parameters.
Named = Callable[[RecordedSweep, TrialInfo], str]

CONSTANTS = NEEDS.constants
MASS = "mass"
#: Carriage mass in kg at which the guide's friction was measured; that of the trials by default.
FRICTION_MASS = "guide_friction_mass"
GUIDE_LIFT = "guide_lift"
#: Constants that grow with the mass; they are stated at ``FRICTION_MASS``.
WITH_MASS = ("guide_friction", "bearing_torque", GUIDE_LIFT)
OUTPUT_ERROR = "output-error"
SLIP_FORCE = "slip-force"
#: Relative u of a constant that states none.
UNSTATED_U = {
    "mass": 1e-3,
    "wheel_radius": 2e-3,
    "guide_friction": 0.1,
    "rolling_resistance": 0.1,
    "gravity": 1e-3,
    "torque_constant": 0.02,
    "gear_ratio": 0.0,
    "gear_efficiency": 0.05,
    "no_load_torque": 0.2,
    "no_load_viscous": 0.3,
    "motor_inertia": 0.1,
    "wheel_inertia": 0.05,
    "bearing_torque": 0.3,
}


def identify(
    trials: Sequence[tuple[RecordedSweep, TrialInfo]], options: Options
) -> IdentificationResult:
    """Return the LuGre parameters of trials recorded under the same conditions.

    By output error, if no method is given and the plan has the constants of the drive.

    Raises:
        ConfigError: the method does not take an option that is given.
        DataError: a signal or constant is missing, constants differ between recordings, or the
            data cannot answer the question.
    """
    loss = Loss.HUBER if options.robust else Loss.SQUARES
    settings = Settings(starts=options.starts, seed=options.seed, loss=loss)
    _check(options)
    usable, unusable = sort_out(trials)
    found, constants = arrays(usable)
    if options.law not in ("", LUGRE):
        result = identify_by_law(found, constants, settings, options)
    elif _simulated(options, usable):
        rig = rig_constants(usable, constants)
        result = identify_output_error(found, constants, rig, settings)
    else:
        result = _by_slip_force(usable, found, constants, settings)
    if options.compare:
        comparison, broken = compare_by_law(found, constants, settings, options)
        left = (f"not compared: {why}" for why in broken)
        result = replace(result, comparison=comparison, warnings=(*result.warnings, *left))
    account = result.preprocessing
    whole = replace(account, rejected=(*unusable, *account.rejected))
    warnings = dict.fromkeys((*result.warnings, *spiky(found)))
    return replace(result, preprocessing=whole, warnings=tuple(warnings))


def _by_slip_force(
    usable: Sequence[tuple[RecordedSweep, TrialInfo]],
    found: Sequence[LugreTrial],
    constants: LugreConstants,
    settings: Settings,
) -> IdentificationResult:
    """Return the result of method A, held to the simulated rig as far as the plan allows.

    Raises:
        DataError: the data cannot answer the question, or the rig cannot be simulated.
    """
    result = identify_lugre(found, constants, settings)
    missing = _missing(usable)
    if settings.loss is not Loss.SQUARES:
        why = "output error, which would do so, has no robust loss"
    elif missing:
        why = f"that takes constants of the drive: {', '.join(missing)}"
    else:
        rig = rig_constants(usable, constants)
        return checked(result, fit_group(found, constants, rig, settings))
    warning = f"Not tested is whether the model fits the motion of the rig: {why}."
    return replace(result, warnings=(warning, *result.warnings))


def _simulated(options: Options, trials: Sequence[tuple[RecordedSweep, TrialInfo]]) -> bool:
    """Whether output error evaluates ``trials``: it is asked for, or nothing is against it."""
    if options.method:
        return options.method != SLIP_FORCE
    return not options.robust and not _missing(trials)


def _missing(trials: Sequence[tuple[RecordedSweep, TrialInfo]]) -> list[str]:
    """Return the constants of the drive that the plan does not give."""
    return [name for name in DRIVE if name not in trials[0][0].plan.constants]


def first_fit(
    trials: Sequence[tuple[RecordedSweep, TrialInfo]], options: Options
) -> tuple[RigFit, list[TrialRejection]]:
    """Return the fit of one group for a joint fit, and its trials that cannot be used.

    The masses of the trials may differ.

    Raises:
        ConfigError, DataError: as :func:`identify`.
    """
    usable, unusable = sort_out(trials)
    found, constants = loaded(usable)
    rig = rig_constants(usable, constants)
    return fit_group(found, constants, rig, Settings(options.starts, options.seed)), unusable


def _check(options: Options) -> None:
    """Refuse options that no method takes together.

    Raises:
        ConfigError: two of them, or one and the method, do not go together.
    """
    if options.method != OUTPUT_ERROR:
        return
    if options.law not in ("", LUGRE):
        raise ConfigError(
            f"--law {options.law}: output error simulates the rig with the law {LUGRE} only",
            hint="leave out --method output-error",
        )
    if options.robust:
        raise ConfigError(
            "--robust: output error has no robust loss",
            hint="leave it out, or --method output-error",
        )


def by_current(sweep: RecordedSweep, trial: TrialInfo) -> str:
    """Return what a person calls ``trial``."""
    return sweep.parameter(trial, "current")


def sort_out(
    trials: Sequence[tuple[RecordedSweep, TrialInfo]], named: Named = by_current
) -> tuple[list[tuple[RecordedSweep, TrialInfo]], list[TrialRejection]]:
    """Return the trials whose samples are there, and the others with what they lack.

    Raises:
        DataError: a signal is missing, or no trial is usable: with what the first one lacks.
    """
    usable: list[tuple[RecordedSweep, TrialInfo]] = []
    rejected: list[TrialRejection] = []
    lacking: list[Unusable] = []
    for (sweep, trial), label in zip(trials, _labels(trials, named), strict=True):
        try:
            sweep.signals(trial)
        except Unusable as error:
            lacking.append(error)
            rejected.append(TrialRejection(label, error.message))
        else:
            usable.append((sweep, trial))
    if not usable and lacking:
        raise lacking[0]
    return usable, rejected


def arrays(
    trials: Sequence[tuple[RecordedSweep, TrialInfo]], named: Named = by_current
) -> tuple[list[LugreTrial], LugreConstants]:
    """Return what the identification takes, one object per trial and what they have in common.

    The label of each is ``named`` and what it takes to be the only one.

    Raises:
        DataError: a signal or constant is missing, or a constant differs between trials.
    """
    return _trials(trials, named), _constants(trials)


def loaded(
    trials: Sequence[tuple[RecordedSweep, TrialInfo]],
) -> tuple[list[LugreTrial], LugreConstants]:
    """Return as :func:`arrays` does trials whose masses may differ; constants at the first mass.

    Raises:
        DataError: as :func:`arrays`, or the mass at which the guide rubs as stated is not known.
    """
    first = trials[0][0].constant(trials[0][1], MASS)
    shares = [sweep.constant(trial, MASS) / first for sweep, trial in trials]
    if len(set(shares)) > 1 and not _gives(trials, FRICTION_MASS):
        raise DataError(
            f"the trials have several masses, and {FRICTION_MASS} is not known",
            hint=f"give the mass at which guide_friction was measured: `--set {FRICTION_MASS}=...`",
        )

    def named(sweep: RecordedSweep, trial: TrialInfo) -> str:
        mass = "" if len(set(shares)) == 1 else f", {sweep.constant(trial, MASS):g} kg"
        return by_current(sweep, trial) + mass

    found = [
        replace(trial, load=share)
        for trial, share in zip(_trials(trials, named), shares, strict=True)
    ]
    return found, _constants(trials, differing=(MASS,))


def _labels(trials: Sequence[tuple[RecordedSweep, TrialInfo]], named: Named) -> list[str]:
    """Return a label of each trial: ``named``, its repeat, its file if there are several.

    If that is not enough to tell them apart, its number besides.
    """
    several = len({sweep.path for sweep, _ in trials}) > 1
    found = []
    for sweep, trial in trials:
        repeat = "" if (trial.repeat or 1) == 1 else f", repeat {trial.repeat}"
        file = f" of {sweep.path}" if several else ""
        found.append(f"{named(sweep, trial)}{repeat}{file}")
    return [
        label if found.count(label) == 1 else f"{label}, trial {trial.number}"
        for label, (_, trial) in zip(found, trials, strict=True)
    ]


def _trials(trials: Sequence[tuple[RecordedSweep, TrialInfo]], named: Named) -> list[LugreTrial]:
    return [
        _trial(sweep, trial, label)
        for (sweep, trial), label in zip(trials, _labels(trials, named), strict=True)
    ]


def _trial(sweep: RecordedSweep, trial: TrialInfo, label: str) -> LugreTrial:
    t_s, signals, faster = sweep.signals_and_faster(trial)
    current = trial.parameters.get("current")
    if not isinstance(current, int | float):
        raise DataError(
            f"{sweep.path}: trial {trial.number} has no parameter 'current'",
            hint="method A needs tests with one constant current each",
        )
    read = LugreTrial(
        label=label,
        recording=str(sweep.path),
        current_a=float(current),
        t_s=t_s,
        wheel_angle_rad=signals["wheel_angle"],
        carriage_position_m=signals["carriage_position"],
        acceleration_m_s2=signals["acceleration"],
        motor_current_a=signals["motor_current"],
        held=signals.get("carriage_held"),
        wheel_encoder=_rounding(faster.get("wheel_angle"), len(t_s)),
        carriage_encoder=_rounding(faster.get("carriage_position"), len(t_s)),
        accelerometer=_rounding(faster.get("acceleration"), len(t_s)),
    )
    return without_spikes(read)


def _rounding(samples: FloatArray | None, means: int) -> Rounding | None:
    """Return how a sensor rounds ``samples`` (n,), of which there are so many ``means``; if any."""
    return None if samples is None else Rounding(count(samples), len(samples) / means)


def _constants(
    trials: Sequence[tuple[RecordedSweep, TrialInfo]], differing: Sequence[str] = ()
) -> LugreConstants:
    """Return what all ``trials`` have in common; the guide's friction is that at the first mass.

    Constants that are ``differing`` may do so.

    The guide carries its load at a lever, so that its friction is proportional to the mass
    (Eqs. 20 and 21 of the paper); the plan may state at which mass it was measured.

    Raises:
        DataError: a constant is missing, not possible, or differs between trials.
    """
    given = [name for name in (*CONSTANTS, FRICTION_MASS, GUIDE_LIFT) if _gives(trials, name)]
    values = _in_common(trials, given, differing)
    mass = values[MASS]
    friction_mass = values.get(FRICTION_MASS, mass)
    if not friction_mass > 0.0:
        raise DataError(f"{FRICTION_MASS} is {friction_mass:g} kg, must be above 0 kg")
    return LugreConstants(
        mass_kg=mass,
        wheel_radius_m=values["wheel_radius"],
        guide_friction_n=values["guide_friction"] * mass / friction_mass,
        rolling_resistance=values["rolling_resistance"],
        gravity_m_s2=values["gravity"],
        guide_lift_n=values.get(GUIDE_LIFT, 0.0) * mass / friction_mass,
    )


def _in_common(
    trials: Sequence[tuple[RecordedSweep, TrialInfo]],
    names: Sequence[str],
    differing: Sequence[str] = (),
) -> dict[str, float]:
    """Return the constants ``names`` of the first trial.

    Raises:
        DataError: one is missing, or differs between trials and is not among ``differing``.
    """
    first_sweep, first_trial = trials[0]
    values = {name: first_sweep.constant(first_trial, name) for name in names}
    for sweep, trial in trials:
        for name, value in values.items():
            other = sweep.constant(trial, name)
            if other != value and name not in differing:
                raise DataError(
                    f"{name} is {value:g} in trial {first_trial.number} of {first_sweep.path} and "
                    f"{other:g} in trial {trial.number} of {sweep.path}",
                    hint="they cannot be fitted together: add what changed to `group_by`",
                )
    return values


def _gives(trials: Sequence[tuple[RecordedSweep, TrialInfo]], name: str) -> bool:
    """Whether a constant must be read: it is not optional, or some plan gives it."""
    return name in CONSTANTS or any(name in sweep.plan.constants for sweep, _ in trials)


def rig_constants(
    trials: Sequence[tuple[RecordedSweep, TrialInfo]], constants: LugreConstants
) -> RigConstants:
    """Return what the simulation of the rig takes, each value with its standard uncertainty.

    Raises:
        DataError: a constant of the drive is missing, or one or its uncertainty differs between
            trials.
    """
    sweep, trial = trials[0]
    if missing := _missing(trials):
        raise DataError(
            f"{sweep.path}: output error simulates the drive and needs {', '.join(missing)}",
            hint="give them with `--set NAME=VALUE`, or under `identify: constants:` in the "
            "procedure; `--method slip-force` does without",
        )
    values = {name: sweep.constant(trial, name) for name in CONSTANTS} | _in_common(trials, DRIVE)
    share = 1.0
    if FRICTION_MASS in sweep.plan.constants:
        share = constants.mass_kg / sweep.constant(trial, FRICTION_MASS)
    values["guide_friction"] = constants.guide_friction_n
    values["bearing_torque"] *= share
    names = tuple(UNSTATED_U)
    if _gives(trials, GUIDE_LIFT):
        names = (*names, GUIDE_LIFT)
        values[GUIDE_LIFT] = constants.guide_lift_n
    return known_constants(values, uncertainties(trials, names), share)


def uncertainties(
    trials: Sequence[tuple[RecordedSweep, TrialInfo]], names: Sequence[str]
) -> dict[str, float | None]:
    """Return the standard uncertainties of constants; None of one that states none.

    Raises:
        DataError: trials state one value with several uncertainties.
    """
    first, trial = trials[0]
    for name in names:
        value, text = first.constant(trial, name), as_stated(first, trial, name)
        for sweep, other in trials:
            if sweep.constant(other, name) == value and as_stated(sweep, other, name) != text:
                raise DataError(
                    f"{name} is {text} in {first.path} and {as_stated(sweep, other, name)} in "
                    f"{sweep.path}",
                    hint=f"state what holds for both with `--set {name}=...`",
                )
    return {name: first.uncertainty(trial, name) for name in names}


def as_stated(sweep: RecordedSweep, trial: TrialInfo, name: str) -> str:
    """Return a constant in SI as a recording states it, with its uncertainty if there is one."""
    u = sweep.uncertainty(trial, name)
    return f"{sweep.constant(trial, name):g}" + ("" if u is None else f" ± {u:g}")


def known_constants(
    values: Mapping[str, float], stated: Mapping[str, float | None], share: float = 1.0
) -> RigConstants:
    """Return ``values`` with their standard uncertainties, that of each kind if none is stated.

    ``share`` is the mass over that at which those ``WITH_MASS`` are stated. A guide that rubs along
    the travel may rub as much up or down: a lift that states no u may be anything between (GUM,
    JCGM 100:2008, 4.3.7: u is the half width over the root of 3).
    """
    unstated = {name: part * abs(values[name]) for name, part in UNSTATED_U.items()}
    unstated[GUIDE_LIFT] = values["guide_friction"] / math.sqrt(3.0)
    known = {}
    for name, without in unstated.items():
        scale = share if name in WITH_MASS else 1.0
        u = stated.get(name)
        known[name] = Known(values.get(name, 0.0), without if u is None else u * scale)
    return RigConstants(**known, roller_transitions=values["roller_transitions"])
