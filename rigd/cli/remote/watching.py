"""Follows a remote run to its end: progress, prompts, Ctrl-C."""

from __future__ import annotations

import argparse
import asyncio
import signal
import sys
from collections.abc import AsyncGenerator, Coroutine
from contextlib import aclosing
from typing import TYPE_CHECKING, Final

from rigd.cli.asking import is_terminal
from rigd.cli.remote.command import again, print_json
from rigd.cli.remote.display import RemoteDisplay, conclude
from rigd.cli.remote.prompting import LEAVING, Lines, as_prompt, ask
from rigd.model.errors import Exit, LinkError, RigdError
from rigd.model.severity import STOPS
from rigd.remote.client.watching import RunWatch
from rigd.remote.protocol import Status
from rigd.remote.protocol.status import LastRun, PromptView

if TYPE_CHECKING:
    from rigd.remote import AsyncClient

#: A daemon that is started anew needs some seconds; after so many it is given up, in s.
PATIENCE_S: Final = 30.0
#: A silence as long is shown, in s; the daemon speaks twice a second.
SILENCE_S: Final = 2.0
_LOOK_S: Final = 0.5
#: The two questions that may stand at the terminal.
_PROMPT: Final = "prompt"
_LEAVE: Final = "leave"


async def watch(
    rig: AsyncClient,
    run: str,
    args: argparse.Namespace,
    *,
    steers: bool,
) -> int:
    """Show ``run`` until it ends, or a person leaves it; return the exit code.

    Prompts are asked at this terminal while this client has control. ``steers``: whether the run
    is this command's own, so that Ctrl-C stops it where nobody can be asked what is meant.
    """
    where = again(args)
    with RemoteDisplay(quiet=args.quiet or args.json) as display:
        last = await Watch(rig, run, display, where, steers=steers).follow()
    if last is None:
        print(f"{run} goes on:  rigd remote status --watch{where}", file=sys.stderr)
        return int(Exit.OK)
    try:
        line = (await rig.run(run)).line if last.recorded else None
    except LinkError:  # the daemon left with its run, and has said how that ended
        line = None
    if args.json:
        print_json(
            {
                "recording": last.run,
                "state": last.ending,
                "reason": last.reason,
                "exit_code": last.exit_code,
                "trials_done": line and line.trials_done,
                "trials_total": line and line.trials_total,
                "run_s": line and line.duration_s,
            }
        )
    else:
        conclude(last, line, where)
    return last.exit_code


