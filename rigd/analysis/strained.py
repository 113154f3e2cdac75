"""Tests whether a few constants, on which a result rests, are what is stated of them.

The residuals of a fit may be as small as noise because a constant has moved instead. If what is
sought and a constant stand in for one another, the data cannot correct it; another constant, which
they do determine, then moves to where chance hardly brings it. The diagnosis tests all constants
with all else that may be wrong, at a level that a move of three uncertainties does not reach. So
the few that a result rests on are tested by themselves.

Under the model a constant with the uncertainty u and the variance c in the fit moves by a normal
deviate with the variance u^2 - c (:func:`rigd.analysis.diagnosis.constants`); Holm's rule holds the
chance of a false alarm of all of them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from rigd.analysis.diagnosis import TOLD_APART, Tested, constants
from rigd.analysis.extended import Extended
from rigd.analysis.fit import fit
from rigd.analysis.output_error import ENOUGH, MAX_ITERATIONS, NEAR, OutputErrorFit, conclude
from rigd.analysis.result import Explanation, FloatArray
from rigd.analysis.score import Scores, holm
from rigd.analysis.system import System
from rigd.analysis.whitened import OutputErrorModel

#: Chance of one false alarm in all of the constants; that of all else is 0.5 %.
LEVEL = 0.02


def strained(
    found: OutputErrorFit, places: Sequence[int], starts: Mapping[int, Sequence[FloatArray]],
    block: int,
) -> Explanation | None:  # fmt: skip
    """Return the constant that explains why one of ``places`` has moved too far; None if none has.

    ``places`` are those of shared unknowns. Each is then left to the data, from the fit and from
    ``starts`` (p,), natural, as another optimum of it may be far; the one that gains most is
    returned, with those that the data do not tell apart from it. ``block`` is the longest
    correlation of the scores that is accounted for, in samples.
    """
    tests = [item for item in constants(found, Scores(found, block).step) if item.place in places]
    if not any(holm([item.score.p_value for item in tests], LEVEL)):
        return None
    freed = [
        _freed(found, item, [found.fit.theta, *starts.get(item.place, ())], block) for item in tests
    ]
    first, *others = sorted(freed, key=lambda item: -item.gain)
    as_good = tuple(item.name for item in others if item.gain > first.gain - TOLD_APART)
    return replace(first, others=as_good)


def _freed(
    found: OutputErrorFit, item: Tested, starts: Sequence[FloatArray], block: int
) -> Explanation:
    """Return what the data alone make of a constant."""
    model = OutputErrorModel(_without(found.model.system, item.place), found.model.noise)
    with np.errstate(over="ignore", invalid="ignore"):  # a start may be far from any motion
        ends = [
            fit(
                model, start, relative_decrease=ENOUGH, damping=NEAR, thorough=True, ridges=True,
                max_iterations=MAX_ITERATIONS,
            )
            for start in starts
        ]  # fmt: skip
    ended = conclude(model, min(ends, key=lambda end: end.cost), block)
    unknown = found.model.system.shared[item.place]
    parameter, value = unknown.parameter, float(ended.fit.theta[item.place])
    sd = math.sqrt(max(float(ended.covariance[item.place, item.place]), 0.0))
    moved = float(ended.fit.scaled[item.place]) - parameter.scaled(parameter.start)
    return Explanation(
        item.name, parameter.unit, value, sd * parameter.slope(value),
        2.0 * (found.fit.cost - ended.fit.cost), "", parameter.start, moved / unknown.u,
    )  # fmt: skip


def _without(system: System, place: int) -> System:
    """Return ``system`` without what is stated of one of its unknowns."""
    if isinstance(system, Extended):
        return replace(system, released=system.released | {place})
    blank = [np.zeros((*measured.shape, 0)) for measured in system.measured]
    return Extended(system, (), blank, frozenset({place}))
