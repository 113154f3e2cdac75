"""Holds the tables of a filter, which its compiled functions share with the cycle."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray

from rigd.computed.observers import kernel
from rigd.computed.observers.kernel import Floats, Times, Words
from rigd.model.tables import NOWHERE, Tables


@dataclass(eq=False)
class Memory:
    """What a filter of l inputs and m measured channels keeps between cycles besides its state.

    ``given``, ``ages``, ``held``, ``current`` and ``clock`` are those of
    :func:`rigd.computed.observers.kernel.take`; ``row`` and ``packed`` are what
    :func:`rigd.computed.observers.kernel.publish` writes, for ``shown`` states.
    """

    inputs: int
    measured: int
    shown: int
    period_ns: int
    lost_ns: int
    given: Floats = field(init=False)
    ages: Times = field(init=False)
    held: Floats = field(init=False)
    current: Times = field(init=False)
    clock: Times = field(init=False)
    row: Floats = field(init=False)
    packed: Words = field(init=False)

    def __post_init__(self) -> None:
        count = self.inputs + self.measured
        self.given = np.full(count, math.nan)
        self.ages = np.zeros((kernel.AGES, count), dtype=np.int64)
        self.held = np.full(self.inputs, math.nan)
        self.current = np.zeros(count, dtype=np.int64)
        self.clock = np.full(kernel.CLOCK, NOWHERE, dtype=np.int64)
        self.row = np.full(2 * self.shown + self.measured + 2, math.nan)
        self.packed = np.zeros(2 * len(self.row) + 1, dtype=np.uint32)
        self.begin()

    def begin(self) -> None:
        """Forget the state, and all readings: the filter begins at the next one."""
        self.ages[kernel.USED], self.clock[: kernel.ROW] = kernel.NEVER, (0, kernel.NEVER, 0)
        self.held[:] = math.nan

    def bind(self, tables: Tables, names: Sequence[str], row: str = "") -> None:
        """Take the channels ``names`` from ``tables``.

        These get the row ``row`` if they have it.
        """
        sources = [tables.source(name) for name in names]
        self.ages[kernel.LATE] = [source.late_ns for source in sources]
        self.ages[kernel.FROM_VALUE] = [source.value for source in sources]
        self.ages[kernel.FROM_STAMP] = [source.stamp for source in sources]
        self.clock[kernel.ROW :] = tables.row(row)

    def join(self, own: Sequence[NDArray[np.float64]]) -> tuple[Times, Floats, Times]:
        """Move all tables, with copies of ``own``, into one memory for integers and one for floats.

        A compiled function takes 0.1 us for each array that it is given, and a filter has twenty to
        thirty. Returns the integers, the floats, and where each table of floats begins: ``given``,
        ``held``, ``row``, then ``own``; see :func:`rigd.computed.observers.kernel.cut_times` and
        :func:`rigd.computed.observers.kernel.cut`.
        """
        count = len(self.given)
        parts = [self.given, self.held, self.row, *own]
        ends = np.array([0, *accumulate(part.size for part in parts)], dtype=np.int64)
        floats = np.concatenate([np.ravel(part) for part in parts])
        clocks = [self.clock, np.array([self.period_ns, self.lost_ns], dtype=np.int64)]
        times = np.concatenate([self.ages.ravel(), self.current, *clocks])
        at = self.ages.size
        self.ages = times[:at].reshape(kernel.AGES, count)
        self.current, self.clock = times[at : at + count], times[at + count : -2]
        self.given, self.held, self.row = (floats[ends[k] : ends[k + 1]] for k in range(3))
        return times, floats, ends
