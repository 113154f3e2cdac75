"""Evaluates recordings of the robot: all trials of all recordings are fitted together."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from rigd.analysis import DataError, Options
from rigd.analysis.output_error import OutputErrorFit, estimate
from rigd.analysis.parameters import Fitted, Group, ParameterEvaluation, Trials, complete_groups
from rigd.analysis.result import FloatArray, TrialRejection
from rigd.analysis.source import RecordedSweep
from rigd_analyses.articulated.reading import robot_trials
from rigd_analyses.articulated.result import result
from rigd_analyses.articulated.system import CONTACTS, SHARED, RobotSystem

LABEL: Final = "robot"
SCORES: Final = 10  #: frames, 0.4 s: longest correlation of the scores that is accounted for
ROUNDS: Final = 4  #: of choosing trials without sliding and fitting them; two are usual


@dataclass(frozen=True, eq=False)
class RobotFound:
    """The fit of the trials in which no contact slides, and those that are left out."""

    system: RobotSystem
    fit: OutputErrorFit
    grip: float
    rejected: tuple[TrialRejection, ...]


def evaluate(
    sweeps: Sequence[RecordedSweep], options: Options, notify: Callable[[str], None]
) -> ParameterEvaluation:
    """Return the contacts' parameters from all trials together.

    Raises:
        DataError: a recording has no complete trial, constants differ between recordings, or the
            data cannot answer.
    """
    trials = [trial for group in complete_groups(sweeps, options, notify) for trial in group.trials]
    found = find(trials, notify)
    fitted = result(found.system, found.fit, found.grip, found.rejected)
    return ParameterEvaluation.of(sweeps, [Fitted(Group(LABEL, trials), fitted)], options)


def find(trials: Trials, notify: Callable[[str], None]) -> RobotFound:
    """Return the fit of those ``trials`` in which no contact slides.

    Which these are follows from the fit, and the fit from them: both are repeated until they agree.

    Raises:
        DataError: constants differ, every trial slides, or the data cannot answer.
    """
    everything = RobotSystem(
        tuple(robot_trials(trials)), _constants(trials), _constant(trials, "gear_ratio")
    )
    grip = _constant(trials, "certain_grip")
    point = np.array([item.parameter.start for item in everything.shared])
    chosen = _without_sliding(everything, point, grip)
    for _ in range(ROUNDS):
        notify(f"{len(chosen)} of {len(everything.trials)} trials without sliding are fitted")
        system = everything.of(chosen)
        fit = estimate(system, [point], SCORES)
        point = fit.fit.theta[: len(SHARED)]
        before, chosen = chosen, _without_sliding(everything, point, grip)
        if chosen == before:
            return RobotFound(system, fit, grip, _rejected(everything, chosen, point, grip))
    raise DataError(
        "which trials slide does not settle: some are at the limit that certain_grip states",
        hint="record slower circles or ramps, or state another certain_grip",
    )


def _without_sliding(system: RobotSystem, point: FloatArray, grip: float) -> Sequence[int]:
    """Return the trials in which no contact carries more than ``grip`` times its load.

    Raises:
        DataError: there is none.
    """
    found = [k for k in range(len(system.trials)) if system.share(k, point) <= grip]
    if not found:
        raise DataError(
            f"a contact carries more than {grip:g} times its load in each trial",
            hint="record slower circles, and straight runs with a ramp; if the contacts grip "
            "better, state a higher certain_grip",
        )
    return found


def _rejected(
    system: RobotSystem, kept: Sequence[int], point: FloatArray, grip: float
) -> tuple[TrialRejection, ...]:
    return tuple(
        TrialRejection(
            item.label,
            f"contacts may slide: without sliding, one would carry "
            f"{system.share(k, point):.2f} times its load, certain are {grip:g}",
        )
        for k, item in enumerate(system.trials)
        if k not in kept
    )


def _constants(trials: Trials) -> dict[str, tuple[float, float]]:
    """Return the constants with standard uncertainties; one that states none is exact."""
    sweep, first = trials[0]
    names = [name for name in (*SHARED, "gear_ratio") if name in sweep.plan.constants]
    found = {}
    for name in names:
        value = _constant(trials, name)
        if not (np.isfinite(value) and value > 0.0):
            raise DataError(f"{name} is {value:g}, must be a positive number")
        found[name] = (value, sweep.uncertainty(first, name) or 0.0)
    return {name: found[name] for name in found if name not in CONTACTS}


def _constant(trials: Trials, name: str) -> float:
    """Return a constant that all trials have in common.

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
