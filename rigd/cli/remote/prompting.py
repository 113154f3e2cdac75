"""Asks the prompts of a remote run at this terminal."""

from __future__ import annotations

import asyncio
from typing import Final, TextIO

from rigd.cli.asking import put, typed_line
from rigd.cli.console import question_of
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

    async def ask(self, question: str, screen: TextIO) -> str:
        """Put ``question`` and return its line; empty where the terminal went away."""
        loop, handle = asyncio.get_running_loop(), self._terminal.fileno()
        typed: asyncio.Future[str] = loop.create_future()

        def read() -> None:
            if not typed.done():
                typed.set_result(typed_line(self._terminal))

        put(question, self._terminal, screen)
        loop.add_reader(handle, read)
        try:
            return await typed
        finally:
            loop.remove_reader(handle)


async def ask(prompt: Prompt, objection: str, lines: Lines, screen: TextIO) -> Answer | None:
    """Ask until the answer can be read; None where the terminal went away."""
    remark = f"\n  {objection}\n" if objection else ""
    while True:
        line = await lines.ask(remark + question_of(prompt), screen)
        if not line:
            return None
        try:
            return read_answer(prompt, line.strip())
        except ValueError as error:
            remark = f"  {error}\n"


#: What a person is asked who presses Ctrl-C, and what each answer means.
LEAVING: Final = """
Ctrl-C: the run goes on meanwhile.
  s  stop it in order, then `finish`   (Ctrl-C again does so too)
  w  only stop watching: it goes on, and nobody has control
  Enter  neither
"""
