"""Tests whether recordings that are fitted together agree, or the rig changed between them.

The test compares one set of parameters for all recordings with one set for each recording. With
residuals of inflation t the statistic is n/t ln(S_together/S_apart). If nothing changed, it is a
chi-square number with p (K - 1) degrees of freedom: p parameters, K recordings (likelihood ratio;
the profiles of :mod:`rigd.analysis.profile` use the same scale).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.stats import chi2

from rigd.analysis.fit import fit
from rigd.analysis.friction import SlipForce
from rigd.analysis.report.rounding import probability
from rigd.analysis.result import FloatArray, ResidualTest
from rigd_analyses.lugre.model import LugreModel

#: A recording with fewer trials does not determine its own fit.
LEAST_TRIALS = 3
#: Repeats of one simulated rig give less in 1 of 100 pairs; what changed friction gives 1e-10.
LEVEL = 1e-3


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
    common = fit(together, theta)
    apart = sum(fit(LugreModel(list(trials)), common.theta).cost for trials in whole.values())
    effective = float(np.count_nonzero(together.mask)) / inflation
    statistic = effective * math.log(max(common.cost / apart, 1.0))
    p_value = float(chi2.sf(statistic, len(theta) * (len(whole) - 1)))
    agree = p_value > LEVEL
    return ResidualTest(
        "agreement of recordings",
        statistic,
        p_value,
        agree,
        f"One set of parameters fits {', '.join(whole)} as well as a set for each."
        if agree
        else f"{', '.join(whole)} disagree: a set of parameters for each fits better than chance "
        f"allows ({probability(p_value)}). Something changed between them; identify each by itself "
        "(`rigd identify --group-by recording`).",
    )
