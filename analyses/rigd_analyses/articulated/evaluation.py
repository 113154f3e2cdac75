"""Evaluates recordings of the robot: all trials of all recordings are fitted together."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from rigd.analysis import DataError, Options
from rigd.analysis.output_error.pipeline import identify
from rigd.analysis.parameters import Fitted, Group, ParameterEvaluation, Trials, complete_groups
from rigd.analysis.recordings.source import RecordedSweep
from rigd_analyses.articulated.checks import check_hinge, check_markers
from rigd_analyses.articulated.family import robot_family
from rigd_analyses.articulated.reading import robot_trials
from rigd_analyses.articulated.result import result
from rigd_analyses.articulated.search import find
from rigd_analyses.articulated.system import CONTACTS, SHARED, RobotSystem

LABEL: Final = "robot"


def evaluate(
    sweeps: Sequence[RecordedSweep], options: Options, notify: Callable[[str], None]
) -> ParameterEvaluation:
    """Return the contacts' parameters from all trials together.

    Raises:
        DataError: a recording has no complete trial, constants differ between recordings, or the
            data cannot answer.
    """
    trials = [trial for group in complete_groups(sweeps, options, notify) for trial in group.trials]
    system, grip = robot_system(trials), certain_grip(trials)
    check_markers(system.trials)
    check_hinge(system, grip)
    identified = result(identify(robot_family(find(system, grip, notify), grip)))
    identified = replace(identified, warnings=(*identified.warnings, *unused(trials)))
    fitted = Fitted(Group(LABEL, trials), identified)
    return ParameterEvaluation.of(sweeps, [fitted], options)


def robot_system(
    trials: Trials, contacts: Mapping[str, tuple[float, float]] | None = None
) -> RobotSystem:
    """Return the system of ``trials``; ``contacts`` are known with relative uncertainties.

    Raises:
        DataError: constants differ between recordings, or a signal is missing or too short.
    """
    arrays, constants = tuple(robot_trials(trials)), constants_of(trials)
    return RobotSystem(
        arrays, constants, positive_constant(trials, "gear_ratio"), known=contacts or {}
    )


def certain_grip(trials: Trials) -> float:
    """Return the share of its load that a contact carries without sliding."""
    return common_constant(trials, "certain_grip")


def unused(trials: Trials) -> list[str]:
    """Return a warning if an uncertainty is stated that enters no interval."""
    if not any(sweep.uncertainty(trial, "gear_ratio") for sweep, trial in trials):
        return []
    return [
        "The uncertainty that is stated of gear_ratio enters no interval: it is taken as exact."
    ]


def constants_of(trials: Trials) -> dict[str, tuple[float, float]]:
    """Return the constants with the largest of their standard uncertainties; none is exact."""
    sweep, _ = trials[0]
    names = [name for name in (*SHARED, "rotor_inertia") if name in sweep.plan.constants]
    found = {}
    for name in names:
        value = positive_constant(trials, name)
        found[name] = (value, max(s.uncertainty(trial, name) or 0.0 for s, trial in trials))
    return {name: found[name] for name in found if name not in CONTACTS}


def positive_constant(trials: Trials, name: str) -> float:
    """Return a constant that all trials have in common, in SI.

    Raises:
        DataError: it is missing, differs, or is not positive.
    """
    value = common_constant(trials, name)
    if not (np.isfinite(value) and value > 0.0):
        raise DataError(
            f"{trials[0][0].path}: {name} is {value:g}, must be a positive number",
            hint="correct it in the rig file, or give it with --set",
        )
    return value


def common_constant(trials: Trials, name: str) -> float:
    """Return a constant that all trials have in common, in SI.

    Raises:
        DataError: it is missing, or differs.
    """
    values = {sweep.constant(trial, name) for sweep, trial in trials}
    if len(values) > 1:
        raise DataError(
            f"{name} differs between the recordings: {', '.join(f'{x:g}' for x in sorted(values))}",
            hint="identify each rig with a command of its own",
        )
    return values.pop()
