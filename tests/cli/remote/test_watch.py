"""A run elsewhere, watched at a terminal."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from support.answering_rig import QUESTION, Served, served
from support.command import start
from support.terminal import Terminal

from rigd.remote.protocol.arguments import Answered, NoArguments, Receiver
from rigd.remote.protocol.status import TrialStatus
from rigd.remote.server import Result

TIMEOUT_S = 60.0


@pytest.fixture
def remote() -> Iterator[Served]:
    with served() as found:
        yield found


@pytest.fixture
def terminal(remote: Served, tmp_path: Path) -> Iterator[Terminal]:
    opened = Terminal.open(
        ["remote", "start", "small", "--watch", "--endpoint", remote.endpoint, "--as", "alice"],
        tmp_path,
    )
    try:
        opened.expect("records run")
        yield opened
    finally:
        opened.close()


def until(true: Callable[[], object]) -> None:
    deadline_s = time.monotonic() + TIMEOUT_S
    while not true():
        assert time.monotonic() < deadline_s
        time.sleep(0.02)


def test_it_is_watched_to_its_end_and_exits_as_it_did(remote: Served, terminal: Terminal) -> None:
    terminal.expect("running")
    remote.rig.end("incomplete", 6)
    terminal.expect("incomplete: as a test wants it")
    terminal.expect("rigd remote fetch")
    assert terminal.end() == 6
    assert remote.rig.verbs() == ["lease_take", "start", "lease_release"]


def test_prompts_are_asked_and_what_cannot_be_is_asked_again(
    remote: Served, terminal: Terminal
) -> None:
    remote.rig.prompt = QUESTION
    terminal.expect("Put the weight on")
    terminal.type("heavy")
    terminal.expect("cannot read 'heavy'")
    terminal.expect("Put the weight on")  # what is typed before the question is dropped
    terminal.type("1.2 kg")
    until(lambda: remote.rig.prompt is None)
    given = [args.value for _, _, args in remote.rig.done if isinstance(args, Answered)]
    assert given == [1.2]
    remote.rig.end()
    assert terminal.end() == 0


def test_a_prompt_that_is_put_again_says_why(
    remote: Served, terminal: Terminal, monkeypatch: pytest.MonkeyPatch
) -> None:
    carry_out = remote.rig.command

    def command(*args: Any) -> Result:
        result = carry_out(*args)
        remote.show()  # the status without the prompt is there before the reply
        return result

    monkeypatch.setattr(remote.rig, "command", command)
    remote.rig.prompt = QUESTION
    terminal.expect("Put the weight on")
    terminal.type("1.2 kg")
    until(lambda: remote.rig.prompt is None)
    remote.rig.prompt = QUESTION.model_copy(update={"id": 8, "objection": "the scale shows none"})
    said = terminal.expect("the scale shows none")
    assert "elsewhere" not in said
    terminal.expect("Put the weight on")
    remote.rig.end()
    assert terminal.end() == 0


def test_a_prompt_that_another_answers_leaves_the_terminal(
    remote: Served, terminal: Terminal
) -> None:
    remote.rig.prompt = QUESTION
    terminal.expect("value with unit")
    remote.rig.prompt = None
    terminal.expect("answered elsewhere")
    remote.rig.end()
    assert terminal.end() == 0


def test_ctrl_c_asks_and_only_the_watching_may_end(remote: Served, terminal: Terminal) -> None:
    terminal.process.send_signal(signal.SIGINT)
    terminal.expect("only stop watching")
    terminal.type("w")
    terminal.expect("goes on:  rigd remote status --watch")
    assert terminal.end() == 0
    assert remote.rig.running is not None
    assert remote.rig.lease.view().holder is None  # given back: nobody has vanished
    assert "stop" not in remote.rig.verbs()


def test_ctrl_c_asks_and_the_run_may_be_stopped(remote: Served, terminal: Terminal) -> None:
    terminal.process.send_signal(signal.SIGINT)
    terminal.expect("only stop watching")
    terminal.type("s")
    terminal.expect("stopped: as a test wants it")
    assert terminal.end() == 5


def test_ctrl_c_twice_stops_without_a_question(remote: Served, terminal: Terminal) -> None:
    remote.rig.keeps_running = True
    terminal.process.send_signal(signal.SIGINT)
    terminal.expect("only stop watching")
    for verb in ("stop", "abort", "estop"):
        terminal.process.send_signal(signal.SIGINT)
        terminal.expect(f"{verb} asked for")
    assert [verb for _, verb, _ in remote.rig.done][-3:] == ["stop", "abort", "estop"]


def test_ctrl_c_asks_and_neither_may_be_meant(remote: Served, terminal: Terminal) -> None:
    remote.rig.prompt = QUESTION
    terminal.expect("value with unit")
    terminal.process.send_signal(signal.SIGINT)
    terminal.expect("only stop watching")
    terminal.type("")
    terminal.expect("Put the weight on")  # it waits still
    terminal.type("1 kg")
    until(lambda: remote.rig.prompt is None)
    remote.rig.end()
    assert terminal.end() == 0


def test_who_asks_for_control_is_shown(remote: Served, terminal: Terminal) -> None:
    remote.rig.lease.obey("bob", "lease_request", NoArguments())
    terminal.expect("bob asks for control: rigd remote lease give bob")
    remote.rig.lease.obey("alice", "lease_give", Receiver(to="bob"))
    remote.rig.prompt = QUESTION
    terminal.expect("waits for an answer: Put the weight on")  # now another's to answer
    remote.rig.end()
    assert terminal.end() == 0


def test_without_a_terminal_ctrl_c_stops_at_once(remote: Served, tmp_path: Path) -> None:
    running = start(
        ["remote", "start", "small", "--watch", "--endpoint", remote.endpoint], tmp_path
    )
    running.wait_for("records run")
    running.signal(signal.SIGINT)
    ended = running.end()
    assert ended.code == 5
    assert ended.out.startswith("stopped: as a test wants it")


def test_without_a_terminal_ctrl_c_ends_only_the_look_of_who_only_looks(
    remote: Served, tmp_path: Path
) -> None:
    remote.rig.running = "a.mcap"
    remote.show()
    running = start(["remote", "status", "--watch", "--endpoint", remote.endpoint], tmp_path)
    running.wait_for("records a.mcap")
    running.signal(signal.SIGINT)
    ended = running.end()
    assert (ended.code, remote.rig.running) == (0, "a.mcap")
    assert f"rigd remote status --watch --endpoint {remote.endpoint}" in ended.err


def test_a_run_that_another_began_is_watched_to_its_end(remote: Served, tmp_path: Path) -> None:
    remote.rig.running = "a.mcap"
    remote.show()
    running = start(["remote", "status", "--watch", "--endpoint", remote.endpoint], tmp_path)
    running.wait_for("records a.mcap")
    remote.rig.trial = TrialStatus(
        number=1, repeat=1, parameters={"current": 0.5}, label="current 0.5 A"
    )
    running.wait_for("trial 1/3: current 0.5 A")
    remote.rig.end()
    ended = running.end()
    assert (ended.code, ended.out.splitlines()[0]) == (
        0, "complete: as a test wants it; 3 of 3 trials, 2.0 s of rig time",
    )  # fmt: skip
