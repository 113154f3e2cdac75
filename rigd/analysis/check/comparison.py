"""Compares evaluations of recordings that are alike: what must not matter, and what must.

A trial counts by its data if it counts by being there, and its constants count wherever it stands.
Two recordings of some trials each give what one of all gives. Samples that are held for longer are
no more information. Samples that are no numbers spoil nothing beyond their trial.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from typing import Any, Final
from unittest.mock import patch

import numpy as np

from rigd.analysis.check.case import Case, SimulatedTrial
from rigd.analysis.fitting import fit as fitting
from rigd.analysis.fitting.model import Model
from rigd.analysis.result import FloatArray
from rigd.model.errors import RigdError

#: Lower and upper end of a 95 % interval; None: the data leave the value open.
Interval = tuple[float, float] | None
Found = Mapping[str, Interval]
#: ``evaluate(cases, numbers)``: the intervals found in a recording of each case, all together; None
#: if they are refused. The trials have ``numbers``, if given.
Evaluate = Callable[..., Found | None]

#: How often a sample is held, and what intervals may shrink to by it.
HELD: Final = 3
HELD_WIDTH: Final = 0.75
#: By which part a signal is altered, and by how much a constant.
ALTERED_SIGNAL: Final = 0.02
ALTERED_CONSTANT: Final = 1.1
#: How much wider intervals may become if a part of one trial is no number.
SPOILT_WIDTH: Final = 2.0
#: Part of a trial from which on it has no numbers.
SPOILT_FROM: Final = (0.23, 0.37)
#: Share of residuals that repeat the one before, beyond that of the signals.
REPEATED: Final = 0.3
#: Steps of the parameters from which derivatives are taken, as parts of them.
STEPS: Final = (1e-4, 1e-5)
#: Derivatives may differ by this part; those of two steps differ by less, if there are any.
DERIVATIVE: Final = 0.02


def counts_by_its_data(case: Case, evaluate: Evaluate, whole: Found) -> Iterator[tuple[str, str]]:
    """Yield a trial whose data change nothing, though it changes something by being there."""
    for index in dict.fromkeys((0, len(case.trials) - 1)):
        if len(case.trials) < 2:
            return
        trial = case.trials[index]
        signals = {
            name: values + ALTERED_SIGNAL * (values + _largest(case, name))  # some are zero
            for name, values in trial.signals.items()
        }
        altered = _with_trial(case, index, replace(trial, signals=signals))
        if evaluate([altered]) == whole and evaluate([_left_out(case, index)]) != whole:
            yield (
                f"trial {index + 1} counts by being there, and with other data it finds the same",
                "use each trial, or name it as left out whatever its place",
            )


def constants_count_anywhere(
    case: Case, evaluate: Evaluate, whole: Found, turned: Found | None
) -> Iterator[tuple[str, str]]:
    """Yield that the constants of a trial count at one place alone.

    ``turned`` is found in the case that :func:`rotated` returns.
    """
    if not case.constants or turned is None or len(case.trials) < 2:
        return
    own = altered_constants(case, trials=1)
    here, elsewhere = evaluate([own]), evaluate([rotated(own)])
    if here is None or elsewhere is None:
        return  # it may ask for the same constants in all trials
    if (here == whole) != (elsewhere == turned):
        yield (
            "the constants of a trial count at one place among the trials, and not at another",
            "take those of each trial: sweep.constant(trial, name)",
        )


def whole_in_parts(case: Case, evaluate: Evaluate, whole: Found) -> Iterator[tuple[str, str]]:
    """Yield that two recordings give what some trials of them give."""
    if len(case.trials) < 2:
        return
    parts = [replace(case, trials=part) for part in (case.trials[:1], case.trials[1:])]
    found = evaluate(parts)
    if found is None or found == whole:
        return
    for index in (0, len(case.trials) - 1):
        less = evaluate([_left_out(case, index)])
        if less is not None and less != whole and apart(found, less) < apart(found, whole):
            yield (
                f"in two recordings it finds what it finds without trial {index + 1}",
                "tell trials of two recordings apart: both have a trial 1",
            )
            return


def held_samples(case: Case, evaluate: Evaluate, whole: Found) -> Iterator[tuple[str, str]]:
    """Yield intervals that become narrower if each sample is held for longer."""
    found = evaluate([replace(case, trials=[_slowly(trial) for trial in case.trials])])
    for name in case.truth if found else ():
        was, now = whole.get(name), (found or {}).get(name)
        if was is None or now is None:
            continue
        share = (now[1] - now[0]) / (was[1] - was[0]) if was[1] > was[0] else 1.0
        if share < HELD_WIDTH:
            yield (
                f"with each sample held for {HELD} rows the interval of {name} shrinks to "
                f"{share:.2g} of itself",
                "count what repeats an earlier sample, or is computed from the same ones, once",
            )


def spoilt_samples(case: Case, evaluate: Evaluate) -> Iterator[tuple[Case, Found, Found | None]]:
    """Yield cases of which a trial ends in samples that are no numbers, if they are not refused.

    With each come what is found, and what is found without that trial.
    """
    for index, part in zip((0, len(case.trials) - 1), SPOILT_FROM, strict=True):
        trial = case.trials[index]
        first = int(part * len(trial.t_s)) + 1
        signals = {name: values.copy() for name, values in trial.signals.items()}
        for values in signals.values():
            values[first:] = math.nan
        spoilt = _with_trial(case, index, replace(trial, signals=signals))
        if (found := evaluate([spoilt])) is not None:
            several = len(case.trials) > 1
            yield spoilt, found, evaluate([_left_out(case, index)]) if several else None


def wider(name: str, found: Found, without: Found | None) -> float:
    """Return how much wider an interval is than without a trial; 0 if that is not known."""
    now, less = found.get(name), (without or {}).get(name)
    if less is None or not less[1] > less[0]:
        return 0.0
    return math.inf if now is None else (now[1] - now[0]) / (less[1] - less[0])


def rotated(case: Case) -> Case:
    """Return the case with its first trial at the end: none keeps its place."""
    return replace(case, trials=[*case.trials[1:], case.trials[0]])


def apart(found: Found, other: Found) -> float:
    """Return the largest difference of ends over the width; infinite if one of them is open."""
    far = 0.0
    for name in {*found, *other}:
        a, b = found.get(name), other.get(name)
        if a is None and b is None:
            continue
        if a is None or b is None:
            return math.inf
        width = max(b[1] - b[0], a[1] - a[0])
        far = max(far, max(abs(x - y) for x, y in zip(a, b, strict=True)) / (width or 1.0))
    return far


# Fits of the library, as they are made.


@dataclass(eq=False)
class Fits:
    """The fits that were made: their models, the points that they found, starts and seeds."""

    models: list[tuple[Model, FloatArray]]
    asked: list[tuple[int, int]]


@contextmanager
def watched_fits() -> Iterator[Fits]:
    """Watch the fits of :func:`rigd.analysis.fitting.fit.multi_start`."""
    original, seen = fitting.multi_start, Fits([], [])

    def watched(model: Model, *, starts: int, seed: int, **more: Any) -> Sequence[fitting.Fit]:
        fits = original(model, starts=starts, seed=seed, **more)
        seen.asked.append((starts, seed))
        seen.models.append((model, fits[0].theta))
        return fits

    with patch.object(fitting, "multi_start", watched):
        import rigd.analysis.fitting.identification as identification
        import rigd.analysis.fitting.selection as selection

        with (
            patch.object(identification, "multi_start", watched),
            patch.object(selection, "multi_start", watched),
        ):
            yield seen


def wrong_derivatives(model: Model, theta: FloatArray) -> Iterator[str]:
    """Yield the parameters by which the derivatives of the residuals are not those of differences.

    Where the differences of two steps do not agree there is no derivative to compare with.
    """
    with suppress(RigdError, FloatingPointError):
        stated = model.jacobian(theta)[model.mask > 0.0]
        for index, parameter in enumerate(model.parameters):
            coarse, fine = (_difference(model, theta, index, step) for step in STEPS)
            size = float(np.linalg.norm(fine))
            if not size or not float(np.linalg.norm(coarse - fine)) < 0.1 * DERIVATIVE * size:
                continue
            far = float(np.linalg.norm(stated[:, index] - fine)) / size
            if not far <= DERIVATIVE:
                yield f"the derivative by {parameter.name} is {far:.2g} of itself off"


def repeats(model: Model, theta: FloatArray) -> float:
    """Return the share of residuals that count and are the same as the one before."""
    error = model.residuals(theta)
    same = [
        held(piece[model.mask[part] > 0.0])
        for part in model.trial_slices
        if np.count_nonzero(model.mask[part]) > 1
        for piece in [error[part]]
    ]
    return max(same, default=0.0)


def held(values: FloatArray) -> float:
    """Return the share of values that are the same as the one before."""
    return float(np.mean(np.diff(values) == 0.0)) if len(values) > 1 else 0.0


def _difference(model: Model, theta: FloatArray, index: int, step: float) -> FloatArray:
    ends = []
    for sign in (1.0, -1.0):
        moved = theta.copy()
        moved[index] *= 1.0 + sign * step
        ends.append(model.residuals(moved)[model.mask > 0.0])
    slope: FloatArray = (ends[0] - ends[1]) / (2.0 * step * theta[index])
    return slope


# Cases that are alike.


def _with_trial(case: Case, index: int, trial: SimulatedTrial) -> Case:
    trials = list(case.trials)
    trials[index] = trial
    return replace(case, trials=trials)


def _largest(case: Case, name: str) -> float:
    return max(float(np.max(np.abs(trial.signals[name]), initial=0.0)) for trial in case.trials)


def _left_out(case: Case, index: int) -> Case:
    return replace(case, trials=[*case.trials[:index], *case.trials[index + 1 :]])


def _constant(case: Case, trial: SimulatedTrial, name: str) -> float:
    value = case.constants[name]
    return float(trial.parameters[value] if isinstance(value, str) else value)


def altered_constants(case: Case, trials: int) -> Case:
    """Return the case with the constants of the first ``trials`` altered."""
    own = {name: f"own_{name}" for name in case.constants}
    changed = []
    for index, trial in enumerate(case.trials):
        factor = ALTERED_CONSTANT if index < trials else 1.0
        values = {own[name]: factor * _constant(case, trial, name) for name in own}
        changed.append(replace(trial, parameters={**trial.parameters, **values}))
    return replace(case, trials=changed, constants=own)


def _slowly(trial: SimulatedTrial) -> SimulatedTrial:
    """Return a trial with each sample held; the times are those of a faster stream."""
    apart_s = np.diff(trial.t_s, append=2 * trial.t_s[-1] - trial.t_s[-2])
    t_s = (trial.t_s[:, None] + apart_s[:, None] * np.arange(HELD) / HELD).ravel()

    def each(values: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
        return {name: np.repeat(item, HELD) for name, item in values.items()}

    return replace(trial, t_s=t_s, signals=each(trial.signals), channels=each(trial.channels))
