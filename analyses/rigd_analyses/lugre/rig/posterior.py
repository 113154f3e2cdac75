"""Samples the posterior of the friction parameters of an output-error fit."""

from __future__ import annotations

import numpy as np

from rigd.analysis.fitting.identifiability import Z_95
from rigd.analysis.fitting.profile import axis
from rigd.analysis.output_error.marginal import Marginal
from rigd.analysis.posterior.draws import Sampled, sample_posterior
from rigd.analysis.posterior_result import Posterior
from rigd_analyses.lugre.model import MU_C, PARAMETERS
from rigd_analyses.lugre.quantities import BY_COVARIANCE, COULOMB, STATIC, STRIBECK_SPEED
from rigd_analyses.lugre.rig.found import FRICTION, Found


def friction_posterior(found: Found, given: frozenset[str], seed: int) -> Posterior:
    """Return the posterior of the six friction parameters, all other unknowns eliminated.

    ``given`` are the names that the table gives a number for. What the intervals of the table
    hold besides the likelihood, filter of the current and load, is joined here too.
    """
    ridge = [
        point
        for line in found.scans.values()
        if line.low is None or line.high is None
        for point in line.accepted
    ]
    density = Marginal(found.whole, FRICTION, (*found.whole.others, *ridge))
    quantities = []
    for quantity in (STRIBECK_SPEED, COULOMB, STATIC, *BY_COVARIANCE):
        direction = (
            np.array(quantity.direction, dtype=np.float64)
            if quantity.index is None
            else axis(FRICTION, quantity.index)
        )
        box = PARAMETERS[MU_C if quantity is STATIC else int(np.flatnonzero(direction)[0])]
        reach = Z_95 * float(np.hypot(found.method(quantity), found.weight(quantity)))
        quantities.append(
            Sampled(
                quantity.name, quantity.symbol, quantity.unit, direction, box.low, box.high, reach,
                quantity.name in given,
            )
        )  # fmt: skip
    return sample_posterior(density, quantities, seed, density.tempering)
