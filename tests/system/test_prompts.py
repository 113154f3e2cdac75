"""Prompts at a real terminal: asked, checked, recorded; blocked where nobody sits."""

from __future__ import annotations

import os
import pty
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from support.command import rigd

from rigd.record import Recording


@dataclass
class Terminal:
    """A command on a pty of its own."""

    process: subprocess.Popen[bytes]
    master: int
    seen: str = ""
    folder: Path = field(default_factory=Path)

    def expect(self, text: str) -> None:
        """Read until the screen shows ``text`` (each only once)."""
        while text not in self.seen:
            try:
                piece = os.read(self.master, 4096)
            except OSError:  # Linux reports the end of a pty so
                piece = b""
            if not piece:
                raise AssertionError(f"never showed {text!r}, only: {self.seen}")
            self.seen += piece.decode(errors="replace")
        self.seen = self.seen.partition(text)[2]

    def type(self, line: str) -> None:
        os.write(self.master, f"{line}\n".encode())

    def end(self) -> int:
        try:
            while os.read(self.master, 4096):
                pass
        except OSError:
            pass
        return self.process.wait(timeout=60)


@pytest.fixture
def terminal(tmp_path: Path) -> Iterator[Terminal]:
    master, slave = pty.openpty()
    process = subprocess.Popen(
        [
            sys.executable, "-m", "rigd", "run", "constant_current", "--rig", "lugre-1", "--ask",
            "--set", "floor=pvc", "--output", "run.mcap",
        ],
        cwd=tmp_path, stdin=slave, stdout=slave, stderr=slave, start_new_session=True,
    )  # fmt: skip
    os.close(slave)
    yield Terminal(process, master, folder=tmp_path)
    process.kill()
    process.wait()
    os.close(master)


def test_an_answer_is_asked_until_it_fits_and_then_recorded(terminal: Terminal) -> None:
    terminal.expect("Which floor lies there now?")
    terminal.type("carpet")
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


def test_without_a_terminal_a_run_that_must_ask_is_blocked(tmp_path: Path) -> None:
    done = rigd("run", "constant_current", "--rig", "lugre-1", "--ask", cwd=tmp_path)
    assert done.code == 3
    assert "prompt 'lay_floor' needs an operator" in done.err
    assert not list((tmp_path / "runs").glob("*"))
