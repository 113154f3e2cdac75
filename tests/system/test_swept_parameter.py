"""A derived channel of a parameter that the sweep varies, in real time in a cycle process."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from support.commands.command import rigd

from rigd.model.channels import STATUS_FIELD
from rigd.model.rows import TIME_FIELD
from rigd.record import Recording

PROCEDURE = """\
procedure: loads
title: Loads
doc: Three trials, one behind the other.
parameters:
  load: {doc: Load, unit: mA}
sweep: {grid: {load: [600 mA, 500 mA, 400 mA]}}
derived:
  share.load: {is: "wheel_servo.current_setpoint / ${load}"}
trial:
  steps:
    - step: push
      set: {longitudinal_belt.engaged: 0, wheel_servo.current: "${load}"}
      for: 0.2 s
"""


def test_no_row_has_load_of_other_trial(tmp_path: Path) -> None:
    (tmp_path / "loads.yaml").write_text(PROCEDURE)
    ended = rigd(
        "run", "loads.yaml", "--rig", "lugre-1", "--pace", "1", "--output", "x.mcap", cwd=tmp_path
    )
    assert ended.code == 0, ended.err
    recording = Recording.open(tmp_path / "x.mcap")
    written = recording.read("wheel_servo")
    for trial, load in zip(recording.trials, (0.6, 0.5, 0.4), strict=True):
        rows = recording.read("share", trial.start_ns, trial.end_ns)
        before = np.searchsorted(written[TIME_FIELD], rows[TIME_FIELD]) - 1
        known = np.isfinite(rows["load"])
        assert known[rows[TIME_FIELD] >= trial.steps[0].start_ns].all()
        assert np.array_equal(rows[STATUS_FIELD] != 0, ~known)
        expected = written["current_setpoint"][before] / load
        assert np.array_equal(rows["load"][known], expected[known])
