"""Prompts of a run elsewhere, asked at this terminal."""

from __future__ import annotations

import asyncio
import sys
import threading
from typing import Final, TextIO

from rigd.cli.console import invitation
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
    """What a person types, line by line; made on the event loop that reads.

    A thread reads, as a terminal can only be waited for; it dies with the process.
    """

    def __init__(self, source: TextIO) -> None:
        self._source = source
        self._loop = asyncio.get_running_loop()
        self._typed: asyncio.Queue[str] = asyncio.Queue()
        self._reading = False

    async def next(self) -> str:
        """Return the next line that is typed from now on; empty where the terminal went away."""
        while not self._typed.empty():
            self._typed.get_nowait()  # typed before the question stood there
        if not self._reading:
            self._reading = True
            threading.Thread(target=self._read, name="terminal", daemon=True).start()
        return await self._typed.get()

    def _read(self) -> None:
        line = "more"
        while line:
            line = self._source.readline()
            try:
                self._loop.call_soon_threadsafe(self._typed.put_nowait, line)
            except RuntimeError:  # the loop has ended: nobody reads any more
                return


async def ask(prompt: Prompt, objection: str, lines: Lines, screen: TextIO) -> Answer | None:
    """Ask until the answer can be read; None where the terminal went away."""
    if objection:
        screen.write(f"\n  {objection}\n")
    while True:
        screen.write(f"\n{prompt.text}\n{invitation(prompt)}: ")
        screen.flush()
        line = await lines.next()
        if not line:
            return None
        try:
            return read_answer(prompt, line.strip())
        except ValueError as error:
            screen.write(f"  {error}\n")


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
