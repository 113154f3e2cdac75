"""A question at a terminal is answered by what is typed after it stands there."""

from __future__ import annotations

import ast
import io
import os
import pty
import re
import sys
import termios
import threading
import tty
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import TextIO

import pytest

from rigd.cli.asking import ask

SOURCES = Path(__file__).resolve().parents[2] / "rigd"
#: The spare panel waits for a line of its daemon, on a pipe; `rigd new rig` reads answers from one.
NOT_TYPED = [
    "cli/rig/panel.py: sys.stdin.readline",
    "cli/plugins/new_rig/questions.py: sys.stdin.readline",
]
READS = re.compile(r"input$|getpass\.getpass$|sys\.stdin\.(?!isatty$|fileno$)")


@dataclass
class Bench:
    """Both ends of a terminal: the program reads ``lines``, the person types at ``keys``."""

    keys: int
    lines: TextIO

    def type(self, text: str) -> None:
        os.write(self.keys, text.encode())


@pytest.fixture
def bench() -> Iterator[Bench]:
    keys, end = pty.openpty()
    with os.fdopen(end, encoding="utf-8") as lines:
        yield Bench(keys, lines)
    os.close(keys)


class Screen(io.StringIO):
    """A person who types ``answer`` once the question stands there."""

    def __init__(self, bench: Bench, answer: str) -> None:
        super().__init__()
        self._bench = bench
        self._answer = answer

    def write(self, text: str) -> int:
        written = super().write(text)
        self._bench.type(self._answer)
        return written


@pytest.mark.parametrize("ahead", ["yes\n", "yes\nyes\nyes\n", "ye"], ids=["line", "lines", "half"])
def test_input_before_the_question_is_no_answer(bench: Bench, ahead: str) -> None:
    bench.type(ahead)
    assert ask("sure? ", bench.lines, Screen(bench, "no\n")) == "no\n"


def test_line_that_python_read_ahead_is_no_answer(bench: Bench) -> None:
    before = termios.tcgetattr(bench.lines)
    tty.setcbreak(bench.lines.fileno())  # as many lines as there are come in one read
    bench.type("first\nyes\n")
    assert bench.lines.readline() == "first\n"
    termios.tcsetattr(bench.lines, termios.TCSANOW, before)
    assert ask("sure? ", bench.lines, Screen(bench, "no\n")) == "no\n"


def test_closed_terminal_gives_an_empty_answer() -> None:
    keys, end = pty.openpty()
    with os.fdopen(end, encoding="utf-8") as lines:
        os.close(keys)
        assert ask("sure? ", lines, io.StringIO()) == ""


def test_withdrawn_question_takes_no_line_of_next(bench: Bench) -> None:
    shown = threading.Event()
    withdrawn = threading.Event()

    class Shows(io.StringIO):
        def flush(self) -> None:
            if self.getvalue():
                shown.set()

    given: list[str] = []
    waiting = threading.Thread(
        target=lambda: given.append(ask("first? ", bench.lines, Shows(), withdrawn.is_set)),
        daemon=True,
    )
    waiting.start()
    assert shown.wait(10)
    withdrawn.set()
    waiting.join(10)
    assert given == [""]
    assert ask("second? ", bench.lines, Screen(bench, "yes\n")) == "yes\n"


def test_only_this_module_reads_what_a_person_types() -> None:
    """A question elsewhere would be answered by what was typed before."""
    read = []
    for file in SOURCES.rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text("utf-8"))):
            called = ast.unparse(node.func) if isinstance(node, ast.Call) else ""
            if READS.match(called):
                read.append(f"{file.relative_to(SOURCES)}: {called}")
    assert sorted(read) == sorted(NOT_TYPED), "ask by rigd.cli.asking"


class Console(ModuleType):
    """The keys of a console of Windows; what was typed too early stands in ``early``."""

    def __init__(self, early: str) -> None:
        super().__init__("msvcrt")
        self.early = list(early)
        self.asked = False

    def kbhit(self) -> bool:
        return self.asked or bool(self.early)

    def getwch(self) -> str:
        return self.early.pop(0)


def test_windows_console_drops_what_came_early(monkeypatch: pytest.MonkeyPatch) -> None:
    console = Console("yes")
    monkeypatch.setitem(sys.modules, "msvcrt", console)
    monkeypatch.setattr("sys.platform", "win32")

    class Shown(io.StringIO):
        def write(self, text: str) -> int:
            console.asked = True
            return super().write(text)

    assert ask("done? ", io.StringIO("no\n"), Shown()) == "no\n"
    assert console.early == []


def test_question_at_windows_console_is_withdrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "msvcrt", Console(""))
    monkeypatch.setattr("sys.platform", "win32")
    assert ask("done? ", io.StringIO("no\n"), io.StringIO(), lambda: True) == ""
