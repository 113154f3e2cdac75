"""Defines the states of a run as one table: (state, event) -> state; all else is refused.

``stop`` is controlled, ``abort`` ramps to zero now, ``estop`` drops power; each is more severe than
the one before. ``finish`` may move the rig. So a run can reach ``finish`` only if the rig itself
has no fault: at the end of the procedure, after a person's stop, a step that failed, or a trip that
has cleared.
"""

from __future__ import annotations

from enum import Enum, auto
from typing import Final


class RunState(Enum):
    """The state of a run."""

    IDLE = auto()  #: nothing opened
    PREFLIGHT = auto()  #: devices are open, checks in progress, nothing moves
    BLOCKED = auto()  #: preflight refused; end
    ARMED = auto()  #: all checks passed, actuators enabled, nothing has moved
    RUNNING = auto()  #: a trial or `prepare` plays
    PAUSING = auto()  #: a pause was requested; the present trial ends first
    HELD = auto()  #: a pause holds the present step; its time stands still
    PAUSED = auto()  #: setpoints at rest, waiting for resume
    STOPPING = auto()  #: controlled stop in progress
    FINISHING = auto()  #: the procedure's `finish` plays
    ABORTING = auto()  #: setpoints ramp to zero now; nothing follows
    FAULTED = auto()  #: a device or interlock ended the run; end
    ESTOPPED = auto()  #: drop of power was requested; end
    DONE = auto()  #: made safe, file closed; end


class RunEvent(Enum):
    """The events of a run."""

    CHECK = auto()
    BLOCK = auto()
    ARM = auto()
    START = auto()
    PAUSE = auto()
    HOLD = auto()
    TRIAL_ENDED = auto()
    RESUME = auto()
    STOP = auto()
    STOPPED = auto()
    COMPLETE = auto()
    FINISHED = auto()
    ABORT = auto()
    FAULT = auto()
    ESTOP = auto()
    SAFE = auto()


_S, _E = RunState, RunEvent

TRANSITIONS: Final[dict[tuple[RunState, RunEvent], RunState]] = {
    (_S.IDLE, _E.CHECK): _S.PREFLIGHT,
    (_S.PREFLIGHT, _E.BLOCK): _S.BLOCKED,
    (_S.PREFLIGHT, _E.ARM): _S.ARMED,
    (_S.PREFLIGHT, _E.STOP): _S.DONE,
    (_S.ARMED, _E.START): _S.RUNNING,
    (_S.ARMED, _E.STOP): _S.STOPPING,
    (_S.RUNNING, _E.TRIAL_ENDED): _S.RUNNING,
    (_S.RUNNING, _E.PAUSE): _S.PAUSING,
    (_S.PAUSING, _E.RESUME): _S.RUNNING,
    (_S.PAUSING, _E.TRIAL_ENDED): _S.PAUSED,
    (_S.PAUSED, _E.RESUME): _S.RUNNING,
    (_S.RUNNING, _E.HOLD): _S.HELD,
    (_S.PAUSING, _E.HOLD): _S.HELD,
    (_S.HELD, _E.RESUME): _S.RUNNING,
    (_S.HELD, _E.TRIAL_ENDED): _S.PAUSED,
    (_S.HELD, _E.STOP): _S.STOPPING,
    (_S.RUNNING, _E.COMPLETE): _S.FINISHING,
    (_S.PAUSING, _E.COMPLETE): _S.FINISHING,
    (_S.HELD, _E.COMPLETE): _S.FINISHING,  # its trial ended early, and the pause is over
    (_S.RUNNING, _E.STOP): _S.STOPPING,
    (_S.PAUSING, _E.STOP): _S.STOPPING,
    (_S.PAUSED, _E.STOP): _S.STOPPING,
    (_S.STOPPING, _E.STOPPED): _S.FINISHING,
    (_S.FINISHING, _E.FINISHED): _S.DONE,
    (_S.ABORTING, _E.SAFE): _S.DONE,
}
# In every state in which something may move, these events are possible: the three stops.
for _state in (
    _S.PREFLIGHT, _S.ARMED, _S.RUNNING, _S.PAUSING, _S.HELD, _S.PAUSED, _S.STOPPING,
    _S.FINISHING, _S.ABORTING,
):  # fmt: skip
    TRANSITIONS[_state, _E.FAULT] = _S.FAULTED
    TRANSITIONS[_state, _E.ESTOP] = _S.ESTOPPED
    if _state is not _S.ABORTING:
        TRANSITIONS[_state, _E.ABORT] = _S.ABORTING


def next_state(state: RunState, event: RunEvent) -> RunState | None:
    """Return the state after ``event``, or None if the table refuses the event."""
    return TRANSITIONS.get((state, event))
