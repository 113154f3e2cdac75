"""Runs a filter cycle by cycle on the tables of the cycle."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from rigd.computed.observers.memory import Memory
from rigd.model.tables import Tables

if TYPE_CHECKING:
    from rigd.computed.observers.driver import ObserverConfig


class Runner:
    """A filter with its memory; :meth:`bind` connects it to the tables of the cycle."""

    def __init__(self, config: ObserverConfig) -> None:
        measured = len(config.measured)
        self._memory = Memory(
            len(config.inputs), measured, (len(config.channels) - measured - 1) // 2,
            config.period_ns, config.lost_ns,
        )  # fmt: skip
        self._names = (*config.inputs, *config.measured)
        self._words = np.full(1, math.nan).view(np.int64)
        self._filter = config.plan.filter(self._memory)
        self.step(0)  # loads the compiled function, or compiles it: no cycle has time for that
        self.begin()
        #: The newest row as a ring has it; the memory stays the same.
        self.packed: memoryview = self._memory.packed.data.cast("B")

    def bind(self, tables: Tables, row: str = "") -> None:
        """Connect to the tables of the cycle, which get the row ``row`` if they have it.

        A channel that the rig lacks is NaN.
        """
        self._words = tables.words
        self._memory.bind(tables, self._names, row)

    def begin(self) -> None:
        """Forget the state, and all readings: the filter begins at the next one."""
        self._memory.begin()

    def step(self, t_ns: int) -> None:
        """Compute the cycle at ``t_ns`` in the memory of the tables."""
        self._filter.step(t_ns, self._words)

    @property
    def row(self) -> list[float]:
        """The row of the last cycle: states, innovations, NIS and status."""
        row: list[float] = self._memory.row.tolist()
        return row
