"""Tries identified contacts on other recordings: motor speeds in; torques and poses out.

The robot is simulated from the measured speeds with the contacts of the model. Begin of each trial,
camera and the constants are fitted within what is known of them, as in the identification, and so
are the contacts within their uncertainties of the model. Three tests decide:

- level: what is left of torques, places and headings, whitened by the noise that speeds and sensors
  show themselves, is of mean square 1; the limits are those of the identification's gate;
- contacts: the data alone would have a contact elsewhere; if it is right, by a step of variance
  u**2 + s**2, with its standard uncertainties u by the model and s by the data (correlated noise);
- constants: the same with their stated uncertainties.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from rigd.analysis import DataError, Options
from rigd.analysis.fitting.identifiability import Z_95
from rigd.analysis.output_error.estimator import OutputErrorFit
from rigd.analysis.output_error.system import System
from rigd.analysis.output_error.thresholds import THRESHOLDS
from rigd.analysis.parameters import complete_groups
from rigd.analysis.recordings.source import RecordedSweep
from rigd.analysis.report.rounding import number, places_for
from rigd.analysis.result import FloatArray, TrialRejection
from rigd.analysis.validation.result import (
    Bias,
    Deviation,
    GroupValidation,
    ModelOutcome,
    OutputTrace,
    ValidatedTrial,
    Validation,
)
from rigd.analysis.validation.saved_models import SavedModel, chosen
from rigd_analyses.articulated.checks import check_markers
from rigd_analyses.articulated.evaluation import LABEL, certain_grip, robot_system
from rigd_analyses.articulated.family import common_scale
from rigd_analyses.articulated.reading import TORQUE_FRAMES, RobotTrial
from rigd_analyses.articulated.search import check_way, sliding_trials, tried
from rigd_analyses.articulated.system import RATIO, UNITS

TITLE: Final = "Validation of the contacts of the articulated robot"
PLACE, HEADING, TORQUE = "place", "heading", "torque"
#: Columns of the outputs that each judged output has, and its unit.
COLUMNS: Final = {
    PLACE: ((2, 3, 5, 6), "m"), HEADING: ((4, 7), "rad"), TORQUE: ((0, 1), "N m"),
}  # fmt: skip
#: Standard deviations: of fifteen contacts and constants chance lets one beyond in 0.3 % of cases.
SURE: Final = 3.7
EXACT: Final = 1e-4  #: relative u of a contact whose uncertainty the file does not have
#: A contact that must be further off than this, relative, to be seen is not tested.
USEFUL_LIMIT: Final = 0.25
CORRECTED: Final = 2  #: constants that may have to be otherwise
UNMOVED: Final = 1e-3  #: share of a variance; less is learnt of what data do not depend on
SLIDES: Final = "contacts slide, and the model has no mu_s and mu_d"
STATEMENTS: Final = (
    "The measured speeds of the motors drive the robot with the contacts of the model; torques and "
    "the poses of both markers come out.",
    "The begin of each trial, scale and latency of the camera, and the constants within their "
    "stated uncertainties are fitted; the contacts within those of the model.",
    f"A trial passes if neither place, heading nor torque is off by more than "
    f"{THRESHOLDS.max_mean_square_trial**0.5:.1f} times what the noise of speeds and sensors "
    "leaves.",
    f"The model is rejected if a trial does not pass, if an output is off by more than "
    f"{THRESHOLDS.max_mean_square_output**0.5:.1f} times the noise in all trials together, or if "
    f"the data move a contact by more than {SURE:g} standard deviations of what model and data "
    "leave open.",
)


@dataclass(frozen=True)
class Known:
    """A contact as a model has it: its value in SI, and the standard uncertainty of its logarithm.

    ``stated`` is false if the file has no interval.
    """

    value: float
    u: float
    stated: bool


def validate(
    models: Sequence[SavedModel],
    sweeps: Sequence[RecordedSweep],
    group: str,
    notify: Callable[[str], None],
) -> Validation:
    """Return how all trials of ``sweeps`` together agree with a model.

    Raises:
        ConfigError: the model is not usable.
        DataError: a recording lacks a signal or constant, constants differ, or no trial is left.
    """
    saved = chosen(models, {}, group)
    contacts = contacts_of(saved)
    trials = [t for found in complete_groups(sweeps, Options(), notify) for t in found.trials]
    system, grip = robot_system(trials, _priors(contacts)), certain_grip(trials)
    check_markers(system.trials)
    check_way(system)
    sliding = sliding_trials(system, grip)
    left_out: tuple[TrialRejection, ...] = ()
    if sliding and RATIO not in _priors(contacts):
        left_out = tuple(TrialRejection(system.trials[k].label, SLIDES) for k in sliding)
        kept = [k for k in range(len(trials)) if k not in sliding]
        if not kept:
            raise DataError(
                f"contacts slide in each trial, and {saved.name} has no mu_s and mu_d",
                hint="record slower circles, and straight runs with a ramp",
            )
        system, trials, sliding = system.of(kept), [trials[k] for k in kept], []
    notify(f"{len(trials)} trials by the model {saved.name}")
    conditions = [
        {name: sweep.parameter(info, name) for name in info.parameters} for sweep, info in trials
    ]
    robot = Robot(system, COLUMNS, tuple(_priors(contacts)), UNITS.__getitem__)
    found = judged(saved.name, robot, tried(system, sliding), conditions)
    return validation("articulated", saved, sweeps, replace(found, left_out=left_out), contacts)


def validation(
    model: str, saved: SavedModel, sweeps: Sequence[RecordedSweep], found: GroupValidation,
    contacts: Mapping[str, Known],
) -> Validation:  # fmt: skip
    """Return the verdict ``found`` with what is to be said of the file and of the recordings."""
    findings = list(found.findings)
    if any(saved.made_from(sweep.path) for sweep in sweeps):
        findings.append("The model was identified from these recordings: it predicts nothing new.")
    if not all(item.stated for item in contacts.values()):
        findings.append("The file states no uncertainty of some contacts: they count as exact.")
    return Validation(
        model, TITLE, (replace(found, findings=tuple(findings)),), (PLACE, HEADING, TORQUE),
        STATEMENTS, method="motor speeds in, torques and poses out",
    )  # fmt: skip


def contacts_of(saved: SavedModel) -> dict[str, Known]:
    """Return the contacts that ``saved`` has a number of, by their names in its parameters.

    Raises:
        ConfigError: it did not fit its own recordings, a value is missing or impossible.
    """
    names = ("k_lon", "k_lat", "k_roll", "mu_d", "mu_s")
    found = known_of(saved, {name: UNITS[name] for name in names})
    missing = [name for name in ("k_lon", "k_roll") if name not in found]
    if missing:
        raise saved.error(
            f"the model has no value of {', '.join(missing)}", ("parameters",),
            hint="identify straight runs at several speeds",
        )  # fmt: skip
    if "mu_s" in found and "mu_d" in found and found["mu_s"].value < found["mu_d"].value:
        raise saved.error("mu_s must not be below mu_d", ("parameters", "mu_s", "estimate"))
    return found


def known_of(saved: SavedModel, units: Mapping[str, str]) -> dict[str, Known]:
    """Return the contacts that ``saved`` has a number of, of those in ``units``.

    Raises:
        ConfigError: it did not fit its own recordings, or a value is impossible.
    """
    if not saved.fits:
        raise saved.error(
            "this model did not fit the recordings that it was made from: there is nothing to try",
            ("gate",),
            hint="correct what its report names, and identify again",
        )
    found = {}
    for name, wanted in units.items():
        keys = ("parameters", name)
        if saved.get(*keys, "estimate") is None:
            continue
        unit = saved.get(*keys, "unit")
        if unit not in (None, wanted):
            raise saved.error(
                f"parameters.{name} is in {unit}, must be in {wanted}", (*keys, "unit"),
                hint="write the value in that unit",
            )  # fmt: skip
        value = saved.number(*keys, "estimate")
        if not (math.isfinite(value) and value > 0.0):
            raise saved.error(f"{name} is {value:g}, must be above 0", (*keys, "estimate"))
        stated = saved.get(*keys, "low") is not None
        u = EXACT
        if stated:
            low, high = saved.number(*keys, "low"), saved.number(*keys, "high")
            if not 0.0 < low <= value <= high:
                raise saved.error(f"the interval of {name} does not hold it", (*keys, "low"))
            u = max(u, math.log(high / low) / (2.0 * Z_95))
        found[name] = Known(value, u, stated)
    return found


def _priors(contacts: Mapping[str, Known]) -> dict[str, tuple[float, float]]:
    """Return values and relative uncertainties of what the simulation takes."""
    found = {name: (item.value, item.u) for name, item in contacts.items() if name != "mu_s"}
    if "mu_s" in contacts and "mu_d" in contacts:
        upper, lower = contacts["mu_s"], contacts["mu_d"]
        found[RATIO] = (upper.value / lower.value, math.hypot(upper.u, lower.u))
    return found


class RobotTrials(System, Protocol):
    """The trials of a robot that are simulated with the contacts of a model."""

    @property
    def trials(self) -> tuple[RobotTrial, ...]:
        """Return the trials."""

    def torque_counts(self, trial: int) -> NDArray[np.bool_]:
        """Return at which frames (n,) of one trial a torque counts."""


@dataclass(frozen=True, eq=False)
class Robot:
    """A robot on which a model is tried.

    ``columns`` are those of the outputs that each judged output has, with its unit; ``contacts``
    the names of the shared parameters that the model gives; ``unit_of`` gives the unit of each.
    """

    system: RobotTrials
    columns: Mapping[str, tuple[tuple[int, ...], str]]
    contacts: tuple[str, ...]
    unit_of: Callable[[str], str]


def judged(
    model: str, robot: Robot, found: OutputErrorFit, conditions: Sequence[Mapping[str, str]]
) -> GroupValidation:
    """Return the verdict on a model by the fit of the trials; ``conditions`` are those of each."""
    trials = [_Trial(found, robot, k) for k in range(len(robot.system.trials))]
    moved = _moved(found, robot.system)
    sizes = {name: item for name, item in moved.items() if name in robot.contacts}
    biases = tuple(
        _bias(robot.unit_of(name), name, item)
        for name, item in moved.items()
        if name not in robot.contacts and abs(item.deviate) > SURE
    )
    wrong = [_off(name, item) for name, item in sizes.items() if abs(item.deviate) > SURE]
    loud = [text for output in robot.columns if (text := _loud(trials, output))]
    told = {name: item.seen_from for name, item in sizes.items() if item.seen_from < USEFUL_LIMIT}
    findings = [*loud[1:], *wrong[1:]]
    if told:
        shown = ", ".join(f"{_called(name)} from {100 * at:.2g} % on" for name, at in told.items())
        findings.append(f"Seen would be another {shown}.")
    open_ = [_called(name) for name in robot.contacts if name not in told]
    if open_:
        findings.append(f"Not tested: {', '.join(open_)}.")
    off = common_scale(found)
    if off:
        findings.append(
            f"The camera shows all ways {100 * off:+.2g} % off what the stated lengths give: its "
            "unit of length, or all of these lengths."
        )
    if loud or wrong:
        outcome = ModelOutcome.REJECTED
        sentence = (wrong or loud)[0]
        if biases:
            findings += [item.sentence for item in biases]
    elif len(biases) > CORRECTED or any(abs(item.pull) > THRESHOLDS.max_pull for item in biases):
        outcome = ModelOutcome.REJECTED
        sentence = "The constants of the recordings contradict their motion. " + " ".join(
            item.sentence for item in biases
        )
    elif not told:
        outcome = ModelOutcome.UNTESTED
        sentence = f"These trials would show no contact that is less than {USEFUL_LIMIT:.0%} off."
    elif biases:
        outcome = ModelOutcome.CORRECTED
        sentence = " ".join(item.sentence for item in biases)
    else:
        outcome = ModelOutcome.CONFIRMED
        levels = [f"{output} {_level(trials, output) ** 0.5:.2f}" for output in robot.columns]
        sentence = (
            f"With all constants as stated, {len(trials)} trials are within the noise "
            f"(times the noise: {', '.join(levels)}), and no contact is moved."
        )
    return GroupValidation(
        LABEL, model, outcome, sentence,
        tuple(item.validated(own) for item, own in zip(trials, conditions, strict=True)),
        biases, tuple(findings),
    )  # fmt: skip


@dataclass(frozen=True)
class _Moved:
    """How far the data move what is known: ``deviate`` is normal if it is right.

    ``value`` is what the data alone would have, ``sd`` the standard error of its logarithm, and
    ``seen_from`` the relative error that would be beyond ``SURE``.
    """

    stated: float
    stated_u: float  #: of the logarithm
    value: float
    sd: float
    deviate: float

    @property
    def seen_from(self) -> float:
        return SURE * math.hypot(self.stated_u, self.sd)


def _moved(found: OutputErrorFit, system: System) -> dict[str, _Moved]:
    """Return by how much the data move each contact and constant that is known, by its name."""
    moved = {}
    for k, item in enumerate(system.shared):
        if not math.isfinite(item.u):
            continue
        left = float(found.inverse[k, k])  # of the variance u**2, if the noise is as it is taken
        learnt = 1.0 - left / item.u**2
        if learnt < UNMOVED:
            continue
        step = float(found.pulls[k]) * item.u / learnt
        # Of the step, by u and by the noise, which is correlated: the data have the rest.
        variance = (item.u**2 - 2.0 * left + float(found.covariance[k, k])) / learnt**2
        stated = item.parameter.start
        moved[item.parameter.name] = _Moved(
            stated, item.u, stated * math.exp(min(max(step, -5.0), 5.0)),
            math.sqrt(max(variance - item.u**2, 0.0)), step / math.sqrt(variance),
        )  # fmt: skip
    return moved


def _called(name: str) -> str:
    return "mu_s over mu_d" if name == RATIO else name


def _off(name: str, item: _Moved) -> str:
    """Return a sentence: by how much a parameter is off the value of the model."""
    change = item.value / item.stated - 1.0
    sd = math.hypot(item.stated_u, item.sd)
    return (
        f"{_called(name)} would have to be {100 * change:+.2g} % off the model's, which is "
        f"{abs(item.deviate):.1f} standard deviations of what model and data leave open "
        f"({100 * sd:.1g} %)."
    )


def _bias(unit: str, name: str, item: _Moved) -> Bias:
    """Return the value of a parameter that would explain the motion, beside the stated one."""
    u = item.value * item.sd
    shown = number(item.value, places_for(u))
    text = (
        f"{name} would have to be {shown}{'' if unit == '1' else f' {unit}'} for this motion, "
        f"{number(item.stated)} is stated."
    )
    return Bias(name, unit, item.stated, item.stated * item.stated_u, item.value, u, text)


@dataclass(frozen=True, eq=False)
class _Trial:
    """One trial of a fit: its errors, and how they compare with the noise."""

    found: OutputErrorFit
    robot: Robot
    index: int

    @property
    def system(self) -> RobotTrials:
        """The trials."""
        return self.robot.system

    def counts(self, output: str) -> NDArray[np.bool_]:
        """Return at which frames (n,) an output counts."""
        item = self.system.trials[self.index]
        if output == TORQUE:
            return self.system.torque_counts(self.index)
        return np.asarray(np.all(item.seen, axis=1), dtype=np.bool_)

    def squares(self, output: str) -> FloatArray:
        """Return the squares of the whitened errors of an output where it counts."""
        white = self.found.model.noise[self.index].whiten_errors(self.found.errors[self.index])
        columns, _ = self.robot.columns[output]
        return np.asarray(white[self.counts(output)][:, columns] ** 2)

    def validated(self, conditions: Mapping[str, str]) -> ValidatedTrial:
        """Return the trial for a report."""
        item, shared = self.system.trials[self.index], len(self.system.shared)
        theta = self.found.fit.theta
        local = theta[self.found.model.columns(self.index)[shared:]]
        stated = theta[:shared].copy()
        for k, unknown in enumerate(self.system.shared):
            if math.isfinite(unknown.u):
                stated[k] = unknown.parameter.start
        measured = self.system.measured[self.index]
        fitted: FloatArray = measured + self.found.errors[self.index]
        before = self.system.simulate(self.index, stated, local)
        deviations, traces = [], []
        for output, (columns, unit) in self.robot.columns.items():
            at = self.counts(output)

            left = _rms((fitted - measured)[:, columns], at, output)
            level = float(np.mean(self.squares(output))) if at.any() else 0.0
            limit = (
                left * math.sqrt(THRESHOLDS.max_mean_square_trial / level) if level > 0.0 else None
            )
            deviations.append(
                Deviation(
                    output,
                    unit,
                    _rms((before - measured)[:, columns], at, output),
                    left,
                    _rms(measured[:, columns], at, output),
                    limit,
                )
            )
            shown = np.arange(len(measured)) >= TORQUE_FRAMES if output == TORQUE else at
            traces.append(_trace(output, unit, item.t_s, shown, measured, fitted, columns[0]))
        return ValidatedTrial(
            item.label, item.recording, conditions, tuple(deviations), item.t_s, tuple(traces)
        )


def _rms(off: FloatArray, at: NDArray[np.bool_], output: str) -> float:
    """Return the root mean square of columns; x and y of a place are one distance."""
    several = 2.0 if output == PLACE else 1.0
    return math.sqrt(several * float(np.mean(off[at] ** 2))) if np.any(at) else 0.0


def _trace(
    output: str, unit: str, t_s: FloatArray, shown: NDArray[np.bool_],
    measured: FloatArray, fitted: FloatArray, column: int,
) -> OutputTrace:  # fmt: skip
    """Return one column of an output; where it is not shown, it goes on straight."""
    return OutputTrace(
        output, unit,
        np.interp(t_s, t_s[shown], measured[shown, column]) if shown.any() else 0.0 * t_s,
        np.interp(t_s, t_s[shown], fitted[shown, column]) if shown.any() else 0.0 * t_s,
    )  # fmt: skip


def _level(trials: Sequence[_Trial], output: str) -> float:
    """Return the mean square of an output of all trials over that of its noise."""
    squares = [item.squares(output).ravel() for item in trials]
    return float(np.mean(np.concatenate(squares))) if any(map(len, squares)) else 0.0


def _loud(trials: Sequence[_Trial], output: str) -> str:
    """Return in which trial an output is off by most, if it is by more than the noise allows."""
    level = _level(trials, output)
    by_trial = [float(np.mean(part)) if (part := t.squares(output)).size else 0.0 for t in trials]
    worst = int(np.argmax(by_trial))
    if (
        level <= THRESHOLDS.max_mean_square_output
        and by_trial[worst] <= THRESHOLDS.max_mean_square_trial
    ):
        return ""
    return (
        f"Its {output} is off by {level**0.5:.1f} times what the noise of speeds and sensors "
        f"leaves, by {by_trial[worst] ** 0.5:.1f} times in trial "
        f"{trials[worst].system.trials[worst].label}."
    )
