"""Decides whether a fit that ends at kinks of the cost has converged.

If something changes its sign at a value of the parameters (a force that lifts a wheel, a moment
that turns round), the cost has a kink there: a Newton step points across it, and the cost rises
from its first part on. The derivatives on both sides differ by multiples of the kink's normal n.
What is left to go is the Newton step within the kink, s - H^-1 n (n's) / (n'H^-1 n): the minimum
under the constraint n's = 0 (Nocedal and Wright, Numerical Optimization, 2006, sec. 16.1), of
several kinks under one constraint each. A valley so bent that the cost rises within the first
hundredths of the step counts as kinks: a fit goes no further in it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rigd.analysis.fit import fit, newton_step
from rigd.analysis.model import NormalEquations, scaled_bounds, slopes, to_natural
from rigd.analysis.output_error import CONVERGED, NEAR, ROUGH, OutputErrorFit, conclude
from rigd.analysis.result import FloatArray
from rigd.analysis.uncertainty import scaled_pinv

PROBE = 0.02  #: share of a step after which a kink shows
SHARES = (1.0, 0.3, 0.1, PROBE)  #: of the step within a kink, until the cost falls
MOST_KINKS = 4  #: that meet in one point
MOST_MOVES = 5  #: along kinks


def along_kinks(found: OutputErrorFit, block: int) -> OutputErrorFit:
    """Return ``found``, or if it ends at kinks of the cost, the minimum within them.

    Its ``left`` is then what is left to go there. ``block`` is the longest correlation of the
    scores that is accounted for, in samples.
    """
    for _ in range(MOST_MOVES):
        if found.converged:
            break
        step = _within_kinks(found)
        left = step / np.sqrt(np.maximum(np.diag(found.covariance), np.finfo(float).tiny))
        if np.max(np.abs(left)) <= CONVERGED:
            return replace(found, left=left)
        model = found.model
        targets = (to_natural(model.parameters, _inside(found, k * step)) for k in SHARES)
        lower = next((t for t in targets if model.cost(t) < found.fit.cost), None)
        if lower is None:
            break
        moved = fit(model, lower, relative_decrease=ROUGH, damping=NEAR, thorough=True)
        found = conclude(model, moved, block)
    return found


def _within_kinks(found: OutputErrorFit) -> FloatArray:
    """Return the Newton step (p,) that remains within the kinks that stand in its way.

    The cost falls along it, or it is less than what counts as converged.
    """
    model, known = found.model, found.model.known.rows
    gradient = found.slope + known.T @ model.prior_residuals(found.fit.scaled)
    now = NormalEquations(found.fit.cost, gradient, found.information + known.T @ known)
    step = whole = newton_step(now, model, found.fit)
    sds = np.sqrt(np.maximum(np.diag(found.covariance), np.finfo(float).tiny))
    normals: list[FloatArray] = []
    for _ in range(MOST_KINKS):
        ahead = to_natural(model.parameters, _inside(found, PROBE * step))
        if np.max(np.abs(step) / sds) <= CONVERGED or model.cost(ahead) < found.fit.cost:
            break
        normals.append(_normal(found, ahead))
        across = np.array(normals)
        along = found.inverse @ across.T
        step = whole - along @ (scaled_pinv(across @ along) @ (across @ whole))
    return step


def _normal(found: OutputErrorFit, ahead: FloatArray) -> FloatArray:
    """Return the normal (p,), scaled, of the kink between ``found`` and ``ahead`` (p,), natural.

    Beyond a kink the derivatives of all outputs differ by multiples of it: it is the leading
    singular vector of the difference, in standard errors of the parameters.
    """
    model, sds = found.model, np.sqrt(np.maximum(np.diag(found.inverse), 0.0))
    squares = np.zeros((len(sds), len(sds)))
    here_by, ahead_by = (slopes(model.parameters, at) for at in (found.fit.theta, ahead))
    for trial in range(model.trials):
        own = model.columns(trial)
        turned = model.linearise(trial, ahead)[1] * ahead_by[own]
        turned -= model.linearise(trial, found.fit.theta)[1] * here_by[own]
        turned *= sds[own]
        squares[np.ix_(own, own)] += turned.T @ turned
    leading = np.linalg.eigh(squares)[1][:, -1]
    return np.asarray(leading / np.maximum(sds, np.finfo(float).tiny))


def _inside(found: OutputErrorFit, step: FloatArray) -> FloatArray:
    """Return the scaled parameters (p,) after ``step``, within their bounds."""
    low, high = scaled_bounds(found.model.parameters)
    return np.clip(found.fit.scaled + step, low, high)
