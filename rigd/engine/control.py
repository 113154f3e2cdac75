"""Requests to a run (pause, stop, abort, estop) from any thread or signal handler."""

from __future__ import annotations

from collections import deque

from rigd.model.severity import STOPS, Severity


class Control:
    """Requests to a run. Setting them is one assignment, safe from signal handlers."""

    def __init__(self) -> None:
        self.asked: Severity | None = None  #: one of :data:`STOPS`
        self.reason = ""
        self.pause_wanted = False
        self.last_trial = ""  #: why no trial follows the one under way, or ""
        self.acknowledged: deque[str] = deque()  #: interlocks that may clear; the run takes them
        self.notices: deque[str] = deque()  #: lines for the operator, shown by the run

    @property
    def pauses(self) -> bool:
        """Whether the run is to wait between two trials."""
        return self.pause_wanted and not self.last_trial

    def request(self, stop: Severity, reason: str) -> None:
        """Ask for one of :data:`STOPS`; one less severe never replaces one more severe."""
        if self.asked is None or stop > self.asked:
            self.reason = reason
            self.asked = stop

    def escalate(self, reason: str) -> Severity:
        """Ask for the next more severe one (a second Ctrl-C aborts, a third drops power)."""
        stop = Severity.STOP if self.asked is None else min(Severity(self.asked + 1), STOPS[-1])
        self.request(stop, reason)
        return stop

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
