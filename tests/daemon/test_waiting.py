"""What a paused run says about its setpoints, and about what follows."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from rigd.analysis.plan import judged
from rigd.config.loader import load_rig
from rigd.daemon.execute import RunRequest
from rigd.daemon.waiting import what_waits
from rigd.engine.run.result import Progress
from rigd.model.states import RunState
from rigd.procedure.loader import parse_procedure

TEXT = """\
procedure: shake
title: Moves
doc: For the test.
parameters: {current: {unit: A, default: 0.1 A, doc: its size}}
sweep: {grid: {current: [0.1 A, 0.2 A]}}
trial:
  steps:
    - step: wave
      set: {wheel_servo.current: "${current}"}
      for: 10 s
      hold: {set: {wheel_servo.current: 0.05 A}, timeout: 10 min}
"""


@pytest.fixture(scope="module")
def request_() -> RunRequest:
    rig = load_rig("lugre-1")
    return RunRequest(judged(parse_procedure(TEXT, Path("shake.yaml")), rig), TEXT, rig, seed=1)


def paused(request: RunRequest, **changes: object) -> str:
    first = Progress(RunState.PAUSED, "", 1, 2, None, 5.0)
    return what_waits(replace(first, **changes), request)  # type: ignore[arg-type]  # real fields


def test_pause_names_rest_and_next_trial(request_: RunRequest) -> None:
    text = paused(request_)
    assert text.startswith("setpoints at rest: ")
    assert "wheel_servo.current 0 A" in text
    assert text.endswith("; then trial 2 of 2, current 0.2 A")


def test_pause_behind_last_trial_names_the_finish(request_: RunRequest) -> None:
    assert paused(request_, trials_done=2).endswith("; then the finish")


def test_held_step_names_its_setpoints_and_bound(request_: RunRequest) -> None:
    assert paused(request_, state=RunState.HELD, step="wave") == (
        "wheel_servo.current 0.05 A, the others keep their value, for 600 s at most; "
        "then step wave goes on"
    )


def test_run_that_plays_waits_for_nothing(request_: RunRequest) -> None:
    assert paused(request_, state=RunState.RUNNING, step="wave") == ""
