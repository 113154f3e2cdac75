"""Finds a controller of a dry run whose output swings between its limits: too high gains."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from rigd.engine.sink import Rows

#: How often the output passes from one limit to the other, while the setpoint is constant, until
#: this counts as a swing that does not end. An output that is limited after a step passes once or
#: twice.
PASSAGES: Final = 10


@dataclass
class Swings:
    """Counts how often the output of one controller passes from one limit to the other."""

    setpoint: str
    """The field of its stream with its setpoint."""
    most: int = 0
    """Most passages while the setpoint was constant."""
    _passages: int = 0
    _side: float = 0.0
    _last: float = math.nan

    def take(self, rows: Rows) -> None:
        """Count in the next rows of its stream."""
        goal, side = rows[self.setpoint], rows["saturated"]
        moved = np.empty(len(goal), dtype=bool)
        moved[0] = goal[0] != self._last
        np.not_equal(goal[1:], goal[:-1], out=moved[1:])
        for row in np.flatnonzero(moved | (side != 0)):
            if moved[row]:
                self._passages, self._side = 0, 0.0
            if side[row] * self._side < 0:
                self._passages += 1
                self.most = max(self.most, self._passages)
            self._side = side[row] or self._side
        self._last = goal[-1]
