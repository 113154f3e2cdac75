"""Prompts of a run elsewhere, asked at this terminal."""

from __future__ import annotations

import asyncio
import os
import sys
import termios
from typing import Final, TextIO

from rigd.cli.console import invitation, wrapped
from rigd.engine.answers import read_answer
from rigd.procedure.program import Answer, AnswerKind, Prompt
from rigd.remote.protocol.status import PromptView


def as_prompt(view: PromptView) -> Prompt:
    """Return the prompt that a status shows, as far as whoever answers it needs."""
    return Prompt(
        view.name,
        view.text,
        AnswerKind(view.kind),
        unit=view.unit,
        choices=view.choices,
        low=view.low,
        high=view.high,
        answer=view.answer,
    )


class Lines:
    """What a person types at the terminal, line by line; used on one event loop."""

    def __init__(self, terminal: TextIO) -> None:
        self._terminal = terminal

    def forget(self) -> None:
        """Drop what was typed before a question stands there."""
        termios.tcflush(self._terminal.fileno(), termios.TCIFLUSH)

    async def next(self) -> str:
        """Return the next line; empty where the terminal went away."""
        loop, handle = asyncio.get_running_loop(), self._terminal.fileno()
        typed: asyncio.Future[bytes] = loop.create_future()

        def read() -> None:
            if not typed.done():
                typed.set_result(_read(handle))

        # No thread that reads through Python's own buffer: blocked there when the process ends, it
        # would bring the interpreter down.
        loop.add_reader(handle, read)
        try:
            return (await typed).decode(errors="replace")
        finally:
            loop.remove_reader(handle)


async def ask(prompt: Prompt, objection: str, lines: Lines, screen: TextIO) -> Answer | None:
    """Ask until the answer can be read; None where the terminal went away."""
    if objection:
        screen.write(f"\n  {objection}\n")
    while True:
        lines.forget()
        screen.write(f"\n{wrapped(prompt.text)}\n{invitation(prompt)}: ")
        screen.flush()
        line = await lines.next()
        if not line:
            return None
        try:
            return read_answer(prompt, line.strip())
        except ValueError as error:
            screen.write(f"  {error}\n")


def _read(handle: int) -> bytes:
    """Return what a terminal has: a line, or nothing where it went away."""
    try:
        return os.read(handle, 4096)
    except OSError:  # Linux reports a terminal that was closed so
        return b""


def is_terminal() -> bool:
    """Return whether a person sits at both ends."""
    return sys.stdin.isatty() and sys.stderr.isatty()


#: What a person is asked who presses Ctrl-C, and what each answer means.
LEAVING: Final = """
Ctrl-C: the run goes on meanwhile.
  s  stop it in order, then `finish`   (Ctrl-C again does so too)
  w  only stop watching: it goes on, and nobody has control
  Enter  neither
"""
