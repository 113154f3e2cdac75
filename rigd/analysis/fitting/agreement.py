"""Tests whether recordings that are fitted together agree, or the rig changed between them.

The test compares one set of parameters for all recordings with one set for each recording. With
residuals of inflation t the statistic is n/t ln(S_together/S_apart). If nothing changed, it is a
chi-square number with p (K - 1) degrees of freedom: p parameters, K recordings (likelihood ratio;
the profiles of :mod:`rigd.analysis.fitting.profile` use the same scale).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np
from scipy.stats import chi2

from rigd.analysis.fitting.fit import fit
from rigd.analysis.fitting.model import Model
from rigd.analysis.report.rounding import probability
from rigd.analysis.result import FloatArray, ResidualTest

#: Repeats of one simulated rig give less in 1 of 100 pairs; what changed friction gives 1e-10.
MAX_P_VALUE_RECORDINGS = 1e-3


def agreement(
    together: Model,
    apart: Mapping[str, Model],
    theta: FloatArray,
    inflation: Callable[[FloatArray], float],
) -> ResidualTest:
    """Return the test whether the models ``apart``, by recording, have their parameters in common.

    ``together`` has the trials of all of them in the same order, and ``theta`` (p,) is near its
    best fit. ``inflation`` is that of the residuals (n,) of all trials.
    """
    common = fit(together, theta)
    own = {name: fit(model, common.theta) for name, model in apart.items()}
    error = np.concatenate([model.residuals(own[name].theta) for name, model in apart.items()])
    effective = float(np.count_nonzero(together.mask)) / inflation(error)
    statistic = effective * math.log(max(common.cost / sum(x.cost for x in own.values()), 1.0))
    p_value = float(chi2.sf(statistic, len(theta) * (len(apart) - 1)))
    agree = p_value > MAX_P_VALUE_RECORDINGS
    return ResidualTest(
        "agreement of recordings",
        statistic,
        p_value,
        agree,
        f"One set of parameters fits {', '.join(apart)} as well as a set for each."
        if agree
        else f"{', '.join(apart)} disagree: a set of parameters for each fits better than chance "
        f"allows ({probability(p_value)}). Something changed between them; identify each by itself "
        "(`rigd identify --group-by recording`).",
    )
