"""Defines how strongly an event ends a run, as an ordered scale, and how a run ends at each level.

Each interlock has an action on this scale (``warn`` to ``estop``). A request of a person
(:data:`STOPS`) and the outcome of a program that plays are on the same scale. If two come together,
the more severe one counts.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Final

from rigd.model.errors import Exit
from rigd.model.states import RunState


class Severity(IntEnum):
    """What ends a run, or part of it; each value is more severe than the previous value."""

    DONE = 0  #: the program ends normally
    WARN = 1  #: recorded and shown; ends nothing
    END_TRIAL = 2  #: this trial ends early, the next trial follows
    FAIL = 3  #: a step did not end as the procedure demands
    STOP = 4  #: controlled: setpoints ramp to rest, then `finish` plays
    ABORT = 5  #: setpoints to rest now, nothing else follows
    ESTOP = 6  #: the devices are requested to drop power at once
    FAULT = 7  #: a device failed; every device is made safe

    @property
    def word(self) -> str:
        """The name in files, events and the protocol."""
        return self.name.lower()


#: The stops that a person may request, in order of severity.
STOPS: Final = (Severity.STOP, Severity.ABORT, Severity.ESTOP)


@dataclass(frozen=True)
class WayOut:
    """How a run ends: its name, its final state, its exit code.

    ``finishes`` is whether the `finish` of the procedure plays, which may move the rig.
    """

    ending: str
    state: RunState
    exit_code: Exit
    finishes: bool

    def then(self, later: WayOut) -> WayOut:
        """Return how a run ends if ``later`` ended its `finish`.

        The exit code is that of the first failure; a stop by a person is not a failure.
        """
        if self.exit_code in (Exit.OK, Exit.STOPPED):
            return later
        return self if later.finishes else replace(later, exit_code=self.exit_code)


#: How a run ends without an interlock, by the most severe event.
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

#: How a run ends if preflight refuses it, and if an error ends it.
BLOCKED: Final = WayOut("blocked", RunState.BLOCKED, Exit.BLOCKED, finishes=False)
BROKEN: Final = WayOut("faulted", RunState.FAULTED, Exit.INTERNAL, finishes=False)


def way_out(severity: Severity, *, tripped: bool = False, latched: bool = False) -> WayOut:
    """Return how a run ends.

    ``tripped``: an interlock ended it. ``latched``: that interlock stays tripped until a person
    acknowledges it, so that the rig must not be moved: this counts as a fault, unless something
    more severe was requested.
    """
    if latched and severity < Severity.ABORT:
        severity = Severity.FAULT
    way = WAYS_OUT[severity]
    if not tripped:
        return way
    return replace(way, ending="tripped" if way.finishes else way.ending, exit_code=Exit.TRIPPED)
