"""Follows a remote run to its end: shows progress, asks the user prompts, handles Ctrl-C."""

from __future__ import annotations

import argparse
import asyncio
import shlex
import signal
import sys
import threading
from collections.abc import AsyncGenerator, Awaitable, Callable
from contextlib import ExitStack, aclosing, suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from rigd.cli.asking import ask, ask_prompt, is_terminal
from rigd.cli.remote.command import again
from rigd.cli.views.output import outlive_output
from rigd.cli.views.run import Conclusion, RunDisplay, RunPosition
from rigd.daemon.signals import ESCALATION, present
from rigd.engine.play.control import Control
from rigd.model.errors import Exit, LinkError, RigdError
from rigd.procedure.program import AnswerKind, Prompt
from rigd.remote.client.watching import RunWatch
from rigd.remote.protocol import Status
from rigd.remote.protocol.results import RunView
from rigd.remote.protocol.status import LastRun, PromptView

if TYPE_CHECKING:
    from rigd.remote import AsyncClient
    from rigd.remote.protocol import ClientUser

#: A daemon that restarts needs some seconds; watching gives up after this time, in s.
PATIENCE_S: Final = 30.0
#: A silence of this length is shown, in s; the daemon publishes twice a second.
SILENCE_S: Final = 2.0
_LOOK_S: Final = 0.5
#: The question of the first Ctrl-C: unlike a run at this terminal, a remote run needs no client.
_LEAVING: Final = """
Ctrl-C: the run continues meanwhile.
  s      stop it, then `finish` (so does Ctrl-C again)
  w      only stop watching: the run continues, no client has control
  Enter  neither
"""


async def watch(
    rig: AsyncClient,
    run: str,
    args: argparse.Namespace,
    *,
    steers: bool,
) -> int:
    """Show ``run`` until it ends or the user leaves it; return the exit code.

    The user at this terminal answers prompts while this client has control. ``steers``: the run is
    this command's own, so that Ctrl-C stops it if there is no terminal to ask at.
    """
    outlive_output()
    target_options = again(args)
    with RunDisplay(
        quiet=args.quiet or args.json, paused=f"rigd remote resume{target_options} continues it"
    ) as display:
        last = await Watch(rig, run, display, target_options, steers=steers).follow()
    if last is None:
        print(f"{run} continues:  rigd remote status --watch{target_options}", file=sys.stderr)
        return int(Exit.OK)
    recorded = None
    with suppress(LinkError):  # the daemon may end with its run; it has reported the end
        recorded = await rig.run(run) if last.recorded else None
    conclusion = _conclusion(last, recorded, target_options)
    if args.json:
        conclusion.print_json()
    else:
        conclusion.print()
    return conclusion.exit_code


def _conclusion(last: LastRun, recorded: RunView | None, target_options: str) -> Conclusion:
    """Return how a run ended; ``target_options`` are the options that find the rig."""
    if recorded is None:
        unknown = "the daemon has ended too" if last.recorded else "nothing was recorded"
        return Conclusion(last.run, last.ending, last.reason, last.exit_code, unknown=unknown)
    line, name = recorded.line, shlex.quote(last.run)
    advice = {"fetch it": f"rigd remote fetch {name}{target_options}"}
    if line.trials_done < line.trials_total:
        advice = {"continue with": f"rigd remote resume-run {name}{target_options}"} | advice
    return Conclusion(
        recording=last.run,
        ending=last.ending,
        reason=last.reason,
        exit_code=last.exit_code,
        trials_done=line.trials_done,
        trials_total=line.trials_total,
        run_s=line.duration_s or 0.0,
        advice=advice,
    )


def as_prompt(view: PromptView) -> Prompt:
    """Return the prompt of a status, with the fields that its answer needs."""
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


@dataclass(frozen=True)
class _Question:
    """The open question at the terminal: a prompt of the run, or the question after Ctrl-C."""

    is_prompt: bool
    withdrawn: threading.Event
    task: asyncio.Task[None]


