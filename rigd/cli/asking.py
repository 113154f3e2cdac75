"""Asks the user rigd's questions at a terminal; discards input typed before the question."""

from __future__ import annotations

import os
import select
import shutil
import sys
import textwrap
import time
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from typing import Final, TextIO

from rigd.engine.run.answers import read_answer
from rigd.model.units import format_quantity
from rigd.procedure.program import Answer, AnswerKind, Prompt

#: How often a question that waits for a line checks whether it was withdrawn, in s.
_LOOK_S: Final = 0.2
_MAX_BYTES: Final = 4096  # of a line on a terminal: N_TTY_BUF_SIZE of Linux


def is_terminal() -> bool:
    """Return whether both standard input and standard error are a terminal."""
    return sys.stdin.isatty() and sys.stderr.isatty()


def ask(
    question: str,
    terminal: TextIO,
    screen: TextIO,
    is_withdrawn: Callable[[], bool] = lambda: False,
) -> str:
    """Show ``question`` on ``screen`` and return the next line that is typed at ``terminal``.

    Input typed before the question is discarded: it was meant for something else. Returns an empty
    text if the terminal closes, or if ``is_withdrawn`` returns true.
    """
    screen.flush()
    if sys.platform == "win32":
        return _ask_console(question, terminal, screen, is_withdrawn)
    import termios

    with suppress(termios.error):  # a closed terminal: reading from it raises this
        termios.tcflush(terminal.fileno(), termios.TCIFLUSH)
    screen.write(question)
    screen.flush()
    while not select.select([terminal], [], [], _LOOK_S)[0]:
        if is_withdrawn():
            return ""
    return "" if is_withdrawn() else _typed_line(terminal)


def _ask_console(
    question: str, terminal: TextIO, screen: TextIO, is_withdrawn: Callable[[], bool]
) -> str:
    """Do as :func:`ask` at a console of Windows, which waits for keys and not for lines.

    A question can be withdrawn until the first key of its answer.
    """
    console = import_module("msvcrt")  # which Windows alone has
    while console.kbhit():
        console.getwch()
    screen.write(question)
    screen.flush()
    while not console.kbhit():
        if is_withdrawn():
            return ""
        time.sleep(_LOOK_S)
    return "" if is_withdrawn() else terminal.readline()


def _typed_line(terminal: TextIO) -> str:
    """Return the next typed line, or an empty text if the terminal closes.

    Reads past the buffer of ``terminal``: a line that Python has read ahead is not an answer.
    """
    try:
        return os.read(terminal.fileno(), _MAX_BYTES).decode(errors="replace")
    except OSError:  # Linux raises this for a closed terminal
        return ""


def ask_prompt(
    prompt: Prompt,
    objection: str,
    terminal: TextIO,
    screen: TextIO,
    is_withdrawn: Callable[[], bool],
) -> Answer | None:
    """Ask until the answer can be parsed, and return it; return None if :func:`ask` returns "".

    ``objection`` is the reason why the previous answer was refused.
    """
    remark = f"\n{wrapped(objection, indent='  ')}\n" if objection else ""
    while line := ask(
        f"{remark}\n{wrapped(prompt.text)}\n{invitation(prompt)}: ", terminal, screen, is_withdrawn
    ):
        try:
            return read_answer(prompt, line.strip())
        except ValueError as error:
            remark = f"  {error}\n"
    return None


def wrapped(text: str, indent: str = "") -> str:
    """Return ``text`` wrapped between words to the width of the terminal."""
    columns = shutil.get_terminal_size().columns
    return "\n".join(
        textwrap.fill(line, columns, initial_indent=indent, subsequent_indent=indent)
        for line in text.splitlines()
    )


def invitation(prompt: Prompt) -> str:
    """Return the form in which a prompt is answered."""
    match prompt.kind:
        case AnswerKind.CONFIRM:
            return "done? [yes/no]"
        case AnswerKind.CHOICE if len(prompt.choices) == 1:
            return f"type {prompt.choices[0]}"
        case AnswerKind.CHOICE:
            return f"one of {', '.join(prompt.choices)}"
        case AnswerKind.NUMBER if prompt.low is not None and prompt.high is not None:
            bounds = (format_quantity(item, prompt.unit) for item in (prompt.low, prompt.high))
            return f"value with unit, {' to '.join(bounds)}"
        case AnswerKind.NUMBER:
            return f"value with unit, such as '1 {prompt.unit}'"
        case AnswerKind.TEXT:
            return "text"
