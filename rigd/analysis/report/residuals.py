"""Computes the residuals of a fit in the form that the plots need."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import ndtri

from rigd.analysis.result import FloatArray, TrialFit

#: Points of a quantile-quantile plot: more would lie on top of one another.
QUANTILES = 240


def residual(trial: TrialFit) -> FloatArray:
    """Return measured minus fitted, (n,) in the trial's unit; NaN if a sample was not used."""
    return np.where(trial.used, trial.measured - trial.fitted, np.nan)


def pooled(trials: Sequence[TrialFit]) -> FloatArray:
    """Return the residuals of all samples that were used, one trial after the other."""
    if not trials:
        return np.empty(0)
    joined = np.concatenate([residual(trial) for trial in trials])
    return np.asarray(joined[np.isfinite(joined)], dtype=np.float64)


def end_to_end(trials: Sequence[TrialFit]) -> tuple[FloatArray, FloatArray, list[float]]:
    """Return time (s) and residual with the trials laid end to end, and the start of each.

    Only the residual is NaN if samples were not used; the starts are len(trials) + 1 times, the
    last of which is the end.
    """
    times: list[FloatArray] = []
    starts = [0.0]
    for trial in trials:
        own = trial.t_s - trial.t_s[0] if trial.t_s.size else trial.t_s
        times.append(own + starts[-1])
        starts.append(starts[-1] + (float(own[-1]) if own.size else 0.0))
    if not trials:
        return np.empty(0), np.empty(0), starts
    return np.concatenate(times), np.concatenate([residual(t) for t in trials]), starts


def normal_quantiles(values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return standard normal quantiles and those of ``values`` over its standard deviation.

    Plotting positions (k - 1/2) / n (Hazen). Empty if there are fewer than three values or they
    do not differ.
    """
    n = values.size
    scale = float(np.std(values)) if n > 2 else 0.0
    if scale == 0.0:
        return np.empty(0), np.empty(0)
    ordered = np.sort((values - values.mean()) / scale)
    rank = np.unique(np.linspace(0, n - 1, min(n, QUANTILES)).round().astype(np.intp))
    # A departure shows in the tails: keep every one of the outermost values.
    rank = np.union1d(rank, np.r_[0 : min(12, n), max(n - 12, 0) : n])
    return np.asarray(ndtri((rank + 0.5) / n), dtype=np.float64), ordered[rank]
