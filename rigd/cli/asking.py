"""Asks every question of rigd at a terminal; discards input typed before the question."""

from __future__ import annotations

import os
import select
import sys
import termios
from collections.abc import Callable
from contextlib import suppress
from typing import Final, TextIO

#: A question that waits for a line is looked at this often: was it withdrawn? In s.
_LOOK_S: Final = 0.2
_MAX_BYTES: Final = 4096  # of a line on a terminal: N_TTY_BUF_SIZE of Linux


def is_terminal() -> bool:
    """Return whether a person sits at both ends."""
    return sys.stdin.isatty() and sys.stderr.isatty()


def put(question: str, terminal: TextIO, screen: TextIO) -> None:
    """Show ``question`` on ``screen``; what was typed at ``terminal`` before is dropped.

    A line typed a minute earlier was meant for something else. Read the answer by
    :func:`typed_line`.
    """
    screen.flush()
    with suppress(termios.error):  # a terminal that is gone: reading from it says so
        termios.tcflush(terminal.fileno(), termios.TCIFLUSH)
    screen.write(question)
    screen.flush()


def typed_line(terminal: TextIO) -> str:
    """Return the line that is typed next, or an empty text if the terminal goes away.

    It is read past the buffer of ``terminal``: a line that Python had read ahead is no answer
    either, and a thread that waits there would keep the interpreter from ending.
    """
    try:
        return os.read(terminal.fileno(), _MAX_BYTES).decode(errors="replace")
    except OSError:  # Linux reports a terminal that was closed so
        return ""


def ask(
    question: str,
    terminal: TextIO,
    screen: TextIO,
    is_withdrawn: Callable[[], bool] = lambda: False,
) -> str:
    """Put ``question`` and wait for its line.

    Returns an empty text if the terminal goes away, or once ``is_withdrawn`` says so.
    """
    put(question, terminal, screen)
    while not select.select([terminal], [], [], _LOOK_S)[0]:
        if is_withdrawn():
            return ""
    return "" if is_withdrawn() else typed_line(terminal)
