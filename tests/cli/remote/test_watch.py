"""A run elsewhere, watched at a terminal."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from support.commands.command import start
from support.commands.terminal import Terminal
from support.daemon.served_rig import Served, serve
from support.panel.played_campaign import WEIGH
from support.panel.played_rig import RUN

from rigd.remote.protocol import ClientUser

TIMEOUT_S = 60.0


@pytest.fixture
def remote() -> Iterator[Served]:
    with serve() as found:
        yield found


@pytest.fixture
def terminal(remote: Served, tmp_path: Path) -> Iterator[Terminal]:
    opened = Terminal.open(
        ["remote", "start", "quick", "--watch", "--endpoint", remote.endpoint, "--as", "alice"],
        tmp_path,
    )
    try:
        opened.expect(f"records {RUN}")
        yield opened
    finally:
        opened.close()


def until(true: Callable[[], object]) -> None:
    deadline_s = time.monotonic() + TIMEOUT_S
    while not true():
        assert time.monotonic() < deadline_s
        time.sleep(0.02)


def test_watched_run_gives_its_exit_code(remote: Served, terminal: Terminal) -> None:
    terminal.expect("current 0.55 A")
    remote.rig.end("incomplete")
    terminal.expect("incomplete: as a test wants it")
    terminal.expect("rigd remote fetch")
    assert terminal.end() == 6
    assert remote.rig.verbs() == ["lease_take", "start", "lease_release"]


def test_prompts_are_asked_and_wrong_answers_asked_again(
    remote: Served, terminal: Terminal
) -> None:
    remote.rig.prompt = WEIGH
    terminal.expect("Weigh the carriage")
    terminal.type("heavy")
    terminal.expect("cannot read 'heavy'")
    terminal.expect("Weigh the carriage")  # what is typed before the question is dropped
    terminal.type("1.2 kg")
    until(lambda: remote.rig.prompt is None)
    assert [args["value"] for args in remote.rig.given("answer")] == [1.2]
    remote.rig.end()
    assert terminal.end() == 0


def test_repeated_prompt_shows_the_reason(remote: Served, terminal: Terminal) -> None:
    remote.rig.prompt = WEIGH
    terminal.expect("Weigh the carriage")
    terminal.type("1.2 kg")
    until(lambda: remote.rig.prompt is None)
    remote.rig.prompt = WEIGH.model_copy(update={"id": 8, "objection": "the scale shows none"})
    said = terminal.expect("the scale shows none")
    assert "elsewhere" not in said
    terminal.expect("Weigh the carriage")
    remote.rig.end()
    assert terminal.end() == 0


def test_a_prompt_that_another_answers_leaves_the_terminal(
    remote: Served, terminal: Terminal
) -> None:
    remote.rig.prompt = WEIGH
    terminal.expect("value with unit")
    remote.rig.prompt = None
    terminal.expect("answered elsewhere")
    remote.rig.end()
    assert terminal.end() == 0


def test_ctrl_c_asks_and_may_end_only_watching(remote: Served, terminal: Terminal) -> None:
    terminal.process.send_signal(signal.SIGINT)
    terminal.expect("only stop watching")
    terminal.type("w")
    terminal.expect("continues:  rigd remote status --watch")
    assert terminal.end() == 0
    assert remote.rig.state == "running"
    assert remote.rig.lease.view().holder is None  # given back: no client has vanished
    assert "stop" not in remote.rig.verbs()


def test_ctrl_c_asks_and_run_may_be_stopped(remote: Served, terminal: Terminal) -> None:
    terminal.process.send_signal(signal.SIGINT)
    terminal.expect("only stop watching")
    terminal.type("s")
    until(lambda: "stop" in remote.rig.verbs())
    remote.rig.end("stopped")
    terminal.expect("stopped: as a test wants it")
    assert terminal.end() == 5


def test_ctrl_c_twice_stops_without_a_question(remote: Served, terminal: Terminal) -> None:
    remote.rig.keeps_running = True
    terminal.process.send_signal(signal.SIGINT)
    terminal.expect("only stop watching")
    for line in ("stopping. Again: abort", "aborting. Again: drop power", "dropping power"):
        terminal.process.send_signal(signal.SIGINT)
        terminal.expect(f"Ctrl-C: {line}")
    assert remote.rig.verbs()[-3:] == ["stop", "abort", "estop"]


def test_ctrl_z_pauses_and_resumes(remote: Served, terminal: Terminal) -> None:
    terminal.process.send_signal(signal.SIGTSTP)
    terminal.expect("pausing; Ctrl-Z resumes")
    remote.rig.become("paused")
    terminal.expect("paused: setpoints at rest")
    terminal.process.send_signal(signal.SIGTSTP)
    terminal.expect("resuming")
    assert remote.rig.verbs()[-2:] == ["pause", "resume"]


def test_ctrl_c_question_can_be_left_unanswered(remote: Served, terminal: Terminal) -> None:
    remote.rig.prompt = WEIGH
    terminal.expect("value with unit")
    terminal.process.send_signal(signal.SIGINT)
    terminal.expect("only stop watching")
    terminal.type("")
    terminal.expect("Weigh the carriage")  # it waits still
    terminal.type("1 kg")
    until(lambda: remote.rig.prompt is None)
    remote.rig.end()
    assert terminal.end() == 0


def test_request_for_control_is_shown(remote: Served, terminal: Terminal) -> None:
    remote.rig.lease.request(ClientUser.of("bob"))
    terminal.expect("bob requests control: rigd remote lease give bob")
    remote.rig.lease.give(ClientUser.of("alice"), ClientUser.of("bob"))
    remote.rig.prompt = WEIGH
    terminal.expect("waits for an answer: Weigh the carriage")  # now another's to answer
    remote.rig.end()
    assert terminal.end() == 0


def test_without_a_terminal_ctrl_c_stops_at_once(remote: Served, tmp_path: Path) -> None:
    running = start(
        ["remote", "start", "quick", "--watch", "--endpoint", remote.endpoint], tmp_path
    )
    running.wait_for(f"records {RUN}")
    running.signal(signal.SIGINT)
    until(lambda: "stop" in remote.rig.verbs())
    remote.rig.end("stopped")
    ended = running.end()
    assert ended.code == 5
    assert ended.out.startswith("stopped: as a test wants it")


def test_observer_ctrl_c_without_terminal_ends_only_watching(
    remote: Served, tmp_path: Path
) -> None:
    remote.rig.become("running")
    running = start(["remote", "status", "--watch", "--endpoint", remote.endpoint], tmp_path)
    running.wait_for(f"records {RUN}")
    running.signal(signal.SIGINT)
    ended = running.end()
    assert (ended.code, remote.rig.state) == (0, "running")
    assert f"rigd remote status --watch --endpoint {remote.endpoint}" in ended.err


def test_run_begun_by_another_is_watched_to_end(remote: Served, tmp_path: Path) -> None:
    remote.rig.become("running")
    running = start(["remote", "status", "--watch", "--endpoint", remote.endpoint], tmp_path)
    running.wait_for(f"records {RUN}")
    running.wait_for("trial 1/10: current 0.55 A")
    remote.rig.end()
    ended = running.end()
    assert (ended.code, ended.out.splitlines()[0]) == (
        0, "complete: as a test wants it; 10 of 10 trials, 93.4 s of rig time",
    )  # fmt: skip