class Watch:
    """Follows one run at a terminal; :meth:`follow` is called once."""

    def __init__(
        self, rig: AsyncClient, run: str, display: RunDisplay, target_options: str, *, steers: bool
    ) -> None:
        self._rig = rig
        self._run = run
        self._display = display
        self._target_options = target_options
        self._steers = steers
        self._question: _Question | None = None
        self._prompt: PromptView | None = None  # the prompt that was shown last
        self._is_answering = (
            False  # an answer was sent; the prompt may disappear before the reply arrives
        )
        self._control = Control()  # requests by Ctrl-C and Ctrl-Z at this terminal
        self._state = ""
        self._requests: set[asyncio.Task[None]] = set()
        self._left = False
        self._asked_by: tuple[ClientUser, ...] = ()

    async def follow(self) -> LastRun | None:
        """Return how the run ended, or None if the user left it.

        Raises:
            LinkError: the daemon does not respond.
        """
        loop = asyncio.get_running_loop()
        keys = {signal.SIGINT: self._press}
        if self._steers:
            keys |= dict.fromkeys(present("SIGTSTP", "SIGUSR1"), self._toggle_pause)
        release = ExitStack()
        for key, handler in keys.items():
            release.callback(_handle(loop, key, handler))
        self._display.announce(f"{self._rig.rig} records {self._run}")
        if is_terminal():
            pauses = ", Ctrl-Z pauses" if len(keys) > 1 else ""
            self._display.announce(f"Ctrl-C asks what to do{pauses}")
        try:
            return await self._follow()
        finally:
            release.close()
            await self._withdraw()
            await asyncio.gather(*self._requests)

    async def _follow(self) -> LastRun | None:
        run = RunWatch(self._run)
        async with aclosing(self._rig.watch(patience_s=None)) as statuses:
            coming = asyncio.create_task(_next(statuses))
            try:
                while not self._left:
                    if not (await asyncio.wait([coming], timeout=_LOOK_S))[0]:
                        self._show_silence()
                        continue
                    status = coming.result()
                    ended = run.ended(status)
                    if ended is not None:
                        return ended
                    self._show(status)
                    await self._show_prompt(status)
                    coming = asyncio.create_task(_next(statuses))
            finally:
                coming.cancel()
                await asyncio.wait([coming])
        return None

    def _show(self, status: Status) -> None:
        trial = status.trial
        self._display.show(
            RunPosition(
                state=status.state,
                trial=None if trial is None else trial.number,
                label="" if trial is None else trial.label,
                step=status.step or "",
                trials_done=status.trials_done,
                trials_total=status.trials_total,
                left_s=status.left_s,
                pause_in_s=status.pause_in_s,
                waits=status.waits,
                coming_to_rest=status.coming_to_rest,
            )
        )
        if status.state != self._state and status.state == "stopping":
            self._display.report(status.state)
        self._state = status.state
        asked_by = status.lease.asked_by
        if self._holds(status) and asked_by != self._asked_by:
            for item in asked_by:
                self._display.report(
                    f"{item} requests control: "
                    f"rigd remote lease give {item.identity}{self._target_options}"
                )
        self._asked_by = asked_by

    def _show_silence(self) -> None:
        silent_s = self._rig.connection.silent_s
        if silent_s > PATIENCE_S:
            raise LinkError(
                f"{self._rig.rig} has sent nothing for {silent_s:.0f} s",
                hint="look at the rig itself; check that its daemon and the network run",
            )
        if silent_s > SILENCE_S:
            self._display.show_silence(silent_s)

    async def _show_prompt(self, status: Status) -> None:
        """Ask the prompt that waits; remove a prompt that no longer waits from the terminal."""
        prompt, before = status.prompt, self._prompt
        if before is not None and (prompt is None or prompt.id != before.id):
            question = self._question
            if question is not None and question.is_prompt and not self._is_answering:
                await self._withdraw()
                self._display.report("answered elsewhere, or withdrawn")
            self._prompt = None
        if prompt is None or self._prompt is not None or self._question is not None:
            return
        self._prompt = prompt
        if is_terminal() and self._holds(status):
            self._put(lambda withdrawn: self._answer(prompt, withdrawn), is_prompt=True)
        else:
            self._display.report(
                f"a prompt waits for an answer: {prompt.text}  ({self._how_to_answer})"
            )

    async def _answer(self, prompt: PromptView, withdrawn: threading.Event) -> None:
        given = await asyncio.to_thread(
            ask_prompt, as_prompt(prompt), prompt.objection, sys.stdin, sys.stderr, withdrawn.is_set
        )
        if given is None:
            if not withdrawn.is_set():
                self._display.report(f"this terminal has closed: {self._how_to_answer}")
            return
        self._is_answering = True
        try:
            await self._rig.answer(given, prompt.id)
        except RigdError as error:
            self._display.report(error.one_line)
            self._prompt = None  # if the prompt still waits, it is asked again
        finally:
            self._is_answering = False

    def _press(self) -> None:
        """Handle Ctrl-C: first ask what to do; then request stop, abort and estop in turn.

        Without a terminal it ends what this command is for: the run, or the watching.
        """
        if not is_terminal() and not self._steers:
            self._left = True
            return
        question = self._question
        is_asked = question is not None and not question.is_prompt
        if question is not None:
            question.withdrawn.set()
        if is_terminal() and not is_asked and self._control.asked is None:
            self._prompt = None  # the prompt is asked again afterwards
            self._put(self._leave, is_prompt=False)
        else:
            self._stop()

    async def _leave(self, withdrawn: threading.Event) -> None:
        line = await asyncio.to_thread(ask, _LEAVING, sys.stdin, sys.stderr, withdrawn.is_set)
        if withdrawn.is_set():
            return
        match line.strip().lower():
            case "s" | "stop":
                self._stop()
            case "w" | "watch":
                self._left = True
            case _:
                self._display.report("the run and the watching continue")

    def _stop(self) -> None:
        """Request the next more severe stop, at once."""
        stop = self._control.escalate("Ctrl-C")
        do = getattr(self._rig, stop.word)
        self._request(do("Ctrl-C in a terminal that shows the run"), f"Ctrl-C: {ESCALATION[stop]}")

    def _toggle_pause(self) -> None:
        """Handle Ctrl-Z: pause, or resume; refused without control."""
        if self._state in ("pausing", "held", "paused"):
            self._request(self._rig.resume(), "resuming")
        else:
            self._request(self._rig.pause(), "pausing; Ctrl-Z resumes")

    def _request(self, request: Awaitable[object], done: str) -> None:
        """Send a request, and report ``done`` once the daemon has carried it out."""

        async def sending() -> None:
            try:
                await request
            except RigdError as error:
                self._display.report(error.one_line)
            else:
                self._display.report(done)

        task = asyncio.create_task(sending())
        self._requests.add(task)
        task.add_done_callback(self._requests.discard)

    def _put(
        self, question: Callable[[threading.Event], Awaitable[None]], *, is_prompt: bool
    ) -> None:
        """Ask a question at the terminal, after the previous one is closed."""
        before, withdrawn = self._question, threading.Event()

        async def asking() -> None:
            if before is not None:
                await before.task
            with self._display.hidden():
                await question(withdrawn)
            if self._question is put:
                self._question = None

        put = self._question = _Question(is_prompt, withdrawn, asyncio.create_task(asking()))

    async def _withdraw(self) -> None:
        """Remove the open question from the terminal."""
        question, self._question = self._question, None
        if question is not None:
            question.withdrawn.set()
            await question.task

    def _holds(self, status: Status) -> bool:
        return status.lease.is_held_by(self._rig.identity)

    @property
    def _how_to_answer(self) -> str:
        return f"rigd remote answer VALUE{self._target_options}"


def _handle(
    loop: asyncio.AbstractEventLoop, key: signal.Signals, handler: Callable[[], None]
) -> Callable[[], object]:
    """Call ``handler`` in ``loop`` at each signal ``key``; return what ends that."""
    try:
        loop.add_signal_handler(key, handler)
    except NotImplementedError:  # Windows
        before = signal.signal(key, lambda *_: loop.call_soon_threadsafe(handler))
        return lambda: signal.signal(key, before)
    return lambda: loop.remove_signal_handler(key)


async def _next(statuses: AsyncGenerator[Status, None]) -> Status:
    return await anext(statuses)