class Watch:
    """Follows one run at a terminal; :meth:`follow` is called once."""

    def __init__(
        self, rig: AsyncClient, run: str, display: RemoteDisplay, where: str, *, steers: bool
    ) -> None:
        self._rig = rig
        self._run = run
        self._display = display
        self._where = where
        self._steers = steers
        self._lines = Lines(sys.stdin)
        self._question: asyncio.Task[None] | None = None  # the one that stands at the terminal
        self._prompt: PromptView | None = None  # the prompt that was shown last
        self._answering = False  # an answer is on its way: its prompt may be gone before the reply
        self._firmer = [stop.word for stop in STOPS]  # what Ctrl-C asks for next, the mildest first
        self._stops: list[asyncio.Task[None]] = []
        self._left = False
        self._told_asking: tuple[str, ...] = ()

    async def follow(self) -> LastRun | None:
        """Return how the run ended, or None where a person has left it.

        Raises:
            LinkError: the daemon is gone.
        """
        loop = asyncio.get_running_loop()
        loop.add_signal_handler(signal.SIGINT, self._press)
        self._display.announce(f"{self._rig.rig} records {self._run}")
        if is_terminal():
            self._display.announce("Ctrl-C asks what to do")
        try:
            return await self._follow()
        finally:
            loop.remove_signal_handler(signal.SIGINT)
            self._withdraw()
            await asyncio.gather(*self._stops)

    async def _follow(self) -> LastRun | None:
        run = RunWatch(self._run)
        async with aclosing(self._rig.watch(patience_s=None)) as statuses:
            coming = asyncio.create_task(_next(statuses))
            try:
                while not self._left:
                    if not (await asyncio.wait([coming], timeout=_LOOK_S))[0]:
                        self._see_silence()
                        continue
                    status = coming.result()
                    ended = run.ended(status)
                    if ended is not None:
                        return ended
                    self._display.show(status)
                    self._see_lease(status)
                    self._see_prompt(status)
                    coming = asyncio.create_task(_next(statuses))
            finally:
                coming.cancel()
                await asyncio.wait([coming])
        return None

    def _see_silence(self) -> None:
        silent_s = self._rig.connection.silent_s
        if silent_s > PATIENCE_S:
            raise LinkError(
                f"{self._rig.rig} has said nothing for {silent_s:.0f} s",
                hint="look at the rig itself; is its daemon running, and the network there?",
            )
        if silent_s > SILENCE_S:
            self._display.show_silence(silent_s)

    def _see_lease(self, status: Status) -> None:
        asked_by = status.lease.asked_by
        if self._holds(status) and asked_by != self._told_asking:
            for name in asked_by:
                self._display.tell(
                    f"{name} asks for control: rigd remote lease give {name}{self._where}"
                )
        self._told_asking = asked_by

    def _see_prompt(self, status: Status) -> None:
        """Ask the prompt that waits, and take one off the terminal that waits no more."""
        prompt, before = status.prompt, self._prompt
        if before is not None and (prompt is None or prompt.id != before.id):
            if self._asks_prompt and not self._answering:
                self._withdraw()
                self._display.tell("answered elsewhere, or withdrawn")
            self._prompt = None
        if prompt is None or self._prompt is not None or self._question is not None:
            return
        self._prompt = prompt
        if is_terminal() and self._holds(status):
            self._ask(self._answer(prompt), _PROMPT)
        else:
            self._display.tell(f"waits for an answer: {prompt.text}  ({self._how_to_answer})")

    async def _answer(self, prompt: PromptView) -> None:
        given = await ask(as_prompt(prompt), prompt.objection, self._lines, sys.stderr)
        if given is None:
            self._display.tell(f"this terminal is gone: {self._how_to_answer}")
            return
        self._answering = True
        try:
            await self._rig.answer(given, prompt.id)
        except RigdError as error:
            self._display.tell(error.told)
            self._prompt = None  # where it still waits, it is asked again
        finally:
            self._answering = False

    def _press(self) -> None:
        """Ctrl-C: ask what is meant by it; once more, stop.

        Where nobody can be asked, it ends what this command is about: the run, or the watching.
        """
        if not is_terminal() and not self._steers:
            self._left = True
            return
        asked = self._question is not None and self._question.get_name() == _LEAVE
        if not is_terminal() or asked or len(self._firmer) < len(STOPS):
            self._withdraw()
            self._stop()
            return
        self._withdraw()
        self._prompt = None  # it is asked again once this is settled
        self._ask(self._leave(), _LEAVE)

    async def _leave(self) -> None:
        match (await self._lines.ask(LEAVING, sys.stderr)).strip().lower():
            case "s" | "stop":
                self._stop()
            case "w" | "watch":
                self._left = True
            case _:
                self._display.tell("the run goes on, and so does the watching")

    def _stop(self) -> None:
        """Ask for the next firmer way to stop, at once."""
        if self._firmer:
            verb = self._firmer.pop(0)
            self._stops.append(asyncio.create_task(self._request(verb)))

    async def _request(self, verb: str) -> None:
        do = {"stop": self._rig.stop, "abort": self._rig.abort, "estop": self._rig.estop}[verb]
        firmer = f"; Ctrl-C: {self._firmer[0]}" if self._firmer else ""
        try:
            await do("Ctrl-C where it is watched")
        except RigdError as error:
            self._display.tell(f"{verb}: {error.told}")
        else:
            self._display.tell(f"{verb} asked for{firmer}")

    def _ask(self, question: Coroutine[None, None, None], name: str) -> None:
        """Put a question at the terminal; there is one at a time."""

        async def asking() -> None:
            with self._display.quiet():
                await question

        self._question = asyncio.create_task(asking(), name=name)
        self._question.add_done_callback(self._settled)

    def _settled(self, question: asyncio.Task[None]) -> None:
        if self._question is question:
            self._question = None
        if not question.cancelled():
            question.result()

    def _withdraw(self) -> None:
        question, self._question = self._question, None
        if question is not None:
            question.cancel()

    @property
    def _how_to_answer(self) -> str:
        return f"rigd remote answer VALUE{self._where}"

    @property
    def _asks_prompt(self) -> bool:
        return self._question is not None and self._question.get_name() == _PROMPT

    def _holds(self, status: Status) -> bool:
        return status.lease.holder == self._rig.identity


async def _next(statuses: AsyncGenerator[Status, None]) -> Status:
    return await anext(statuses)
