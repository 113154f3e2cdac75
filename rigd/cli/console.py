"""Shows a run at a terminal and asks its prompts."""

from __future__ import annotations

import shutil
import textwrap
import threading
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from shlex import quote
from typing import TextIO

from rich.console import Console
from rich.markup import escape
from rich.progress import TextColumn, TimeRemainingColumn

from rigd.analysis.plan import analysis_of
from rigd.cli.asking import ask
from rigd.cli.trial_bar import TrialBar
from rigd.daemon.execute import RecordedRun
from rigd.daemon.provenance import trial_label
from rigd.engine.answers import read_answer
from rigd.engine.result import Progress as RunProgress
from rigd.model.errors import Exit, ProcedureError
from rigd.model.states import RunState
from rigd.model.units import format_quantity
from rigd.procedure.program import Answer, AnswerKind, CompiledProcedure, Prompt, TrialPlan


class RunDisplay(TrialBar):
    """Progress of one run on standard error: a bar on a terminal, a line per trial elsewhere."""

    def __init__(self, procedure: CompiledProcedure, title: str, *, quiet: bool) -> None:
        self._procedure = procedure
        self._title = title
        super().__init__(TextColumn("left"), TimeRemainingColumn(), quiet=quiet)
        self._task = self._bar.add_task("preflight", total=max(len(procedure.trials), 1))
        self._shown: TrialPlan | None = None
        self._state: RunState | None = None

    def announce(self, path: Path) -> None:
        """Say where the samples go, before the first one does."""
        if not self._quiet:
            self._console.print(
                f"{escape(self._title)}, "
                f"{_count(len(self._procedure.trials), 'trial')}, "
                f"recording to [cyan]{escape(str(path))}[/]"
            )

    def watch(self, progress: RunProgress) -> None:
        """Show where the run stands."""
        if self._quiet:
            return
        trial = progress.trial
        label = "" if trial is None else trial_label(trial, self._procedure) or "no sweep"
        if trial is not None and trial is not self._shown and not self._console.is_terminal:
            which = f"trial {progress.trials_done + 1}/{progress.trials_total}"
            self._console.print(escape(f"{which}: {label}"))
        if progress.state is RunState.PAUSED and self._state is not RunState.PAUSED:
            self.tell("paused; Ctrl-Z resumes, Ctrl-C stops")
        self._shown, self._state = trial, progress.state
        what = label or progress.state.name.lower()
        if trial is not None and progress.step:
            what += f" · {progress.step}"
        self._bar.update(self._task, completed=progress.trials_done, description=escape(what))


def conclude(procedure: CompiledProcedure, recorded: RecordedRun) -> None:
    """Say how the run ended and what to do next."""
    result = recorded.result
    colour = "green" if result.exit_code is Exit.OK else "red"
    console = Console(highlight=False)
    console.print(
        f"[{colour}]{result.ending}[/]: {escape(result.reason)}; "
        f"{result.trials_done} of {result.trials_total} trials, "
        f"{result.run_s:.1f} s of rig time"
    )
    for number, why in result.incomplete:
        console.print(f"  trial {number} ended early: {escape(why)}")
    for line in (*result.trips, *result.problems):
        console.print(f"  [red]{escape(line)}[/]")
    if result.missed_cycles:
        console.print(
            f"  {result.missed_cycles} of {result.cycles + result.missed_cycles} cycles were missed"
        )
    path = escape(quote(str(recorded.path)))
    if result.trials_done < result.trials_total:
        console.print(f"go on with:  rigd run --resume {path}", soft_wrap=True)
    elif result.exit_code is Exit.OK and procedure.identify is not None:
        if analysis_of(procedure.identify).measures:
            console.print(
                f"calibrate:   rigd calibrate --from {path} --operator NAME", soft_wrap=True
            )
        else:
            console.print(f"identify:    rigd identify {path}", soft_wrap=True)
    else:
        console.print(f"recording:   {escape(str(recorded.path))}", soft_wrap=True)
    console.print(f"look at it:  rigd report {path}", soft_wrap=True)


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


class ConsoleAnswers:
    """The operator at this terminal; blocks where there is none."""

    by = "operator"
    asks_again = True

    def __init__(
        self, lines: TextIO, screen: TextIO, quieten: Callable[[], AbstractContextManager[None]]
    ) -> None:
        """``quieten`` keeps the progress bar off the screen while a question stands there."""
        self._lines = lines
        self._screen = screen
        self._quieten = quieten
        self._withdrawn = threading.Event()  # of the question that stands there now

    def can_answer(self, prompt: Prompt) -> bool:
        """Return whether a person sits at both ends."""
        return self._lines.isatty() and self._screen.isatty()

    def answer(self, prompt: Prompt, objection: str = "") -> Answer:
        """Ask until the answer can be read; the run checks the rest, and may ask again.

        Raises:
            ProcedureError: the terminal went away.
        """
        self._withdrawn = threading.Event()
        with self._quieten():
            return self._ask(prompt, f"\n{wrapped(objection, indent='  ')}\n" if objection else "")

    def withdraw(self) -> None:
        """Leave the question on the screen; the next line that is typed is not for it."""
        self._withdrawn.set()

    def _ask(self, prompt: Prompt, remark: str) -> Answer:
        withdrawn = self._withdrawn
        while True:
            question = remark + question_of(prompt)
            line = ask(question, self._lines, self._screen, withdrawn.is_set)
            if not line:
                raise ProcedureError(f"prompt {prompt.name!r} was not answered")
            try:
                return read_answer(prompt, line.strip())
            except ValueError as error:
                remark = f"  {error}\n"


def question_of(prompt: Prompt) -> str:
    """Return what stands at the terminal before the answer."""
    return f"\n{wrapped(prompt.text)}\n{invitation(prompt)}: "


def wrapped(text: str, indent: str = "") -> str:
    """Return ``text`` broken between words to the width of the terminal."""
    columns = shutil.get_terminal_size().columns
    return "\n".join(
        textwrap.fill(line, columns, initial_indent=indent, subsequent_indent=indent)
        for line in text.splitlines()
    )


def invitation(prompt: Prompt) -> str:
    """Return in which form a prompt is answered."""
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
