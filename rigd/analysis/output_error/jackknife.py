"""Computes what a fit becomes without each of its trials (jackknife; Miller, Biometrika 61, 1974).

An extension that is fitted to first order, or that stands for something else, leaves an error that
differs from trial to trial. Noise alone moves the parameters by their covariance; an error that
belongs to some trials moves them by more if these are left out. Nothing is refitted: a step is that
of Gauss and Newton, with the information of the other trials.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.stats import norm
from scipy.stats import t as student

from rigd.analysis.fitting.model import slopes
from rigd.analysis.fitting.uncertainty import scaled_pinv
from rigd.analysis.output_error.estimator import OutputErrorFit
from rigd.analysis.output_error.thresholds import THRESHOLDS
from rigd.analysis.result import FloatArray


def without_each_trial(found: OutputErrorFit) -> FloatArray:
    """Return the steps (trials, p) of the scaled parameters as each trial is left out in turn."""
    model, theta = found.model, found.fit.theta
    scale, known = slopes(model.parameters, theta), model.known.rows
    whole = found.information + known.T @ known
    gradient = found.slope + known.T @ model.prior_residuals(found.fit.scaled)
    steps = np.zeros((model.trials, len(theta)))
    for trial in range(model.trials):
        error, jacobian = model.linearise(trial, theta)
        here = model.columns(trial)
        jacobian = jacobian * scale[here]
        left, slope = whole.copy(), gradient.copy()
        left[np.ix_(here, here)] -= jacobian.T @ jacobian
        slope[here] -= jacobian.T @ error
        seen = np.flatnonzero(np.diag(left) > THRESHOLDS.min_own_share * np.diag(whole))
        steps[trial, seen] = -scaled_pinv(left[np.ix_(seen, seen)]) @ slope[seen]
    return steps


def jackknife_sd(moved: FloatArray) -> float:
    """Return the standard deviation of a quantity that leaving out each trial moves by (trials,).

    It stands for an interval of Student's t with a degree of freedom less than there are trials.
    """
    count = len(moved)
    if count < 2:
        return 0.0
    few = float(student.ppf(0.975, count - 1) / norm.ppf(0.975))
    return few * math.sqrt((count - 1) / count * float(np.sum(moved**2)))
