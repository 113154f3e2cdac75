"""Prompts at a real terminal: asked, checked, recorded; blocked without an operator."""

from __future__ import annotations

import os
import re
import signal
from collections.abc import Callable
from pathlib import Path

import pytest
from support.commands.command import rigd
from support.commands.terminal import Terminal
from support.wire import write_rig

from rigd.record import Recording


@pytest.fixture
def terminal(open_terminal: Callable[..., Terminal]) -> Terminal:
    short = ("--set", "brake_at=0.3 m", "--set", "longest_drive=1 s")
    return open_terminal(
        "constant_current", "--rig", "lugre-1", "--ask", "--set", "floor=pvc", *short
    )


def test_answer_is_asked_until_valid_and_then_recorded(terminal: Terminal) -> None:
    terminal.expect("Which floor lies there now?")
    terminal.expect("type pvc:")
    terminal.type("carpet")
    terminal.expect(" carpet")  # echoed behind the question, on its line
    terminal.expect("'carpet' is not one of pvc")
    terminal.type("pvc")
    assert terminal.end() == 0
    events = Recording.open(terminal.folder / "run.mcap").events()
    (answer,) = [event for event in events if event.kind == "answer"]
    assert (answer.data["answer"], answer.data["by"]) == ("pvc", "operator")


def test_ctrl_c_at_a_prompt_ends_the_run(terminal: Terminal) -> None:
    terminal.expect("Which floor lies there now?")
    os.kill(terminal.process.pid, signal.SIGINT)
    assert terminal.end() == 5
    assert not [
        event
        for event in Recording.open(terminal.folder / "run.mcap").events()
        if event.kind == "trial_start"
    ]


def test_without_terminal_run_that_must_ask_is_blocked(tmp_path: Path) -> None:
    done = rigd("run", "constant_current", "--rig", "lugre-1", "--ask", cwd=tmp_path)
    assert done.code == 3
    assert "prompt 'lay_floor' needs an operator" in done.err
    assert not list((tmp_path / "runs").glob("*"))


CHECKED = """\
procedure: checked
title: Asks where the carriage stands
doc: For tests.
trial:
  steps:
    - prompt: where
      text: Where does the carriage stand by the tape?
      unit: mm
      min: -1 m
      max: 1 m
      answer: 300 mm
      agrees: {with: carriage.position, within: 5 mm, for: 0.1 s}
      timeout: 1 s
    - prompt: let_go
      text: Have you let go?
      until: "|longitudinal_belt.speed| < 1 mm/s for 0.1 s"
      timeout: 5 s
    - step: rest
      for: 0.1 s
record: {carriage: 1}
"""


def checks(folder: Path) -> list[tuple[object, object]]:
    events = Recording.open(folder / "run.mcap").events()
    return [(e.data["answer"], e.data["agreed"]) for e in events if e.kind == "answer_checked"]


@pytest.mark.parametrize("form", [(), ("--pace", "1")], ids=["virtual", "processes"])
def test_person_is_asked_until_rig_agrees(
    open_terminal: Callable[..., Terminal], tmp_path: Path, form: tuple[str, ...]
) -> None:
    (tmp_path / "checked.yaml").write_text(CHECKED, "utf-8")
    terminal = open_terminal("checked.yaml", "--rig", "lugre-1", "--ask", *form)
    terminal.expect("Where does the carriage stand")
    terminal.expect("value with unit, -1000 mm to 1000 mm: ")
    terminal.type("300")
    terminal.expect("'300' is not in mm: write '300 mm'")
    terminal.type("3 m")
    terminal.expect("3000 mm is outside -1000 mm .. 1000 mm")
    terminal.expect("Where does the carriage stand")
    terminal.type("20 cm")
    terminal.expect("the answer was 200 mm, but carriage.position is ")
    terminal.expect("expected 195 mm to 205 mm")
    terminal.type("1 mm")
    terminal.expect("Have you let go?")
    terminal.type("yes")
    assert terminal.end() == 0
    assert checks(tmp_path) == [(0.2, False), (0.001, True), (True, True)]


def test_lines_typed_before_question_do_not_answer_it(
    open_terminal: Callable[..., Terminal], tmp_path: Path
) -> None:
    (tmp_path / "checked.yaml").write_text(CHECKED, "utf-8")
    terminal = open_terminal("checked.yaml", "--rig", "lugre-1", "--ask")
    terminal.type("1 mm")  # while it starts
    terminal.type("yes")
    terminal.expect("value with unit, -1000 mm to 1000 mm: ")
    terminal.type("1 mm\nyes\nyes")  # more lines than the question has asked for
    terminal.expect("Have you let go?\r\ndone? [yes/no]: ")
    terminal.type("no")
    assert terminal.end() == 6
    assert "prompt 'let_go' was declined" in terminal.seen
    assert checks(tmp_path) == [(0.001, True)]


def test_file_answer_contradicted_by_rig_ends_the_run(tmp_path: Path) -> None:
    (tmp_path / "checked.yaml").write_text(CHECKED, "utf-8")
    done = rigd("run", "checked.yaml", "--rig", "lugre-1", "--output", "run.mcap", cwd=tmp_path)
    assert done.code == 6
    assert "the answer was 300 mm, but carriage.position is" in done.out
    assert checks(tmp_path) == [(0.3, False)]
    assert [
        event.data["name"]
        for event in Recording.open(tmp_path / "run.mcap").events()
        if event.kind == "step"
    ] == ["where"]
    dry = rigd("run", "checked.yaml", "--rig", "lugre-1", "--dry-run", cwd=tmp_path)
    assert dry.code == 3
    assert "the answer was 300 mm" in dry.out


def test_real_rig_takes_file_answers_only_by_choice(tmp_path: Path) -> None:
    rig = write_rig(tmp_path, "wire-asked").rig
    text = rig.read_text("utf-8")
    real, count = re.subn(r"(?m)^simulation:\n(?: .*\n)+", "", text)
    assert count == 1
    rig.write_text(real, "utf-8")
    asked = "prompt 'lay_floor' needs an operator: run in a terminal"
    for given, is_blocked_by_it in (((), True), (("--yes",), False)):
        done = rigd("run", "constant_current", "--rig", rig, *given, cwd=tmp_path)
        assert done.code == 3  # its devices are not there, in any case
        assert (asked in done.err) is is_blocked_by_it
