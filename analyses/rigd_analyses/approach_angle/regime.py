"""Decides for both methods whether the wheel slid, rolled, or did both."""

from __future__ import annotations

import numpy as np

from rigd_analyses.approach_angle.raw.run_data import FloatArray, Regime

#: Corrected slip w R/(V cos(alpha)) - 1 from which on all of the contact slides. Rubber needs some
#: slip to do so, 2 kappa g/sigma_0 of w R with a patch that renews itself every 1/kappa of travel:
#: 0.07 at a limit of 0.19, 0.24 at one of 0.59 with the values of the simulated rig; tyres have
#: the maximum of their force at 0.1 to 0.2.
SLIDING_SLIP = 0.25
#: Share of the samples that must agree for a run to be called one or the other.
CLEAR = 0.9


def regime_of(slip_corrected: FloatArray) -> Regime:
    """Return the regime of a segment from its corrected slip, (n,) with n > 0."""
    share = float(np.mean(slip_corrected >= SLIDING_SLIP))
    if share >= CLEAR:
        return Regime.SLIDING
    return Regime.ROLLING if share <= 1.0 - CLEAR else Regime.MIXED
