"""Computes the progress and the remaining time of a run, and holds its result."""

from __future__ import annotations

from dataclasses import dataclass

from rigd.engine.play.interlocks import Trip
from rigd.model.errors import Exit
from rigd.model.states import RunState
from rigd.procedure.program import CompiledProcedure, CycleProgram, Prompt, TrialPlan


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
    ending: str = ""  #: how the run ends, by its name in the recording; "" until that is known
    coming_to_rest: bool = False  #: whether rows go on after the end, until the rig rests


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
        self._step = ""
        self._step_s = 0.0  # when the step began

    def watch(self, progress: Progress) -> None:
        """Note the progress of the run; a pause counts to no trial, a prompt does."""
        if progress.step != self._step:
            self._step, self._step_s = progress.step, progress.run_s
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
        if progress.ending:
            return None
        if not self._took_s:
            expected = self._expected_s
            if expected is None:
                return None
            return max(expected - (progress.run_s - progress.waited_s), 0.0)
        mean_s = sum(self._took_s) / len(self._took_s)
        remaining = progress.trials_total - progress.trials_done
        begun_s = 0.0 if self._trial is None else progress.run_s - self._since_s
        return max(remaining * mean_s - min(begun_s, mean_s), 0.0)

    def until_pause_s(self, progress: Progress, procedure: CompiledProcedure) -> float | None:
        """Return in how many s a pause that is asked for begins at the latest, or None if unknown.

        It begins with the next step that can be held, or at the end of the trial. A step that
        waits for a condition counts with its timeout; how long a person takes is not known.
        """
        if progress.state is not RunState.PAUSING:
            return None
        trial = progress.trial
        left_s: float | None = None
        for step in procedure.prepare if trial is None else (*trial.steps, *trial.after):
            if isinstance(step, Prompt) and left_s is not None:
                return None
            for segment in step.segments if isinstance(step, CycleProgram) else ():
                if left_s is None:
                    if segment.name != progress.step:
                        continue
                    left_s = self._step_s - progress.run_s
                elif segment.hold is not None:
                    return max(left_s, 0.0)
                longest_s = segment.timeout_s if segment.duration_s is None else segment.duration_s
                if longest_s is None:
                    return None
                left_s += longest_s
        return None if left_s is None else max(left_s, 0.0)
