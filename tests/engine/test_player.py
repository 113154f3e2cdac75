"""The player acts in the cycle that sees a condition, and names what ended a program."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest

from rigd.engine.cycle.limiter import Limiter
from rigd.engine.play.player import Outcome, Player
from rigd.model.limits import SetpointLimit
from rigd.model.severity import Severity
from rigd.procedure.profiles.profiles import ConstantProfile, Ramp
from rigd.procedure.program import (
    Comparison,
    Condition,
    CycleProgram,
    OnTimeout,
    Segment,
    StatusCondition,
    TrialLimit,
)

MS = 1_000_000
READINGS = {"a.x": 0, "a.y": 1, "a.status": 1}
SETPOINTS = {"a.u": 0, "a.v": 1}


def play(
    program: CycleProgram, rows: list[tuple[float, float]]
) -> tuple[list[tuple[float, ...]], Outcome | None]:
    """Return the wanted setpoints of every cycle that played on, and how it ended."""
    player = Player(program, READINGS, SETPOINTS)
    wanted = [0.0, 0.0]
    history: list[tuple[float, ...]] = []
    for k, row in enumerate(rows):
        outcome = player.step(k * MS, row, wanted)
        if outcome is not None:
            return history, outcome
        history.append(tuple(wanted))
    return history, None


def above(threshold: float, **more: Any) -> Condition:
    return Condition("a.x", Comparison.ABOVE, threshold, **more)


def test_end_condition_acts_in_cycle_that_sees_it() -> None:
    program = CycleProgram(
        (
            Segment("push", {"a.u": ConstantProfile(1.0)}, until=((above(0.5),),), timeout_s=1.0),
            Segment("hold", {"a.u": ConstantProfile(0.0)}, duration_s=0.002),
        )
    )
    history, outcome = play(program, [(0, 0), (0.4, 0), (0.6, 0), (0.6, 0), (0.6, 0)])
    assert [u for u, _ in history] == [1.0, 1.0, 0.0, 0.0]
    assert outcome == Outcome(Severity.DONE)


def test_unnamed_setpoints_hold_and_profiles_start_from_them() -> None:
    program = CycleProgram(
        (
            Segment(
                "one", {"a.u": ConstantProfile(1.0), "a.v": ConstantProfile(2.0)}, duration_s=0.001
            ),
            Segment("two", {"a.u": Ramp(None, 0.0, 0.004)}, duration_s=0.004),
        )
    )
    history, _ = play(program, [(0, 0)] * 6)
    assert history == [(1.0, 2.0), (1.0, 2.0), (0.75, 2.0), (0.5, 2.0), (0.25, 2.0)]


def test_profile_begins_at_setpoint_that_passed_limiter() -> None:
    first = Segment("up", {"a.u": ConstantProfile(10.0)}, duration_s=0.002)
    down = Segment("down", {"a.u": Ramp(None, 0.0, 0.004)}, duration_s=0.01)
    player = Player(CycleProgram((first, down)), READINGS, SETPOINTS)
    limiter = Limiter((SetpointLimit(0.0, 10.0, 1000.0), SetpointLimit(0.0, 10.0, 1000.0)), 1e-3)
    wanted, passed = [0.0, 0.0], []
    for k in range(7):
        player.step(k * MS, (0.0, 0.0), wanted, limiter.applied)
        passed.append(limiter.apply(wanted)[0])
    assert passed == [1.0, 2.0, 2.0, 1.5, 1.0, 0.5, 0.0]


def test_broken_condition_starts_its_time_again() -> None:
    segment = Segment("s", until=((above(0.5, for_s=0.002),),), timeout_s=1.0)
    xs = [1, 1, 0, 1, 1, 1, 1]
    history, outcome = play(CycleProgram((segment,)), [(x, 0) for x in xs])
    assert outcome == Outcome(Severity.DONE)
    assert len(history) == 5


def test_until_ends_if_any_row_holds_whole() -> None:
    low_y = Condition("a.y", Comparison.BELOW, 0.1, magnitude=True)
    segment = Segment("s", until=((above(0.5), low_y), (above(9.0),)), timeout_s=1.0)
    both, outcome = play(CycleProgram((segment,)), [(1, -1), (1, -0.05)])
    assert (len(both), outcome) == (1, Outcome(Severity.DONE))
    other, outcome = play(CycleProgram((segment,)), [(1, 1), (10, 1)])
    assert (len(other), outcome) == (1, Outcome(Severity.DONE))


def test_nan_meets_no_end_condition() -> None:
    segment = Segment("s", until=((above(0.5),),), timeout_s=1.0)
    assert play(CycleProgram((segment,)), [(float("nan"), 0)] * 3)[1] is None


def test_timeout_fails_ends_trial_or_continues_as_stated() -> None:
    waiting = Segment("home", until=((above(0.5),),), timeout_s=0.002)
    endings = {}
    for on_timeout in OnTimeout:
        program = CycleProgram((replace(waiting, on_timeout=on_timeout),))
        outcome = play(program, [(0, 0)] * 4)[1]
        assert outcome is not None
        endings[on_timeout] = outcome
    assert endings[OnTimeout.FAIL] == Outcome(
        Severity.FAIL, "step 'home' did not end within 0.002 s: a.x is 0"
    )
    assert endings[OnTimeout.END_TRIAL].severity is Severity.END_TRIAL
    assert endings[OnTimeout.NEXT].severity is Severity.DONE


def test_trial_limit_ends_trial_and_so_does_nan() -> None:
    program = CycleProgram((Segment("s", duration_s=1.0),), (TrialLimit("a.x", -1.0, 1.0),))
    for bad in (1.5, -1.5, float("nan")):
        outcome = play(program, [(0, 0), (bad, 0)])[1]
        assert outcome is not None
        assert outcome.severity is Severity.END_TRIAL
        assert "a.x" in outcome.reason


@pytest.mark.parametrize(
    ("value", "told"),
    [
        (294.15, "a.x is 21 degC, above the trial's limit of 20 degC"),
        (268.15, "a.x is -5 degC, below the trial's limit of 0 degC"),
        (math.nan, "a.x has no value, and the trial has a limit of it"),
    ],
)
def test_left_trial_limit_is_in_its_unit(value: float, told: str) -> None:
    limit = TrialLimit("a.x", 273.15, 293.15, "degC")
    outcome = play(CycleProgram((Segment("s", duration_s=1.0),), (limit,)), [(value, 0)])[1]
    assert outcome is not None and outcome.reason == told


def test_an_empty_program_is_done_at_once() -> None:
    assert play(CycleProgram(()), [(0, 0)]) == ([], Outcome(Severity.DONE))


@pytest.mark.parametrize(("wanted", "ends_after"), [(True, 3), (False, 1)])
def test_status_word_counts_once_the_device_gave_one(wanted: bool, ends_after: int) -> None:
    stable = StatusCondition("a", "stable", 2, wanted)
    program = CycleProgram((Segment("settle", until=((stable,),), timeout_s=1.0),))
    rows = [(0.0, float("nan")), (0.0, 1.0), (0.0, 5.0), (0.0, 3.0)]
    history, outcome = play(program, rows)
    assert (len(history), outcome) == (ends_after, Outcome(Severity.DONE))


def test_outcome_states_values_of_awaited_channels() -> None:
    stable = StatusCondition("a", "stable", 2)
    waiting = Segment("settle", until=((above(0.5), stable),), timeout_s=0.002)
    _, ended = play(CycleProgram((Segment("first", duration_s=0.001), waiting)), [(0.6, 1)] * 5)
    assert ended is not None
    assert ended.last_values == {"a.x": 0.6, "a.status": 1}
    assert ended.reason == ("step 'settle' did not end within 0.002 s: a.x is 0.6, a is not stable")
    _, done = play(CycleProgram((waiting,)), [(0.6, 2)])
    assert done is not None
    assert done.last_values == {"a.x": 0.6, "a.status": 2}
