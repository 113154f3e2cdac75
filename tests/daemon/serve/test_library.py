"""The procedures that a daemon has."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from support.daemon import file_axis
from support.daemon.served_axis import SWEEP, travelling

from rigd.config.loader import load_rig
from rigd.daemon.serve.library import Library
from rigd.remote.protocol import Refusal
from rigd.remote.protocol.arguments import Checked
from rigd.remote.protocol.results import CheckReport


def library(tmp_path: Path) -> Library:
    own = tmp_path / "procedures"
    own.mkdir(exist_ok=True)
    (own / "sweep.yaml").write_text(SWEEP)
    (own / "broken.yaml").write_text("procedure: broken\n")
    (own / "quick.yaml").write_text(SWEEP.replace("procedure: sweep", "procedure: quick"))
    return Library(file_axis.rig(tmp_path / "axis"), own)


def test_own_procedures_come_before_shipped_of_same_name(tmp_path: Path) -> None:
    lines = {procedure.name: procedure for procedure in library(tmp_path).lines().procedures}
    assert lines["sweep"].problem is None
    assert lines["quick"].title == "Moves an axis"
    assert "is for another rig" in str(lines["approach_angles"].problem)
    problems = [line.problem is not None for line in lines.values()]
    assert problems == sorted(problems)  # what can run here stands first


def test_wrong_file_is_listed_and_nothing_replaces_it(tmp_path: Path) -> None:
    made = library(tmp_path)
    (tmp_path / "procedures" / "quick.yaml").write_text(SWEEP.replace("title:", "titel:"))
    lines = {procedure.name: procedure for procedure in made.lines().procedures}
    assert "title" in str(lines["broken"].problem)
    assert "key 'title' is missing" in str(lines["quick"].problem)
    assert str(tmp_path) not in str(lines["quick"].problem)
    with pytest.raises(Refusal, match=r"quick\.yaml:\d+:\d+: .*'title'"):
        made.view("quick")


def test_every_shipped_procedure_is_offered_and_runs_somewhere(tmp_path: Path) -> None:
    problems = [
        {
            procedure.name: procedure.problem
            for procedure in Library(load_rig(rig), tmp_path).lines().procedures
        }
        for rig in ("lugre-1", "angle-1")
    ]
    assert {name for name, problem in problems[0].items() if problem is None} >= {
        "quick", "constant_current", "recommended_identification",
    }  # fmt: skip
    assert problems[1]["approach_angles"] is None


def test_a_form_can_be_made_from_a_procedure(tmp_path: Path) -> None:
    view = library(tmp_path).view("sweep")
    speed, time = view.parameters
    assert (speed.name, speed.unit, speed.swept, speed.default) == ("speed", "m/s", True, None)
    assert (time.name, time.swept, time.default) == ("time", False, "0.3 s")
    assert view.procedure.text == SWEEP
    assert view.on_client_loss == "stop"
    with pytest.raises(Refusal, match=r"'swep'\n.*'sweep'"):
        library(tmp_path).view("swep")


def test_problem_is_reported_with_its_place(tmp_path: Path) -> None:
    good = Checked.model_validate({"procedure": travelling(SWEEP), "set": {"time": "2 s"}})
    assert library(tmp_path).check(good) == CheckReport(ok=True, trials=3, prompts=0)
    spoilt = travelling(SWEEP.replace("axis.speed", "axis.sped"))
    check = library(tmp_path).check(Checked.model_validate({"procedure": spoilt}))
    assert check is not None
    assert not check.ok
    assert "no setpoint 'axis.sped'" in check.problems[0].message
    assert (check.problems[0].line, check.problems[0].column) == (11, 13)
    beyond = Checked.model_validate({"procedure": travelling(SWEEP), "set": {"spede": "1 m/s"}})
    check = library(tmp_path).check(beyond)
    assert check is not None
    assert not check.ok


def test_pipe_among_procedures_delays_no_client(tmp_path: Path) -> None:
    own = library(tmp_path)
    os.mkfifo(tmp_path / "pipe.yaml")
    assert "pipe" not in [procedure.name for procedure in own.lines().procedures]


#: 200 trials of one step or prompt.
LONG = """\
procedure: long
title: Long
doc: For tests.
parameters: {speed: {doc: Speed, unit: m/s}}
sweep: {grid: {speed: {from: 0.001 m/s, to: 0.2 m/s, step: 0.001 m/s}}}
trial:
  steps:
"""
ENDS = ", ".join(f"axis.position > {millimetres} mm" for millimetres in range(1, 101))
MOVE = "    - {step: go, set: {axis.speed: '${speed}'}, for: 1 s}\n"


@pytest.mark.parametrize(
    "steps",
    [
        f"    - {{step: go, set: {{axis.speed: '${{speed}}'}}, until: [{ENDS}], timeout: 1 s}}\n",
        f"    - {{step: go, set: {{axis.speed: '${{speed}}'}}, timeout: 1 s,"
        f" until: '{ENDS.replace(', ', ' or ')}'}}\n",
        f"{MOVE}    - {{prompt: near, text: Is it?, until: [{ENDS}], timeout: 1 s}}\n",
        "    - {step: go, for: 1 s, set: {axis.speed: {table: {times: ["
        + ", ".join(f"{second} s" for second in range(100))
        + "], values: ["
        + ", ".join(["'${speed}'"] * 100)
        + "]}}}}\n",
    ],
    ids=["list", "joined", "prompt", "table"],
)
def test_check_of_long_steps_leaves_the_daemon(steps: str, tmp_path: Path) -> None:
    args = Checked.model_validate({"procedure": travelling(LONG + steps)})
    assert library(tmp_path).check(args) is None


def test_long_step_compiled_once_is_checked_immediately(tmp_path: Path) -> None:
    once = f"    - {{step: halt, set: {{axis.speed: 0 m/s}}, until: [{ENDS}], timeout: 1 s}}\n"
    args = Checked.model_validate({"procedure": travelling(LONG + MOVE + once)})
    assert library(tmp_path).check(args) == CheckReport(ok=True, trials=200, prompts=0)
