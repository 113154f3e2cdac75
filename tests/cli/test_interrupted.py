"""Ctrl-C once a run has ended: what it was is shown all the same."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from rigd.model.errors import Exit

MEASURING = """\
procedure: short
title: Turns the wheel
doc: For tests.
trial:
  steps:
    - step: shake
      set: {wheel_servo.current: {sine: {amplitude: 0.1 A, frequency: 5 Hz}}}
      for: 0.4 s
finish:
  - step: hold
    set: {wheel_servo.current: 0 A}
    for: 0.1 s
measure:
  mean: {mean: wheel_servo.current, during: shake}
"""
#: Ctrl-C at the terminal as the command begins to read the measures of its own recording.
INTERRUPTED = """
import os, signal, sys
from rigd.analysis import measures
def measured_if_any(recording):
    os.kill(os.getpid(), signal.SIGINT)
measures.measured_if_any = measured_if_any
from rigd.__main__ import main
sys.argv = "rigd run short.yaml --rig lugre-1 --output out.mcap --junit out.xml".split()
sys.exit(main())
"""


def test_ctrl_c_while_measuring_shows_the_run(tmp_path: Path) -> None:
    (tmp_path / "short.yaml").write_text(MEASURING)
    command = [sys.executable, "-c", INTERRUPTED]
    ended = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, check=False)
    assert ended.returncode == Exit.STOPPED, ended.stderr
    assert "complete: all trials played" in ended.stdout
    assert "rigd measure out.mcap" in ended.stderr
    assert "Traceback" not in ended.stderr
    assert (tmp_path / "out.xml").exists()
