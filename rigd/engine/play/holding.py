"""Holds one step of a program in its midst: what a pause does where the step allows it."""

from __future__ import annotations

from collections.abc import Collection, Mapping, MutableSequence, Sequence
from enum import Enum
from typing import Final

from rigd.computed.controllers.chain import acting
from rigd.procedure.program import Hold


class HoldPhase(Enum):
    """How far the hold of a step is; the text is that of its events."""

    NONE = "over"  #: the time of the step runs
    HELD = "held"  #: the setpoints of the hold apply
    RETURNING = "returning"  #: the setpoints go back to where they were, within their rates


class Holding:
    """The hold of one segment, bound to the tables of a rig.

    ``at_work`` are the setpoints of the controllers that act in the segment. A hold may set what
    one of them commands: it then ends, and begins again without a bump when the setpoints return.
    """

    def __init__(
        self,
        hold: Hold,
        at_work: frozenset[str],
        setpoints: Mapping[str, int],
        loops: Mapping[str, str],
    ) -> None:
        self.longest_s: Final = hold.longest_s
        self.acting = acting(loops, at_work, hold.setpoints)  #: controllers while it is held
        self._set = [(setpoints[name], value) for name, value in hold.setpoints.items()]
        self._own = [setpoints[name] for name in _set_by_steps(setpoints, loops, at_work)]
        free = _set_by_steps(setpoints, loops, self.acting)
        self._kept = [setpoints[name] for name in free if name not in hold.setpoints]
        self._reached: list[float] = []
        self._wanted: list[float] = []
        self._longest_ns = round(hold.longest_s * 1e9)
        self._since_ns = 0
        self._began_ns = 0
        self.phase = HoldPhase.NONE

    def begin(self, t_ns: int, wanted: MutableSequence[float], applied: Sequence[float]) -> None:
        """Hold from the cycle at ``t_ns`` on; ``applied`` is what the setpoints have reached."""
        self._began_ns = t_ns
        self._wanted, self._reached = list(wanted), list(applied)
        self._hold(t_ns, wanted)

    def _hold(self, t_ns: int, wanted: MutableSequence[float]) -> None:
        self.phase, self._since_ns = HoldPhase.HELD, t_ns
        for place in self._kept:
            wanted[place] = self._reached[place]
        for place, value in self._set:
            wanted[place] = value

    def step(
        self, t_ns: int, pause: bool, wanted: MutableSequence[float], applied: Sequence[float]
    ) -> int | None:
        """Go on with the hold; return None, or how long it took in all, in ns, when it is over.

        It is over when ``pause`` is no longer wanted and every setpoint is where it was.
        """
        if self.phase is HoldPhase.HELD:
            if pause:
                return None
            self.phase = HoldPhase.RETURNING
            for place in self._own:
                wanted[place] = self._reached[place]
            return None
        if pause:
            self._hold(t_ns, wanted)
            return None
        if any(applied[place] != self._reached[place] for place in self._own):
            return None
        self.phase = HoldPhase.NONE
        for place in self._own:
            wanted[place] = self._wanted[place]
        return t_ns - self._began_ns

    def too_long(self, t_ns: int) -> bool:
        """Return whether the segment is held for longer than it may be."""
        return self.phase is HoldPhase.HELD and t_ns - self._since_ns >= self._longest_ns


def _set_by_steps(
    setpoints: Collection[str], loops: Mapping[str, str], at_work: Collection[str]
) -> list[str]:
    """Return the setpoints that no controller sets while those ``at_work`` act.

    That of a controller which does not act follows the measured value.
    """
    commanded = {loops[name] for name in at_work}
    return [
        name
        for name in setpoints
        if name not in commanded and (name not in loops or name in at_work)
    ]
