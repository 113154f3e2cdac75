"""Writes the trial and the step of each moment as numbers, on ``/trial``, for viewers.

Viewers plot and shade by numbers; the events hold names and JSON. All of it follows from the
events: rigd itself reads those, and a message of ``/trial`` that is lost loses nothing.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, replace
from typing import Final

from rigd.record.events.event import CDR_HEADER, NO_TRIAL, Event, cdr_string

#: Outside of steps, and of an event that does not state its repeat.
NONE: Final = -1
_OUTSIDE: Final = ("trial_end", "run_start", "run_end")


@dataclass(frozen=True)
class TrialMark:
    """Which trial and step it is: -1 and "" outside of them.

    ``step`` counts the steps that were entered, from 0 in each trial and outside of trials.
    """

    number: int = NO_TRIAL
    repeat: int = NONE
    step: int = NONE
    step_name: str = ""

    def payload(self) -> bytes:
        """Return it as a message, in CDR."""
        numbers = struct.pack("<iii", self.number, self.repeat, self.step)
        return CDR_HEADER + numbers + cdr_string(self.step_name)


class TrialSeries:
    """Follows the events of a run, and gives a mark when trial or step changes."""

    def __init__(self) -> None:
        self._now = TrialMark()
        self._entered = 0  #: steps since the trial, or the time outside of trials, began

    def follow(self, event: Event) -> TrialMark | None:
        """Return the mark from ``event`` on; None if it is the one that holds already."""
        before, data = self._now, event.data
        if event.kind == "trial_start":
            repeat = data.get("repeat")
            self._enter(event.trial, repeat if isinstance(repeat, int) else NONE)
        elif event.kind in _OUTSIDE:
            self._enter(NO_TRIAL)
        elif event.kind == "step":
            if event.trial != before.number:  # the beginning of its trial is not in the recording
                self._enter(event.trial)
            name = str(data.get("name", ""))
            self._now = replace(self._now, step=self._entered if name else NONE, step_name=name)
            self._entered += bool(name)
        elif event.kind == "prompt":  # the wait for the answer belongs to no step
            self._now = replace(before, step=NONE, step_name="")
        elif event.kind == "hold":  # of which the time belongs to no step
            over = data.get("phase") == "over"
            step, name = (self._entered - 1, str(data.get("step", ""))) if over else (NONE, "")
            self._now = replace(before, step=step, step_name=name)
        return None if self._now == before else self._now

    def _enter(self, number: int, repeat: int = NONE) -> None:
        self._now, self._entered = TrialMark(number, repeat), 0
