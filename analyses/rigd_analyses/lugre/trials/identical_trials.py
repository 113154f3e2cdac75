"""Refuses trials that are all the same test, whatever the method."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rigd.analysis import DataError
from rigd.analysis.result import FloatArray
from rigd_analyses.lugre.trials.trial import LugreTrial

ALIKE = 0.05  #: relative difference of currents, or loads, up to which trials are one test
MEAN_OF = 20  #: samples


def refuse_alike(parts: Sequence[tuple[LugreTrial, slice]]) -> None:
    """Refuse trials of one and the same test.

    In a single motion, other friction with other constants moves the rig alike: three trials of
    0.45 A gave sigma_2 20 % too low, within intervals of 4 %. By slip-force, which takes the
    constants as exact, three of 0.25 A on stone gave mu_c 64 % too low, within 6 %.

    Raises:
        DataError: current and load are the same in all of them.
    """
    first, part = parts[0]
    mine = _course(first, part)
    apart = 0.0
    for trial, other in parts[1:]:
        its = _course(trial, other)
        count = min(len(mine), len(its))
        rms = np.sqrt(np.mean((its[:count] - mine[:count]) ** 2) / np.mean(mine[:count] ** 2))
        apart = max(apart, float(rms), abs(trial.load / first.load - 1.0))
    if apart < ALIKE:
        raise DataError(
            f"all {len(parts)} trials are the same test: their currents differ by "
            f"{100.0 * apart:.2g} % at most, and friction in a single motion is explained by many "
            "parameters",
            hint="record trials with other currents too",
        )


def _course(trial: LugreTrial, part: slice) -> FloatArray:
    """Return the current over the part, as means over so many samples that little noise is left."""
    current = trial.motor_current_a[part]
    whole = len(current) // MEAN_OF * MEAN_OF
    return np.asarray(np.mean(current[:whole].reshape(-1, MEAN_OF), axis=1))
