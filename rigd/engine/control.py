"""What a person may ask of a run at any moment, from any thread or signal handler."""

from __future__ import annotations

from collections import deque
from enum import IntEnum


class Verb(IntEnum):
    """Ways to end a run; each escalates the one before."""

    STOP = 1  #: controlled: setpoints ramp to rest, then `finish` plays
    ABORT = 2  #: setpoints to rest now, nothing else follows
    ESTOP = 3  #: ask for power to drop


class Control:
    """Requests to a run. Setting them is one assignment, safe from signal handlers."""

    def __init__(self) -> None:
        self.verb: Verb | None = None
        self.reason = ""
        self.pause_wanted = False
        self.last_trial = ""  #: why no trial follows the one under way, or ""
        self.acknowledged: deque[str] = deque()  #: interlocks that may clear; the run takes them
        self.notices: deque[str] = deque()  #: lines for the operator, shown by the run

    @property
    def pauses(self) -> bool:
        """Whether the run is to wait between two trials."""
        return self.pause_wanted and not self.last_trial

    def request(self, verb: Verb, reason: str) -> None:
        """Ask for ``verb``; a weaker request never replaces a stronger one."""
        if self.verb is None or verb > self.verb:
            self.reason = reason
            self.verb = verb

    def escalate(self, reason: str) -> Verb:
        """Ask for the next stronger verb (a second Ctrl-C aborts, a third drops power)."""
        verb = Verb.STOP if self.verb is None else Verb(min(self.verb + 1, Verb.ESTOP))
        self.request(verb, reason)
        return verb

    def toggle_pause(self) -> bool:
        """Ask to pause after this trial, or to resume; return whether a pause is now wanted."""
        self.pause_wanted = not self.pause_wanted
        return self.pause_wanted

    def end_after_trial(self, reason: str) -> None:
        """Ask for a controlled stop once the trial under way has ended, paused or not."""
        self.last_trial = reason

    def resume(self) -> None:
        """Take back a pause, and the wish to end after this trial."""
        self.pause_wanted = False
        self.last_trial = ""
