"""Tests whether recordings of method A that are fitted together agree."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from rigd.analysis.fitting.agreement import agreement as agreement_of
from rigd.analysis.friction import SlipForce
from rigd.analysis.result import FloatArray, ResidualTest
from rigd_analyses.lugre.model import LugreModel

#: A recording with fewer trials does not determine its own fit.
LEAST_TRIALS = 3


def agreement(
    recordings: Mapping[str, Sequence[SlipForce]], theta: FloatArray, inflation: float
) -> ResidualTest | None:
    """Return the test whether ``recordings``, trials by file, have their parameters in common.

    ``theta`` (p,) is the fit to all. None: there are not two of at least three trials.
    """
    whole = {name: trials for name, trials in recordings.items() if len(trials) >= LEAST_TRIALS}
    if len(whole) < 2:
        return None
    together = LugreModel([trial for trials in whole.values() for trial in trials])
    apart = {name: LugreModel(list(trials)) for name, trials in whole.items()}
    return agreement_of(together, apart, theta, lambda _: inflation)
