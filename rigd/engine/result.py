"""Computes the progress and the remaining time of a run, and holds its result."""

from __future__ import annotations

from dataclasses import dataclass

from rigd.engine.interlocks import Trip
from rigd.model.errors import Exit
from rigd.model.states import RunState
from rigd.procedure.program import TrialPlan


@dataclass(frozen=True)
class Progress:
    """The progress of a run, for displays and clients."""

    state: RunState
    step: str
    trials_done: int
    trials_total: int
    trial: TrialPlan | None
    run_s: float  #: time since the preflight was passed, in s
    trips: tuple[Trip, ...] = ()  #: all trips so far
    waited_s: float = 0.0  #: how much of that time a person was awaited, by a prompt


@dataclass(frozen=True)
class RunResult:
    """The result of a run: the final state, the reason, and the exit code for a script.

    ``ending`` is its name in the recording and for people, from :mod:`rigd.model.severity`.
    """

    state: RunState
    ending: str
    reason: str
    exit_code: Exit
    trials_done: int
    trials_total: int
    run_s: float
    incomplete: tuple[tuple[int, str], ...] = ()  #: trials that ended early, and why
    cycles: int = 0
    missed_cycles: int = 0
    trips: tuple[str, ...] = ()
    problems: tuple[str, ...] = ()  #: errors while the rig was made safe


class TimeLeft:
    """Estimates the time that a run still needs from the duration of its trials, in s.

    ``expected_s`` is the duration of a dry run, if there was one.
    """

    def __init__(self, expected_s: float | None = None) -> None:
        self._expected_s = expected_s
        self._took_s: list[float] = []
        self._trial: int | None = None
        self._since_s = 0.0
        self._held_s: float | None = None  # when the step was held that still is

    def watch(self, progress: Progress) -> None:
        """Note the progress of the run; a pause counts to no trial, a prompt does."""
        if progress.state is RunState.HELD:
            self._held_s = progress.run_s if self._held_s is None else self._held_s
        elif self._held_s is not None:
            self._since_s += progress.run_s - self._held_s
            self._held_s = None
        number = None if progress.trial is None else progress.trial.number
        if number == self._trial:
            return
        if self._trial is not None:
            self._took_s.append(progress.run_s - self._since_s)
        self._trial, self._since_s = number, progress.run_s

    def left_s(self, progress: Progress) -> float | None:
        """Return the estimated time until the last trial ends in s, or None."""
        if not self._took_s:
            expected = self._expected_s
            if expected is None:
                return None
            return max(expected - (progress.run_s - progress.waited_s), 0.0)
        mean_s = sum(self._took_s) / len(self._took_s)
        remaining = progress.trials_total - progress.trials_done
        begun_s = 0.0 if self._trial is None else progress.run_s - self._since_s
        return max(remaining * mean_s - min(begun_s, mean_s), 0.0)
