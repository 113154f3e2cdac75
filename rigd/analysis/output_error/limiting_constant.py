"""Finds the constant that keeps an interval too wide, and how much better it must be known.

With ``C`` the inverse of the whole information, in which a constant of uncertainty u counts with
1/u^2, a quantity of gradient d has the variance d' C d. If the precision of constant j grows by D,
the variance falls by D (d' C e_j)^2 / (1 + D C_jj) (Sherman and Morrison, Annals of Mathematical
Statistics 21, 1950). With all constants exact, C is that of the other parameters alone.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rigd.analysis.fitting.uncertainty import scaled_pinv
from rigd.analysis.output_error.estimator import OutputErrorFit
from rigd.analysis.result import FloatArray

DOMINANT = 0.5  #: share of a variance from which its source is the reason


@dataclass(frozen=True)
class Owed:
    """``name`` is the constant that contributes most to an interval, ``share`` its part of it.

    The share is that of the variance. ``smaller`` is the factor by which its uncertainty must be
    smaller; None if the interval would be too wide even with this constant exact.
    """

    name: str
    share: float
    smaller: float | None

    @property
    def sentence(self) -> str:
        """Return which constant must be better known, and by how much."""
        part = f"{100 * self.share:.0f} % of its variance are owed to {self.name}"
        if self.smaller is None:
            return f"{part}; not only this constant must be better known."
        return f"{part}: its u must be {self.smaller:.2g} times smaller."


def owed_to_constants(
    found: OutputErrorFit,
    gradient: FloatArray,
    spread: float,
    limit: float,
    beside: Mapping[str, float],
) -> Owed | None:
    """Return which constant makes a quantity too uncertain; None if constants are not the reason.

    ``gradient`` (p,) is d(quantity)/d(scaled), ``spread`` the standard deviation that its interval
    stands for and ``limit`` the largest that is of use. ``beside`` are the standard deviations that
    constants add which are not fitted, by name. Constants are the reason if they make most of the
    variance, and the interval would be within the limit if they were exact.
    """
    if spread <= limit or not math.isfinite(spread):
        return None
    shared, precision = found.model.system.shared, found.model.precision
    known = [place for place, item in enumerate(shared) if math.isfinite(item.u)]
    of_constant = (found.inverse @ gradient)[known]
    among = found.inverse[np.ix_(known, known)]
    names = [*(shared[place].wording for place in known), *beside]
    added = np.square(list(beside.values()))
    shares = np.concatenate([of_constant**2 * precision[known], added])
    gained = float(of_constant @ scaled_pinv(among) @ of_constant) + float(np.sum(added))
    if float(np.sum(shares)) <= DOMINANT * spread**2 or spread**2 - gained > limit**2:
        return None
    worst, excess = int(np.argmax(shares)), spread**2 - limit**2
    if worst < len(known):
        room = float(of_constant[worst]) ** 2 - excess * float(among[worst, worst])
        stated = room * float(precision[known[worst]])
    else:
        stated = room = float(shares[worst]) - excess
    smaller = math.sqrt(1.0 + excess / stated) if room > 0.0 else None
    return Owed(names[worst], float(shares[worst]) / spread**2, smaller)
