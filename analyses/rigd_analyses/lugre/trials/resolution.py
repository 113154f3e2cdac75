"""Finds the count of an encoder, or the least step of a converter, from its readings."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rigd.analysis.result import FloatArray

ROUNDING = 1e-10  #: share of the largest step below which a step is one of the arithmetic
WHOLE = 0.02  #: so near a whole number of counts a step is one
MOST = 0.9  #: share of the steps that are whole counts; bridged samples make others


@dataclass(frozen=True)
class Rounding:
    """How a sensor rounds: its ``count`` or step, and of how many samples a reading is the mean."""

    count: float
    samples: float = 1.0

    @property
    def of_reading(self) -> float:
        """Return the count that alone would make the same noise; samples round independently."""
        return self.count / math.sqrt(self.samples)


def count(values: FloatArray) -> float:
    """Return the count of a quantised signal (n,); 0 if it never changes.

    It is the largest of which nearly all steps are whole multiples: samples that were bridged
    between two counts take smaller steps. Of a signal without counts it is the smallest step.
    """
    steps = np.abs(np.diff(values))
    steps = steps[steps > ROUNDING * np.max(steps, initial=0.0)]
    if not steps.size:
        return 0.0
    apart = ROUNDING * float(np.max(steps))
    sizes = np.unique(np.rint(steps / apart))
    found = np.unique(np.concatenate([sizes, np.diff(sizes)])) * apart
    for size in found[::-1]:
        exact = steps[np.abs(steps - size) < 2.0 * apart]
        size = float(np.min(exact)) if exact.size else float(size)
        counts = steps / size
        whole = (np.abs(counts - np.rint(counts)) < WHOLE) & (counts > 0.5)
        if np.mean(whole) >= MOST:
            return size
    return float(np.min(steps))
