"""How long a run will still take."""

from __future__ import annotations

from dataclasses import replace

import pytest

from rigd.engine.run.result import Progress, TimeLeft
from rigd.model.states import RunState
from rigd.procedure.program import CompiledProcedure, CycleProgram, Hold, Prompt, Segment, TrialPlan


def at(run_s: float, trial: int | None, done: int, total: int = 4) -> Progress:
    plan = None if trial is None else TrialPlan(trial, 1, {}, ())
    return Progress(RunState.RUNNING, "", done, total, plan, run_s)


def test_nothing_is_known_before_first_trial_has_ended() -> None:
    left = TimeLeft()
    left.watch(at(0.0, None, 0))
    left.watch(at(1.0, 1, 0))
    assert left.left_s(at(5.0, 1, 0)) is None


def test_dry_run_estimates_time_before_first_trial() -> None:
    left = TimeLeft(expected_s=60.0)
    left.watch(at(1.0, 1, 0))
    assert left.left_s(at(5.0, 1, 0)) == pytest.approx(55.0)
    assert left.left_s(at(70.0, 1, 0)) == 0.0


def test_waiting_for_a_person_is_no_work() -> None:
    left = TimeLeft(expected_s=20.0)
    assert left.left_s(replace(at(30.0, None, 0), waited_s=29.0)) == pytest.approx(19.0)


def test_time_left_is_mean_of_trials_so_far() -> None:
    left = TimeLeft(expected_s=1000.0)
    for progress in (at(1.0, 1, 0), at(11.0, None, 1), at(31.0, 2, 1), at(51.0, None, 2)):
        left.watch(progress)
    # 10 s and 20 s; the pause of 20 s between them belongs to neither. Two are left.
    assert left.left_s(at(51.0, None, 2)) == pytest.approx(30.0)
    left.watch(at(52.0, 3, 2))
    assert left.left_s(at(57.0, 3, 2)) == pytest.approx(25.0)
    # One that takes longer than expected is about to end, however long it takes.
    assert left.left_s(at(99.0, 3, 2)) == pytest.approx(15.0)


def test_trials_completed_by_earlier_run_are_not_counted() -> None:
    left = TimeLeft()
    left.watch(at(0.0, 3, 2))
    left.watch(at(8.0, None, 3))
    assert left.left_s(at(8.0, None, 3)) == pytest.approx(8.0)


def test_nothing_is_left_of_an_ended_run() -> None:
    left = TimeLeft(expected_s=60.0)
    left.watch(at(1.0, 1, 0))
    assert left.left_s(replace(at(5.0, None, 0), ending="tripped")) is None


def step(name: str, duration_s: float | None, *, held: bool = False) -> CycleProgram:
    hold = Hold({}, 60.0) if held else None
    return CycleProgram((Segment(name, {}, duration_s=duration_s, hold=hold),))


def pause_in_s(
    *steps: CycleProgram | Prompt, now: str = "sine", ran_s: float = 3.0
) -> float | None:
    """Return when a pause begins that is asked for in the step ``now``, which began ran_s ago."""
    trial = TrialPlan(1, 1, {}, steps, (step("back", 5.0),))
    whole = CompiledProcedure("p", "", {}, {}, (), (trial,), (), {})
    left = TimeLeft()
    begun = Progress(RunState.RUNNING, now, 0, 1, trial, 10.0)
    left.watch(begun)
    assert left.until_pause_s(begun, whole) is None
    return left.until_pause_s(replace(begun, state=RunState.PAUSING, run_s=10.0 + ran_s), whole)


def test_pause_begins_at_the_latest_after_trial() -> None:
    assert pause_in_s(step("go", 9.0), step("sine", 1200.0), step("end", 2.0)) == pytest.approx(
        1204
    )


def test_pause_begins_with_next_step_that_holds() -> None:
    assert pause_in_s(step("sine", 20.0), step("hold", 7.0, held=True)) == pytest.approx(17.0)


def test_begin_of_pause_is_unknown_behind_a_person() -> None:
    assert pause_in_s(step("sine", 20.0), Prompt("ready", "Ready?")) is None
    assert pause_in_s(step("sine", None)) is None
