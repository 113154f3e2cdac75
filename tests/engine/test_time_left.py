"""How long a run will still take."""

from __future__ import annotations

from dataclasses import replace

import pytest

from rigd.engine.result import Progress, TimeLeft
from rigd.model.states import RunState
from rigd.procedure.program import TrialPlan


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
