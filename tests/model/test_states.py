"""The life of a run: what the table promises about every way through it."""

from __future__ import annotations

import pytest

from rigd.model.states import TRANSITIONS, RunEvent, RunState, next_state

FINAL = {RunState.BLOCKED, RunState.FAULTED, RunState.ESTOPPED, RunState.DONE}
MOVING = [
    RunState.ARMED,
    RunState.RUNNING,
    RunState.PAUSING,
    RunState.PAUSED,
    RunState.STOPPING,
    RunState.FINISHING,
]


@pytest.mark.parametrize("state", MOVING)
def test_abort_estop_and_fault_are_possible_while_moving(state: RunState) -> None:
    for event in (RunEvent.ABORT, RunEvent.ESTOP, RunEvent.FAULT):
        assert next_state(state, event) is not None


@pytest.mark.parametrize("state", [state for state in RunState if state in FINAL])
def test_final_state_has_no_next_state(state: RunState) -> None:
    assert not [event for event in RunEvent if next_state(state, event)]


def test_finishing_is_reached_only_without_a_fault() -> None:
    sources = {state for (state, _), to in TRANSITIONS.items() if to is RunState.FINISHING}
    assert sources == {RunState.RUNNING, RunState.PAUSING, RunState.HELD, RunState.STOPPING}


def test_every_state_is_reachable_and_can_end() -> None:
    reachable = {RunState.IDLE}
    while True:
        more = {to for (state, _), to in TRANSITIONS.items() if state in reachable} - reachable
        if not more:
            break
        reachable |= more
    assert reachable == set(RunState)
    for state in set(RunState) - FINAL:
        seen = {state}
        for _ in RunState:
            seen |= {to for (at, _), to in TRANSITIONS.items() if at in seen}
        assert seen & FINAL, state


def test_nothing_moves_before_it_is_armed() -> None:
    into_running = {state for (state, _), to in TRANSITIONS.items() if to is RunState.RUNNING}
    assert into_running == {
        RunState.ARMED,
        RunState.RUNNING,
        RunState.PAUSING,
        RunState.HELD,
        RunState.PAUSED,
    }
    assert {state for (state, _), to in TRANSITIONS.items() if to is RunState.ARMED} == {
        RunState.PREFLIGHT
    }
