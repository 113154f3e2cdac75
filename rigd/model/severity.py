"""How severe what ends a run is, as one ladder, and how a run ends at each of its rungs.

An interlock acts by it (``warn`` to ``estop``), a person asks by it (:data:`STOPS`), and what plays
ends by it. Of two that come together the more severe counts.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Final

from rigd.model.errors import Exit
from rigd.model.states import RunState


class Severity(IntEnum):
    """What ends a run, or part of it; each is more severe than the one before."""

    DONE = 0  #: played to its end
    WARN = 1  #: recorded and shown; ends nothing
    END_TRIAL = 2  #: this trial ends early, the next one follows
    FAIL = 3  #: a step did not end as the procedure demands
    STOP = 4  #: controlled: setpoints ramp to rest, then `finish` plays
    ABORT = 5  #: setpoints to rest now, nothing else follows
    ESTOP = 6  #: ask for power to drop at once
    FAULT = 7  #: a device failed; every device is made safe

    @property
    def word(self) -> str:
        """What files, events and the protocol call it."""
        return self.name.lower()


#: What a person may ask of a run, each more severe than the one before.
STOPS: Final = (Severity.STOP, Severity.ABORT, Severity.ESTOP)


@dataclass(frozen=True)
class WayOut:
    """How a run ends: the word for it, its final state, its exit code.

    ``finishes`` is whether the `finish` of the procedure plays, which may move the rig.
    """

    ending: str
    state: RunState
    exit_code: Exit
    finishes: bool

    def then(self, later: WayOut) -> WayOut:
        """Return how a run ends whose `finish` was ended by ``later``.

        The exit code is that of what went wrong first; that a person stopped a run is nothing
        wrong.
        """
        if self.exit_code in (Exit.OK, Exit.STOPPED):
            return later
        return self if later.finishes else replace(later, exit_code=self.exit_code)


#: How a run ends that no interlock ended, by the most severe of what happened to it.
WAYS_OUT: Final[Mapping[Severity, WayOut]] = {
    Severity.DONE: WayOut("complete", RunState.DONE, Exit.OK, finishes=True),
    Severity.WARN: WayOut("complete", RunState.DONE, Exit.OK, finishes=True),
    Severity.END_TRIAL: WayOut("incomplete", RunState.DONE, Exit.FAILED, finishes=True),
    Severity.FAIL: WayOut("incomplete", RunState.DONE, Exit.FAILED, finishes=True),
    Severity.STOP: WayOut("stopped", RunState.DONE, Exit.STOPPED, finishes=True),
    Severity.ABORT: WayOut("aborted", RunState.DONE, Exit.STOPPED, finishes=False),
    Severity.ESTOP: WayOut("estopped", RunState.ESTOPPED, Exit.STOPPED, finishes=False),
    Severity.FAULT: WayOut("faulted", RunState.FAULTED, Exit.TRIPPED, finishes=False),
}

#: How a run ends that preflight refuses to begin, and one that an error ends.
BLOCKED: Final = WayOut("blocked", RunState.BLOCKED, Exit.BLOCKED, finishes=False)
BROKEN: Final = WayOut("faulted", RunState.FAULTED, Exit.INTERNAL, finishes=False)


def way_out(severity: Severity, *, tripped: bool = False, latched: bool = False) -> WayOut:
    """Return how a run ends.

    ``tripped``: an interlock ended it. ``latched``: that interlock stays tripped until a person
    acknowledges it, so that the rig must not be moved: as bad as a fault, unless worse was asked.
    """
    if latched and severity < Severity.ABORT:
        severity = Severity.FAULT
    way = WAYS_OUT[severity]
    if not tripped:
        return way
    return replace(way, ending="tripped" if way.finishes else way.ending, exit_code=Exit.TRIPPED)
