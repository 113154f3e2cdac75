"""Tests whether all trials, and all recordings, share one level of a parameter.

Each recording gets an offset of its own from the fitted value, the first 0; a trend over the trials
in their order is an offset that grows from the first to the last. Both are score tests, as those of
all other candidates (:mod:`rigd.analysis.output_error.score`). Nothing is refitted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rigd.analysis.output_error.estimator import OutputErrorFit
from rigd.analysis.output_error.score import Score, Scores
from rigd.analysis.output_error.thresholds import THRESHOLDS
from rigd.analysis.report.rounding import probability
from rigd.analysis.result import ResidualTest


@dataclass(frozen=True)
class TrialParts:
    """Parts of trials that should share a parameter; ``names`` (trials,) has that of each trial.

    ``kind`` is what the parts are, such as recordings; ``advice`` is given if they disagree.
    """

    kind: str
    names: Sequence[str]
    advice: str


def trend(scores: Scores, index: int, trials: int) -> Score:
    """Return whether a level rises or falls steadily over ``trials``; size: last minus first."""
    return scores.offsets(index, (np.arange(trials) / max(trials - 1, 1) - 0.5)[None, :])


def differences(scores: Scores, index: int, groups: Sequence[int]) -> Score:
    """Return whether groups have levels of their own; ``groups`` (trials,) numbers them."""
    numbers = np.asarray(groups)
    members = [(numbers == number).astype(float) for number in np.unique(numbers)[1:]]
    return scores.offsets(index, np.array(members))


def homogeneity(
    fit: OutputErrorFit,
    index: int,
    what: str,
    parts: Sequence[TrialParts],
    block: int,
    look: str = "",
) -> tuple[ResidualTest, ...]:
    """Return the tests of the level of the scaled parameter ``index``, called ``what``.

    The trials are in the order in which they were played; ``parts`` of only one name are no test,
    and a single trial has none.
    ``block`` is the longest correlation that is heeded, in samples; ``look`` is what to check if
    the trials differ, but not steadily.
    """
    trials = fit.model.trials
    if trials < 2:
        return ()
    scores = Scores(fit, block)
    drift, apart = trend(scores, index, trials), differences(scores, index, range(trials))
    is_trend = drift.gain - drift.dof >= THRESHOLDS.min_trend_share * (apart.gain - apart.dof)
    way = "rises" if drift.size[0] > 0.0 else "falls"
    chance = probability(drift.p_value)
    found = [
        _test(
            f"steady {what}", drift,
            f"The {what} {way} from trial to trial ({chance}): wear, warming or dirt? Clean the "
            "contact, let it warm up, record again."
            if is_trend
            else f"The {what} differs from trial to trial ({chance}), not steadily in their order."
            + (f" Look at {look}." if look else ""),
            f"The {what} neither rises nor falls over the trials.",
        )
    ]  # fmt: skip
    for part in parts:
        names = list(dict.fromkeys(part.names))
        if len(names) < 2:
            continue
        apart = differences(scores, index, [names.index(name) for name in part.names])
        every = ", ".join(names)
        found.append(_test(
            f"agreement of {part.kind}", apart,
            f"{every} disagree on the {what} ({probability(apart.p_value)}). {part.advice}",
            f"{every} agree on the {what}.",
        ))  # fmt: skip
    return tuple(found)


def _test(name: str, score: Score, changed: str, same: str) -> ResidualTest:
    passed = score.p_value >= THRESHOLDS.max_p_value_agreement
    return ResidualTest(name, score.gain, score.p_value, passed, same if passed else changed)


def changes(tests: Sequence[ResidualTest]) -> tuple[str, ...]:
    """Return the sentences of ``tests`` of :func:`homogeneity` that found a change, last first."""
    return tuple(test.sentence for test in reversed(tests) if not test.passed)
