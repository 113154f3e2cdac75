"""Holds the tables of a filter, which its compiled functions share with the cycle."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rigd.observers.kernel import NEVER


@dataclass(eq=False)
class Memory:
    """What a filter of l inputs and m measured channels keeps between cycles besides its state.

    ``given``, ``ages``, ``held``, ``current`` and ``clock`` are those of
    :func:`rigd.observers.kernel.take`; ``row`` is what :func:`rigd.observers.kernel.publish`
    writes, for ``shown`` states.
    """

    inputs: int
    measured: int
    shown: int
    period_ns: int
    lost_ns: int
    given: NDArray[np.float64] = field(init=False)
    ages: NDArray[np.int64] = field(init=False)
    held: NDArray[np.float64] = field(init=False)
    current: NDArray[np.int64] = field(init=False)
    clock: NDArray[np.int64] = field(init=False)
    row: NDArray[np.float64] = field(init=False)

    def __post_init__(self) -> None:
        count = self.inputs + self.measured
        self.given = np.full(count, math.nan)
        self.ages = np.zeros((3, count), dtype=np.int64)
        self.held = np.full(self.inputs, math.nan)
        self.current = np.zeros(count, dtype=np.int64)
        self.clock = np.zeros(3, dtype=np.int64)
        self.row = np.full(2 * self.shown + self.measured + 2, math.nan)
        self.begin()

    def begin(self) -> None:
        """Forget the state, and all readings: the filter begins at the next one."""
        self.ages[2], self.clock[:] = NEVER, (0, NEVER, 0)
        self.held[:] = math.nan
