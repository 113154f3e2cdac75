"""Progress and result of a run."""

from __future__ import annotations

from dataclasses import dataclass

from rigd.engine.interlocks import Trip
from rigd.model.errors import Exit
from rigd.model.states import RunState
from rigd.procedure.program import TrialPlan


@dataclass(frozen=True)
class Progress:
    """Where a run stands, for whoever watches."""

    state: RunState
    step: str
    trials_done: int
    trials_total: int
    trial: TrialPlan | None
    run_s: float  #: time of the run so far, in s
    trips: tuple[Trip, ...] = ()  #: everything that tripped so far


@dataclass(frozen=True)
class RunResult:
    """How a run ended: the final state, why, and the exit code that says so to a script.

    ``ending`` is the word for it that the recording holds and people read, one of
    :mod:`rigd.model.severity`.
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
    problems: tuple[str, ...] = ()  #: what went wrong while making the rig safe
