"""Finds gains of the wrong sign in a dry run, also if they are too low to reach a limit in it.

A measured value that leaves its setpoint may do so in spite of its controller: a load grows, or the
rig still moves. So the same is played once more, with the gains turned around from the moment at
which the value began to leave: until then both are the same. If it comes nearer now, the sign was
wrong.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from rigd.computed.controllers.driver import ControllerConfig
from rigd.engine.clock import Clock
from rigd.engine.cycle.cycle import Cycle
from rigd.engine.play.player import Outcome
from rigd.engine.process.in_process import InProcessHost
from rigd.engine.sink import Rows, Sink
from rigd.model.rows import TIME_FIELD
from rigd.model.severity import Severity
from rigd.model.units import format_quantity
from rigd.procedure.program import Recorded

if TYPE_CHECKING:
    from rigd.computed.controllers.bank import Bank

#: What is clear: a part of the error, and so many times the noise of the measured value. By that
#: the value must have left its setpoint, and be nearer to it with the gains turned around.
_CLEAR_PART: Final = 0.05
_CLEAR_NOISES: Final = 12.0


@dataclass(frozen=True)
class Departure:
    """A time in which a measured value went away from its setpoint, on one side of it."""

    begin_ns: int
    end_ns: int
    error: float  #: at the end
    moved: float  #: by how much it went away, more than what is clear
    clear: float


@dataclass
class Departures:
    """Finds the largest departure in the stream of one controller."""

    config: ControllerConfig
    largest: Departure | None = None
    # Rows: at which the error got its present sign; the newest.
    _began: Any = None
    _last: Any = None
    _moving: bool = False
    # Of the changes of the measured value from row to row: how many, and their squares.
    _changes: int = 0
    _squares: float = 0.0

    def take(self, rows: Rows) -> None:
        """Follow the next rows of its stream."""
        if self._last is not None:
            rows = np.concatenate((self._last[np.newaxis], rows))
        active, goal = rows["active"], rows[f"{self._short}_setpoint"]
        moving = np.concatenate(([self._moving], np.diff(goal) != 0.0))
        changes = np.diff(rows[self._short])[(active[1:] != 0.0) & (active[:-1] != 0.0)]
        self._changes += int(np.count_nonzero(changes))
        self._squares += float(np.square(changes).sum())
        anew = np.flatnonzero((moving[1:] > moving[:-1]) | (np.diff(active) != 0.0)) + 1
        side = np.sign(rows["error"])
        crossed = np.flatnonzero(side[1:] != side[:-1]) + 1
        if self._last is None:
            anew = np.concatenate(([0], anew))
        for at, until in zip([0, *anew], [*anew, len(rows)], strict=True):
            if at in anew:
                self._judge(rows[at - 1] if at else None)
                self._began = rows[at].copy() if active[at] else None
            last = np.searchsorted(crossed, until) - 1
            if self._began is not None and last >= 0 and crossed[last] > at:
                self._began = rows[crossed[last]].copy()
        self._last, self._moving = rows[-1].copy(), bool(moving[-1])

    def end(self) -> Departure | None:
        """Return the largest departure, one that goes on at the end included; None if none."""
        self._judge(self._last)
        return self.largest

    @property
    def _short(self) -> str:
        return self.config.measured.partition(".")[2]

    def _judge(self, end: Any) -> None:
        """Keep what happened until the row ``end``, if it is a departure and the largest."""
        began = self._began
        if began is None or end is None:
            return
        error = float(end["error"])
        moved = math.copysign(1.0, error) * float(began[self._short] - end[self._short])
        noise = math.sqrt(0.5 * self._squares / max(self._changes, 1))
        clear = max(_CLEAR_PART * abs(error), _CLEAR_NOISES * noise)
        if moved > max(clear, 0.0 if self.largest is None else self.largest.moved):
            times = int(began[TIME_FIELD]), int(end[TIME_FIELD])
            self.largest = Departure(*times, error, moved, clear)


@dataclass
class Turn:
    """What is played once more: a departure, with the gains of its controller turned around."""

    config: ControllerConfig
    departure: Departure
    reason: str = ""
    """Why the sign is wrong, as a sentence; "" if it is not, or not known to be."""

    def judge(self, error: float) -> None:
        """Compare ``error``, at the end with the gains turned around, with that without."""
        config, found = self.config, self.departure
        if abs(error) > abs(found.error) - found.clear:
            return
        away, moved, other = (
            format_quantity(abs(value), config.unit) for value in (found.error, found.moved, error)
        )
        self.reason = (
            f"controller {config.name}: {config.measured} goes {moved} away from its setpoint in "
            f"{(found.end_ns - found.begin_ns) * 1e-9:.3g} s, and is {away} off at the end; with "
            f"gains of the other sign it is {other} off: the gains have the wrong sign"
        )


class TurnedHost(InProcessHost):
    """Plays as :class:`InProcessHost` does, and ``turn``; the run stops at its end."""

    def __init__(
        self,
        cycle: Cycle,
        clock: Clock,
        *,
        sink: Sink,
        record: Mapping[str, Recorded],
        bank: Bank,
        turn: Turn,
    ) -> None:
        super().__init__(cycle, clock, virtual=True, sink=sink, record=record)
        self._bank, self._turn, self._turned = bank, turn, False

    def _step(self) -> Outcome | None:
        cycle, name, departure = self.cycle, self._turn.config.name, self._turn.departure
        if not self._turned and cycle.t_ns + cycle.clock.period_ns >= departure.begin_ns:
            self._turned = True
            self._bank.turn_gains(name)
        outcome = super()._step()
        if cycle.t_ns == departure.end_ns:
            _, error, *_, active = self._bank.row(name)
            if active:
                self._turn.judge(error)
            cycle.control.request(Severity.STOP, "the dry run has seen enough")
        return outcome
