"""Holds the requests to a run (pause, stop, abort, estop) from any thread or signal handler."""

from __future__ import annotations

from collections import deque

from rigd.model.severity import STOPS, Severity


class Control:
    """Holds the requests to a run. Each request is one assignment, safe in a signal handler."""

    def __init__(self) -> None:
        self.asked: Severity | None = None  #: one of :data:`STOPS`
        self.reason = ""
        self.pause_wanted = False
        self.last_trial = ""  #: why no trial follows the present trial, or ""
        self.acknowledged: deque[str] = deque()  #: interlocks that may clear; the run removes them
        self.notices: deque[str] = deque()  #: lines for the operator, shown by the run

    @property
    def pauses(self) -> bool:
        """Whether the run shall wait, in a step that can be held or between two trials."""
        return self.pause_wanted and not self.last_trial

    def request(self, stop: Severity, reason: str) -> None:
        """Request one of :data:`STOPS`; a less severe request never replaces a severer one."""
        if self.asked is None or stop > self.asked:
            self.reason = reason
            self.asked = stop

    def escalate(self, reason: str) -> Severity:
        """Request the next more severe stop (a second Ctrl-C aborts, a third drops power)."""
        stop = Severity.STOP if self.asked is None else min(Severity(self.asked + 1), STOPS[-1])
        self.request(stop, reason)
        return stop

    def toggle_pause(self) -> bool:
        """Request a pause, or to resume; return whether it will pause."""
        self.pause_wanted = not self.pause_wanted
        return self.pause_wanted

    def end_after_trial(self, reason: str) -> None:
        """Request a controlled stop after the present trial, whether paused or not."""
        self.last_trial = reason

    def resume(self) -> None:
        """Cancel a pause, and a stop after this trial."""
        self.pause_wanted = False
        self.last_trial = ""
