"""Validates saved models of friction on recordings of the rig."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from rigd.analysis import DataError, format_quantity
from rigd.analysis.parameters import conditions
from rigd.analysis.recordings.source import RecordedSweep, TrialInfo
from rigd.analysis.result import TrialRejection
from rigd.analysis.validation.result import GroupValidation, Validation
from rigd.analysis.validation.saved_models import SavedModel, chosen, differing
from rigd_analyses.lugre.needs import DRIVE
from rigd_analyses.lugre.reading import arrays, rig_constants, sort_out
from rigd_analyses.lugre.validation.friction import friction_of
from rigd_analyses.lugre.validation.judge import judged
from rigd_analyses.lugre.validation.motion import SLIP, SPEED, DrivenMotion, driven_motion
from rigd_analyses.lugre.validation.paper import LABEL

Trials = list[tuple[RecordedSweep, TrialInfo]]
TITLE = "Validation of LuGre friction"


def validate(
    models: Sequence[SavedModel],
    sweeps: Sequence[RecordedSweep],
    group: str,
    notify: Callable[[str], None],
) -> Validation:
    """Return how ``sweeps`` agree with ``models``; ``group`` names the one to take, if not empty.

    Each recording is judged by itself: its trials share one drive.

    Raises:
        ConfigError: a model is not usable, or there is none for the conditions of a trial.
        DataError: a recording lacks a signal or constant, or has no trial that moves.
    """
    found: list[GroupValidation] = []
    for sweep in sweeps:
        every = [(sweep, trial) for trial in _complete(sweep)]
        usable, unusable = sort_out(every)
        kept = {trial.number for _, trial in usable}
        lacking = [conditions(*item) for item in every if item[1].number not in kept]
        groups = _by_model(models, usable, group)
        left_out = shared_out([saved for saved, _ in groups], lacking, unusable)
        for (saved, trials), own in zip(groups, left_out, strict=True):
            label = _label(sweep, trials, several=len(sweeps) > 1)
            notify(f"{label} by the model {saved.name}: {len(trials)} trials")
            found.append(_group(label, saved, trials, own))
    published = any(
        trial.deviation(SPEED).published is not None for item in found for trial in item.trials
    )
    return Validation(
        "lugre", TITLE, tuple(found), (SLIP, SPEED), STATEMENTS, LABEL if published else ""
    )


STATEMENTS = (
    "The measured motor current, as the monitor shows it, drives the identified model from rest; "
    "nothing else of the trial enters. The current's own noise is filtered between its jumps.",
    "Measured and modelled travel go through the same zero-phase filter (31 ms): speed is that of "
    "the carriage, slip is wheel radius times wheel speed less it, force is Eq. 34 of the paper.",
    "A trial passes if neither slip nor speed is off by more than three times what the "
    "recording's own noise and the model's uncertainty leave, with the stated standard "
    "uncertainties of the constants added in quadrature. The force is shown and not judged: the "
    "rollers shake the accelerometer.",
    "If a trial does not pass, the fewest constants are looked for that would have to be "
    "otherwise: gain and zero of the drive first, fitted to the speeds alone, then one of the "
    "others within three of its uncertainties.",
)


def _complete(sweep: RecordedSweep) -> Sequence[TrialInfo]:
    if not sweep.trials:
        raise DataError(
            f"{sweep.path} has no complete trial",
            hint="`rigd run --resume` plays the missing ones",
        )
    if missing := [name for name in DRIVE if name not in sweep.plan.constants]:
        raise DataError(
            f"{sweep.path}: validation simulates the drive and needs {', '.join(missing)}",
            hint="give them with `--set NAME=VALUE`, or under `identify: constants:` in the "
            "procedure",
        )
    return sweep.trials


def _by_model(
    models: Sequence[SavedModel], trials: Trials, group: str
) -> list[tuple[SavedModel, Trials]]:
    found: dict[int, tuple[SavedModel, Trials]] = {}
    for sweep, trial in trials:
        saved = chosen(models, conditions(sweep, trial), group)
        found.setdefault(id(saved), (saved, []))[1].append((sweep, trial))
    return list(found.values())


def shared_out(
    models: Sequence[SavedModel],
    conditions: Sequence[Mapping[str, str]],
    unusable: Sequence[TrialRejection],
) -> list[list[TrialRejection]]:
    """Return for each of ``models`` the ``unusable`` trials, with ``conditions``, that are its own.

    A trial under conditions of none of them is with all: it is lost to no reader.
    """
    found: list[list[TrialRejection]] = [[] for _ in models]
    for own, rejection in zip(conditions, unusable, strict=True):
        fitting = [k for k, saved in enumerate(models) if not differing(saved, own)]
        for k in fitting or range(len(models)):
            found[k].append(rejection)
    return found


def _group(
    label: str, saved: SavedModel, trials: Trials, unusable: Sequence[TrialRejection]
) -> GroupValidation:
    friction = friction_of(saved)
    motions: list[DrivenMotion] = []
    left_out = list(unusable)
    for cell in _cells(trials):
        found, shared = arrays(cell)
        rig = rig_constants(cell, shared)
        for (sweep, info), trial in zip(cell, found, strict=True):
            motion = driven_motion(trial, rig, _told(sweep, info, rig.mass.value))
            if isinstance(motion, TrialRejection):
                left_out.append(motion)
            else:
                motions.append(motion)
    if not motions:
        reasons = "; ".join(f"{item.label}: {item.reason}" for item in left_out)
        raise DataError(
            f"{trials[0][0].path}: no trial can be used ({reasons})",
            hint="record currents that move the carriage",
        )
    return judged(label, saved.name, motions, friction, left_out, _known_before(saved, trials))


def _cells(trials: Trials) -> list[Trials]:
    """Return the trials with the same conditions together: they share all constants."""
    found: dict[tuple[str, ...], Trials] = {}
    for sweep, trial in trials:
        found.setdefault(tuple(conditions(sweep, trial).values()), []).append((sweep, trial))
    return list(found.values())


def _told(sweep: RecordedSweep, trial: TrialInfo, mass_kg: float) -> dict[str, str]:
    """Return the conditions of a trial for a person: those of the plan, mass and current."""
    mass = format_quantity(mass_kg, sweep.plan.units.get("mass", "kg"))
    current = sweep.parameter(trial, "current")
    return {**conditions(sweep, trial), "mass": mass, "current": current}


def _label(sweep: RecordedSweep, trials: Trials, *, several: bool) -> str:
    """Return what all ``trials`` have in common, such as the floor; the file if that is nothing."""
    all_conditions = [conditions(sweep, trial) for _, trial in trials]
    words = [
        value
        for name, value in all_conditions[0].items()
        if all(item[name] == value for item in all_conditions)
    ]
    return ", ".join(words) or (sweep.path.name if several else sweep.info.procedure)


def _known_before(saved: SavedModel, trials: Trials) -> list[str]:
    """Return what a reader must know with any data."""
    sweep, trial = trials[0]
    own = conditions(sweep, trial)
    found = [
        f"The model is of {name} {saved.conditions[name]}, the trials are of {own[name]}."
        for name in differing(saved, own)
    ]
    rigs = saved.get("rigs")
    if isinstance(rigs, list) and rigs and sweep.info.rig not in rigs:
        made = ", ".join(map(str, rigs))
        found.append(f"The model is of the rig {made}, the trials are of {sweep.info.rig}.")
    if saved.made_from(sweep.path):
        found.append("The model was identified from this recording: that it fits is no prediction.")
    return found
