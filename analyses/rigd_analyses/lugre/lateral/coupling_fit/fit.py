"""Fits the rig and the coupling of its lateral motion to guide and bearings, as one model.

Where |M_D| meets |G| h, or a row of rollers lifts, the slope of the loads jumps, and that of the
cost with it (a kink): a Newton step points across the kink, and a fit may stop there. The outputs
depend on the coupling through the friction of the guide in each trial, and on that smoothly. So the
outputs are linearised in these frictions, and the coupling is fitted to them with all of its kinks
(composite optimisation: Fletcher, Practical Methods of Optimization, 2nd ed. 1987, ch. 14). This is
repeated until nothing is gained.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rigd.analysis import DataError
from rigd.analysis.fitting.fit import Affine, Fit, fit
from rigd.analysis.fitting.model import to_scaled
from rigd.analysis.output_error.estimator import NEAR, OutputErrorFit, conclude, diverged
from rigd.analysis.output_error.system import Diverged, System, Unknown
from rigd.analysis.output_error.whitened_residuals import OutputErrorModel
from rigd.analysis.result import FloatArray
from rigd_analyses.lugre.lateral.coupling_fit.loads import Loads, loads_at, plain
from rigd_analyses.lugre.lateral.coupling_fit.problem import Reduced, optima
from rigd_analyses.lugre.lateral.system import LateralSystem
from rigd_analyses.lugre.lateral.thresholds import LATERAL
from rigd_analyses.lugre.rig.system import GUIDE

MOST_ROUNDS = 12
POLISHING = 20  #: iterations of a fit that holds the coupling
MOST_ENDS = 6  #: optima of the frictions of the trials that are tried


@dataclass(frozen=True, eq=False)
class Coupled:
    """The fit of the coupled rig, and what the data know of the frictions at its end."""

    whole: OutputErrorFit
    loads: Loads
    coupling: FloatArray  #: (8,): guide friction, then the parameters of the coupling

    def reduced(self, system: LateralSystem, at_m_s: float | None = None) -> Reduced:
        """Return the problem of the coupling of ``system`` alone."""
        return reduced(self.loads, system, self.whole.model.system, at_m_s)


def reduced(
    loads: Loads, system: LateralSystem, whole: System, at_m_s: float | None = None
) -> Reduced:
    """Return the problem of the coupling of ``system`` alone; ``whole`` may have more in it."""
    return Reduced(loads, system, known(whole, system), len(loads.model.mask), at_m_s)


def known(whole: System, system: LateralSystem) -> tuple[Unknown, ...]:
    """Return the unknowns (8,) of the coupling in ``whole``: guide friction first."""
    first, own = len(system.rig.shared), len(system.shared)
    return (whole.shared[GUIDE], *whole.shared[first:own])


def couple(
    system: LateralSystem, whole: System, loads: Loads, starts: Sequence[FloatArray], block: int
) -> Coupled:
    """Return the fit of ``whole`` from the best of ``starts``, each a coupling (8,), natural.

    ``whole`` is ``system``, perhaps with something added. The noise is that of ``loads``.
    """
    model = OutputErrorModel(whole, loads.model.noise)
    problem = reduced(loads, system, whole)
    coupling = np.asarray(min(starts, key=problem.cost))
    cost, theta = _polished(system, model, problem, coupling)
    for count in range(MOST_ROUNDS):
        loads = loads_at(model, theta, block)
        problem = reduced(loads, system, whole)
        if count == 0:  # far from the first loads there may be other optima
            starts = [*starts, *(end.theta for end in optima(problem)[:MOST_ENDS])]
        ends = [fitted(problem, start) for start in (coupling, *starts)]
        target = min(ends, key=lambda end: end.cost).theta
        point = _point(problem, target)
        with np.errstate(over="ignore", invalid="ignore"):
            found = model.cost(point)
        if not found < cost - LATERAL.min_gain_round_ln_l:  # the step of all else may be too long
            found, point = _polished(system, model, problem, target)
        gained = cost - found
        if gained > 0.0:
            cost, theta, coupling = found, point, target
        if gained < LATERAL.min_gain_round_ln_l:
            break
    return Coupled(_concluded(model, theta, cost, max(gained, 0.0), block), loads, coupling)


def fitted(problem: Reduced, start: FloatArray) -> Fit:
    """Return the fit of a coupling from ``start`` (8,), natural."""
    return fit(
        problem,
        start,
        thorough=True,
        relative_decrease=LATERAL.min_gain_coupling_ln_l / problem.samples,
    )


def _polished(
    system: LateralSystem, model: OutputErrorModel, problem: Reduced, coupling: FloatArray
) -> tuple[float, FloatArray]:
    """Return the lowest cost with a coupling (8,), and all parameters (p,) there; both natural.

    All else begins where it goes with the coupling. That is linear: if the rig has no motion so far
    off, as with few trials, all else begins where the frictions of the trials were found.

    Raises:
        Diverged: the cost of a trial is not finite there either.
    """
    theta = _point(problem, coupling)
    with np.errstate(over="ignore", invalid="ignore"):
        if not math.isfinite(model.normal_equations(theta).cost):
            theta = _point(problem, coupling, problem.loads.forces_n)
    held = np.zeros(len(theta), dtype=np.bool_)
    held[GUIDE] = held[len(system.rig.shared) : len(system.shared)] = True
    free = np.flatnonzero(~held)
    offset = np.where(held, to_scaled(model.parameters, theta), 0.0)
    affine = Affine(offset, np.eye(len(theta))[:, free], tuple(int(k) for k in free))
    with np.errstate(over="ignore", invalid="ignore"):
        try:
            end = fit(
                model, theta, affine=affine, damping=NEAR,
                relative_decrease=LATERAL.min_gain_coupling_ln_l / len(model.mask),
                max_iterations=POLISHING, thorough=True, ridges=True,
            )  # fmt: skip
        except DataError as error:
            raise Diverged(diverged(model, theta)) from error
    return end.cost, end.theta


def _point(
    problem: Reduced, coupling: FloatArray, forces_n: FloatArray | None = None
) -> FloatArray:
    """Return all parameters (p,), natural, with a coupling (8,).

    All else goes with its frictions of the trials, or with ``forces_n`` (trials,).
    """
    forces_n = problem.forces(coupling)[0] if forces_n is None else forces_n
    shared, added, local = problem.loads.under(forces_n)
    shared[GUIDE] = coupling[0]
    return np.concatenate([shared, coupling[1:], added, local.ravel()])


def _concluded(
    model: OutputErrorModel, theta: FloatArray, cost: float, gained: float, block: int
) -> OutputErrorFit:
    """Return the fit that ends at ``theta`` (p,), natural; the last round gained so much ln L.

    Within kinks a Newton step says nothing: what is left counts by what a round gains.
    """
    scaled, count = to_scaled(model.parameters, theta), len(theta)
    end = Fit(
        theta, scaled, theta, cost, MOST_ROUNDS, MOST_ROUNDS, gained < LATERAL.min_gain_round_ln_l,
        np.zeros((count, count)),
    )  # fmt: skip
    whole = conclude(model, end, block)
    most = math.sqrt(2.0 * max(gained, 0.0))
    whole = replace(whole, left=np.clip(whole.left, -most, most))
    return replace(whole, fit=replace(end, information=whole.information))


def coupled(whole: OutputErrorFit, block: int) -> Coupled:
    """Return what the data know of the frictions at the end of a fit of the coupled rig."""
    return Coupled(whole, loads_at(whole.model, whole.fit.theta, block), coupling_of(whole))


def coupling_of(whole: OutputErrorFit) -> FloatArray:
    """Return guide friction and coupling (8,) at the end of a fit of the coupled rig."""
    system, theta = plain(whole.model.system), whole.fit.theta
    return np.concatenate([theta[[GUIDE]], theta[len(system.rig.shared) : len(system.shared)]])
