"""The process that checks a trial of a rig in real time."""

from __future__ import annotations

import os
import sys
import threading
from pathlib import Path

import pytest

from rigd.daemon.trial_check import CheckApart, Unchecked
from rigd.engine.system.realtime import before_programs

POLICY = """#!{python}
import json, os
print(json.dumps([str(os.sched_getscheduler(0))]))
"""

HANGS = """#!{python}
import os, pathlib, time
draft = pathlib.Path("{path}.draft")
draft.write_text(str(os.getpid()))
draft.rename("{path}")
time.sleep(50)
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
        assert CheckApart(tmp_path / "run.mcap").check(1) == [str(os.SCHED_OTHER)]


def test_check_that_cannot_start_is_unchecked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "executable", str(tmp_path / "no_python"))
    with pytest.raises(Unchecked, match="No such file"):
        CheckApart(tmp_path / "run.mcap").check(1)


def test_check_that_is_given_up_ends(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shows_pid = tmp_path / "python"
    shows_pid.write_text(HANGS.format(python=sys.executable, path=tmp_path / "pid"))
    shows_pid.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(shows_pid))
    check = CheckApart(tmp_path / "run.mcap")
    told: list[str] = []

    def checked() -> None:
        with pytest.raises(Unchecked, match="it was given up") as caught:
            check.check(1)
        told.append(caught.value.message)

    waiting = threading.Thread(target=checked)
    waiting.start()
    while not (tmp_path / "pid").exists():
        waiting.join(0.01)
    check.give_up()
    waiting.join()
    assert told
    with pytest.raises(ProcessLookupError):
        os.kill(int((tmp_path / "pid").read_text()), 0)
