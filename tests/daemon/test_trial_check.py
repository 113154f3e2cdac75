"""The process that checks a trial of a rig in real time."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

from rigd.daemon.trial_check import Unchecked, check_apart
from rigd.engine.realtime import before_programs

POLICY = """#!{python}
import json, os
print(json.dumps([str(os.sched_getscheduler(0))]))
"""


def test_trial_is_checked_as_an_ordinary_program(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shows_policy = tmp_path / "python"
    shows_policy.write_text(POLICY.format(python=sys.executable))
    shows_policy.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(shows_policy))
    with before_programs():
        if os.sched_getscheduler(0) != os.SCHED_RR:
            pytest.skip("the kernel refuses real-time priority")
        assert check_apart(tmp_path / "run.mcap", 1) == [str(os.SCHED_OTHER)]


def test_check_that_cannot_start_is_unchecked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "executable", str(tmp_path / "no_python"))
    with pytest.raises(Unchecked, match="No such file"):
        check_apart(tmp_path / "run.mcap", 1)
