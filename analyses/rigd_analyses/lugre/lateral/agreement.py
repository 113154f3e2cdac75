"""Tests whether recordings of a lateral sweep that are fitted together agree.

What is compared is the friction of the guide in each trial (:mod:`.loads`), which rests on no
coupling: one coupling for all recordings, against one for each.
"""

from __future__ import annotations

from dataclasses import replace

from rigd.analysis.fitting.agreement import agreement as agreement_of
from rigd.analysis.result import FitOutcome, FloatArray, Gate, ResidualTest
from rigd_analyses.lugre.lateral.coupling_fit.problem import Reduced


def agreement(problem: Reduced, coupling: FloatArray) -> ResidualTest | None:
    """Return the test whether all recordings have their coupling in common; None for only one.

    ``coupling`` (8,), natural, fits ``problem`` best.
    """
    trials: dict[str, list[int]] = {}
    for place, driven in enumerate(problem.system.rig.trials):
        trials.setdefault(driven.trial.recording, []).append(place)
    if len(trials) < 2:
        return None
    together = problem.of([place for places in trials.values() for place in places])
    apart = {name: problem.of(places) for name, places in trials.items()}
    return agreement_of(together, apart, coupling, lambda _: 1.0)


def with_agreement(gate: Gate, alike: ResidualTest | None = None) -> Gate:
    """Return ``gate``; of data that do not fit, recordings that disagree are the first reason."""
    if alike is None or alike.passed or gate.outcome is not FitOutcome.MISFIT:
        return gate
    sentence = f"The model does not fit these data: {alike.sentence}"
    return replace(gate, sentence=sentence, findings=(alike.sentence, *gate.findings))
