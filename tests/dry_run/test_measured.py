"""A dry run names the measures that its trials cannot give."""

from __future__ import annotations

from pathlib import Path

import pytest

from rigd.config.loader import load_rig
from rigd.dry_run import dry_run
from rigd.procedure.compile import compile_procedure
from rigd.procedure.loader import parse_procedure
from rigd.sdk.shipped_files import shipped_folder

CONFIGS = shipped_folder("configs")
DRIVE = """\
procedure: drive
title: Drive
doc: For tests.
parameters:
  mode: {doc: What is played, choices: [plain, full], default: plain}
record: all
trial:
  steps:
    - {step: free, set: {longitudinal_belt.engaged: 0}, for: 0.3 s}
    - {step: more, set: {longitudinal_belt.engaged: 0}, for: 0.2 s, when: {mode: full}}
    - step: go
      set: {wheel_servo.current: 1.2 A}
      until: carriage.position > 0.2 m
      timeout: 4 s
    - {step: still, set: {wheel_servo.current: 0 A, longitudinal_belt.engaged: 1}, for: 0.5 s}
measure:
  idle: {mean: wheel_servo.current, during: more}
  start: {channel: wheel_servo.current, when: carriage.position > 5 mm}
  far: {channel: wheel_servo.current, when: carriage.position > 0.4 m}
  back: {duration: {from: carriage.position > 5 mm, to: "|carriage.position| > 0.4 m"}}
"""


@pytest.mark.parametrize("rig", ["sim_lugre", "wire_lugre"])
def test_measures_that_no_trial_gives_are_named(rig: str) -> None:
    loaded = load_rig(CONFIGS / f"{rig}.yaml")
    procedure = compile_procedure(parse_procedure(DRIVE, Path("drive.yaml")), loaded)
    found = dry_run(procedure, loaded, seed=1)
    assert found.refusals == ()
    assert found.notes == (
        "measure idle: step 'more' plays in no trial",
        "measure far: carriage.position > 0.4 m never holds, so trial 1 gives no number",
        "measure back: |carriage.position| > 0.4 m never holds, so trial 1 gives no number",
    )


def test_measure_of_played_step_is_not_named() -> None:
    loaded = load_rig(CONFIGS / "sim_lugre.yaml")
    source = parse_procedure(DRIVE, Path("drive.yaml"))
    procedure = compile_procedure(source, loaded, {"mode": "full"})
    notes = dry_run(procedure, loaded, seed=1).notes
    assert not any("idle" in note or "start" in note for note in notes)
