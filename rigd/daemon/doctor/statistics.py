"""Computes statistics of a channel at rest: zero (mean), noise, and whether its value changes."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray


class Statistics:
    """Computes mean, standard deviation and range of values given in blocks, without storing them.

    Blocks are merged by the pairwise update of Chan, Golub and LeVeque (1983), eq. 2.1. Values that
    are not finite are counted and left out.
    """

    def __init__(self) -> None:
        self.count = 0
        self.not_finite = 0
        self.mean = math.nan
        self.low = math.inf
        self.high = -math.inf
        self.first = math.nan
        self.last = math.nan
        self.climbing = True  #: every value is above the one before it
        self._squares = 0.0  # sum of squared deviations from the mean

    @property
    def deviation(self) -> float:
        """Standard deviation (of the sample, n - 1), NaN for fewer than two values."""
        return math.sqrt(self._squares / (self.count - 1)) if self.count > 1 else math.nan

    @property
    def constant(self) -> bool:
        """Whether there were two values or more, all the same."""
        return self.count > 1 and self.low == self.high

    def add(self, values: NDArray[np.float64]) -> None:
        """Take values in the order in which they came, shape (n,)."""
        finite = values[np.isfinite(values)]
        self.not_finite += len(values) - len(finite)
        count = len(finite)
        if not count:
            return
        mean = float(finite.mean())
        squares = float(np.square(finite - mean).sum())
        if self.count == 0:
            self.mean, self._squares, self.first = mean, squares, float(finite[0])
        else:
            self.climbing = self.climbing and bool(finite[0] > self.last)
            apart, total = mean - self.mean, self.count + count
            self._squares += squares + apart * apart * self.count * count / total
            self.mean += apart * count / total
        self.climbing = self.climbing and bool(np.all(np.diff(finite) > 0))
        self.count += count
        self.low, self.high = (
            min(self.low, float(finite.min())),
            max(self.high, float(finite.max())),
        )
        self.last = float(finite[-1])
