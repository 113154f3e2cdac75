"""Finds a controller of a dry run that ends at a limit, and no nearer to its setpoint than before.

In the run it gives up after `stuck_after`. Here gains of the wrong sign show in shorter steps too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from rigd.computed.controllers.driver import ControllerConfig
from rigd.engine.sink import Rows
from rigd.model.rows import TIME_FIELD
from rigd.model.units import format_quantity

#: A shorter time at a limit shows nothing: perhaps no second reading came in it.
_LEAST_NS: Final = 100_000_000
#: Part of the error by which the measured value must have come nearer, as in the cycle.
_PROGRESS_PART: Final = 0.01


@dataclass
class AtLimit:
    """Judges each attempt of one controller: until it is off, or its setpoint moves anew."""

    config: ControllerConfig
    reason: str = ""
    """What the first attempt did that failed, as a sentence; "" if none did."""
    # Rows: of the begin of the attempt; since when the output is at a limit; the newest.
    _began: Any = None
    _reached: Any = None
    _last: Any = None
    _moved: bool = False

    def take(self, rows: Rows) -> None:
        """Follow the next rows of its stream."""
        goal, active, side = rows[f"{self._short}_setpoint"], rows["active"], rows["saturated"]
        last = rows[0] if self._last is None else self._last
        moved = np.diff(goal, prepend=last[f"{self._short}_setpoint"]) != 0.0
        anew = moved & ~np.concatenate(([self._moved], moved[:-1]))
        turns = np.diff(active, prepend=last["active"]) != 0.0
        sides = np.diff(side, prepend=last["saturated"]) != 0.0
        if self._last is None:
            turns[0] = True
        for at in np.flatnonzero(anew | turns | sides):
            if anew[at] or turns[at]:
                self._judge(rows[at - 1] if at else self._last)
                self._began = rows[at].copy() if active[at] else None
            if sides[at] or turns[at]:
                self._reached = rows[at].copy()
        self._last, self._moved = rows[-1].copy(), bool(moved[-1])

    def end(self) -> str:
        """Return :attr:`reason`, with an attempt that still goes on at the end judged too."""
        self._judge(self._last)
        return self.reason

    @property
    def _short(self) -> str:
        return self.config.measured.partition(".")[2]

    def _judge(self, end: Any) -> None:
        """Note an attempt that was at a limit to its ``end``, for at least half of its time."""
        began, config = self._began, self.config
        if self.reason or began is None or not end["saturated"]:
            return
        took_ns = int(end[TIME_FIELD] - began[TIME_FIELD])
        held_ns = min(int(end[TIME_FIELD] - self._reached[TIME_FIELD]), took_ns)
        # The setpoint may move away faster than the rig can follow: the measured value counts.
        error = float(end["error"])
        nearer = math.copysign(1.0, error) * float(end[self._short] - began[self._short])
        if 2 * held_ns < max(took_ns, 2 * _LEAST_NS) or nearer >= _PROGRESS_PART * abs(error):
            return
        output = format_quantity(float(end["output"]), config.output_unit)
        away = format_quantity(abs(error), config.unit)
        self.reason = (
            f"controller {config.name}: {config.output} was at its limit of {output} for the last "
            f"{held_ns * 1e-9:.3g} s of {took_ns * 1e-9:.3g} s, and {config.measured} came no "
            f"nearer to its setpoint, which is {away} away: the gains have the wrong sign, or the "
            "setpoint is out of reach"
        )
