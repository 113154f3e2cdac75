"""Computes standard errors that hold even if residuals are correlated or the model is imperfect.

Residuals of a smoothed, vibrating measurement are correlated over tens of milliseconds; the usual
covariance s^2 (J'J)^-1 then gives standard errors that are two to three times too small. The module
has three remedies:

- the sandwich covariance with block sums of the scores (HAC);
- the jackknife over whole trials;
- the inflation factor, from the integrated autocorrelation time of the residuals.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from rigd.analysis.fitting.fit import Fit, fit
from rigd.analysis.fitting.model import Model, scaled_bounds, slopes
from rigd.analysis.result import FloatArray

BOUND_TOLERANCE = 1e-6  #: share of the box within which a parameter sits on its bound
RELATIVE_RANK = 1e-12  #: eigenvalues of the scaled information below this share carry nothing


@dataclass(frozen=True, eq=False)
class Covariance:
    """Covariances (p, p) in scaled coordinates; rows of a parameter on its bound are zero.

    ``white`` assumes independent residuals, ``coloured`` is the sandwich. ``on_bound`` (p,).
    ``residual_sd`` is dimensionless like the residuals.
    """

    white: FloatArray
    coloured: FloatArray
    on_bound: tuple[bool, ...]
    residual_sd: float


def covariance(model: Model, fitted: Fit, block: int) -> Covariance:
    """Return white and block-HAC covariance at ``fitted``, with blocks of ``block`` samples.

    Blocks never span two trials. The coloured one is scaled by n_b / (n_b - p) for few blocks.
    """
    theta = fitted.theta
    weights = model.mask if fitted.weights is None else model.mask * fitted.weights
    jacobian = model.jacobian(theta) * slopes(model.parameters, theta)
    residuals = model.residuals(theta)
    on_bound = bounds_reached(model, fitted.scaled)
    free = np.flatnonzero(~np.array(on_bound))
    used = int(np.count_nonzero(model.mask))
    variance = float(np.sum(weights * residuals**2)) / max(used - free.size, 1)

    information = (jacobian * weights[:, None]).T @ jacobian
    inverse = np.zeros_like(information)
    inverse[np.ix_(free, free)] = scaled_pinv(information[np.ix_(free, free)])
    scores = jacobian * (weights * residuals)[:, None]
    sums = [_block_sums(scores[part], model.mask[part], block) for part in model.trial_slices]
    blocks = np.concatenate(sums)
    factor = len(blocks) / max(len(blocks) - free.size, 1)
    return Covariance(
        white=variance * inverse,
        coloured=factor * inverse @ (blocks.T @ blocks) @ inverse,
        on_bound=on_bound,
        residual_sd=float(np.sqrt(variance)),
    )


def bounds_reached(model: Model, scaled: FloatArray) -> tuple[bool, ...]:
    """Return which parameters sit on a bound of their box."""
    low, high = scaled_bounds(model.parameters)
    margin = BOUND_TOLERANCE * (high - low)
    return tuple(bool(b) for b in (scaled - low <= margin) | (high - scaled <= margin))


def scaled_pinv(information: FloatArray) -> FloatArray:
    """Return the inverse of a symmetric matrix after scaling its diagonal to one.

    Directions below ``RELATIVE_RANK`` are dropped, never inverted into huge numbers.
    """
    if information.size == 0:
        return information
    scale = np.sqrt(np.maximum(np.diag(information), np.finfo(float).tiny))
    unit = information / np.outer(scale, scale)
    inverse = np.linalg.pinv(unit, rcond=RELATIVE_RANK, hermitian=True)
    return np.asarray(inverse / np.outer(scale, scale), dtype=np.float64)


def no_less(varied: FloatArray, least: FloatArray) -> FloatArray:
    """Return the covariance ``varied`` (p, p), in no direction less than ``least`` (p, p).

    Both are compared in the directions in which they differ most (simultaneous diagonalisation).
    """
    scale = np.sqrt(np.maximum(np.diag(least), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(least / np.outer(scale, scale))
    known = values > RELATIVE_RANK * values[-1]
    root = (vectors[:, known] * np.sqrt(values[known])) * scale[:, None]
    whiten = (vectors[:, known] / np.sqrt(values[known])) / scale[:, None]
    ratio, directions = np.linalg.eigh(whiten.T @ varied @ whiten)
    turned = root @ directions
    return np.asarray((turned * np.maximum(ratio, 1.0)) @ turned.T)


def correlation(cov: FloatArray) -> FloatArray:
    """Return the correlation matrix of ``cov``; parameters without variance correlate with none."""
    sd = np.sqrt(np.diag(cov))
    safe = np.where(sd > 0.0, sd, 1.0)
    out = cov / np.outer(safe, safe)
    np.fill_diagonal(out, 1.0)
    return np.asarray(np.clip(out, -1.0, 1.0))


def autocorrelation_time(
    residuals: FloatArray, mask: FloatArray, trial_slices: Sequence[slice], max_lag: int
) -> float:
    """Return the variance inflation 1 + 2 sum(rho_k) of coloured residuals, at least 1.

    Divide the sample count by it for the effective one. The sum runs over pairs of lags as long as
    they are positive, and no pair counts more than the one before (the initial monotone sequence
    of Geyer 1992). Summed over all lags instead, the swings of a vibration cancel the memory that
    the smoothing leaves, and plainly coloured residuals come out as white. Residuals are not
    centred: what the model leaves in one trial is memory too.
    """
    pieces = [residuals[part][mask[part] > 0.0] for part in trial_slices]
    products = np.zeros(max_lag + 1)
    for r in pieces:
        for lag in range(min(max_lag, len(r) - 1) + 1):
            products[lag] += float(np.dot(r[: len(r) - lag], r[lag:]))
    if products[0] <= 0.0:
        return 1.0
    rho = products / products[0]
    pairs = rho[0 : max_lag - max_lag % 2 : 2] + rho[1 : max_lag - max_lag % 2 + 1 : 2]
    negative = np.flatnonzero(pairs <= 0.0)
    positive = pairs if negative.size == 0 else pairs[: int(negative[0])]
    return max(1.0, 2.0 * float(np.sum(np.minimum.accumulate(positive))) - 1.0)


def leave_one_trial_out(model: Model, fitted: Fit) -> tuple[FloatArray, ...]:
    """Return the natural parameters refitted without each trial in turn, from ``fitted``."""
    thetas = []
    for part in model.trial_slices:
        weights = np.ones_like(model.mask) if fitted.weights is None else fitted.weights.copy()
        weights[part] = 0.0
        thetas.append(fit(model, fitted.theta, weights=weights).theta)
    return tuple(thetas)


def jackknife_sd(
    function: Callable[[FloatArray], FloatArray], thetas: Sequence[FloatArray]
) -> FloatArray:
    """Return the jackknife standard error of ``function(theta)`` over left-out trials."""
    values = np.array([function(theta) for theta in thetas])
    count = len(values)
    deviations = values - values.mean(axis=0)
    return np.asarray(np.sqrt((count - 1) / count * np.sum(deviations**2, axis=0)))


def delta_sd(gradient: FloatArray, cov: FloatArray) -> FloatArray:
    """Return sqrt(diag(G C G')) for G (m, p) to scaled parameters: (m,)."""
    return np.asarray(np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", gradient, cov, gradient), 0.0)))


def _block_sums(scores: FloatArray, mask: FloatArray, block: int) -> FloatArray:
    kept = scores[mask > 0.0]
    edges = np.arange(0, len(kept), block)
    if len(edges) == 0:
        return np.zeros((0, scores.shape[1]))
    return np.asarray(np.add.reduceat(kept, edges, axis=0))
