"""Tests whether a measure drifts from trial to trial, as of a rig that warms up.

The test is that of the slope of a line of least squares over the order of play: Student's t with
n - 2 degrees of freedom. Of normally distributed values without a trend it names 1 in 100.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

#: How often values without a trend are named.
FALSE_ALARM: Final = 0.01
#: Fewer trials do not tell a trend from scatter.
LEAST_TRIALS: Final = 4


@dataclass(frozen=True)
class Trend:
    """A drift that the test names: ``per_trial`` in SI, ``p`` how likely scatter shows as much."""

    per_trial: float
    p: float


def trend_of(values: Sequence[float]) -> Trend | None:
    """Return the trend of ``values`` in their order of play; None if the test names none."""
    n = len(values)
    if n < LEAST_TRIALS:
        return None
    from scipy.stats import t

    middle, mean = (n - 1) / 2, math.fsum(values) / n
    squares = n * (n * n - 1) / 12
    slope = math.fsum((at - middle) * value for at, value in enumerate(values)) / squares
    left = math.hypot(*(v - mean - slope * (at - middle) for at, v in enumerate(values)))
    total = math.hypot(*(v - mean for v in values))
    if total <= math.sqrt(n) * 1e-12 * abs(mean):  # all are one number
        return None
    u = left / math.sqrt((n - 2) * squares)
    p = 0.0 if u == 0.0 else 2 * float(t.sf(abs(slope) / u, n - 2))
    return Trend(slope, p) if p < FALSE_ALARM else None
