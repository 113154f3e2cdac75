"""Shows a run at a terminal, local or remote: its progress, and how it ended."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Self

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn


@dataclass(frozen=True)
class RunPosition:
    """The part of the progress of a run that the display shows.

    ``label`` names the point of the sweep that is played, "" if there is only one. ``left_s`` is
    the time until the run ends, in s, or None if unknown; ``pause_in_s`` is when a pause that was
    asked for begins at the latest. ``waits`` says what the setpoints do in a pause.
    """

    state: str
    trial: int | None  #: the number of the trial in progress
    label: str
    step: str
    trials_done: int
    trials_total: int
    left_s: float | None
    pause_in_s: float | None = None
    waits: str = ""
    coming_to_rest: bool = False  #: whether rows go on after the end of the run


class RunDisplay:
    """Progress on standard error: a bar on a terminal, a line for each trial elsewhere.

    ``paused`` is the text shown while the run is paused or held.
    """

    def __init__(self, *, quiet: bool, paused: str) -> None:
        self._quiet = quiet
        self._paused = paused
        self._console = Console(  # in a pipe each line stays one line
            stderr=True, highlight=False, soft_wrap=not sys.stderr.isatty()
        )
        self._bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(bar_width=24),
            TaskProgressColumn(),
            TextColumn("{task.fields[left]}"),
            console=self._console,
            disable=quiet or not self._console.is_terminal,
        )
        self._task = self._bar.add_task("preflight", total=1, left="")
        self._trial: int | None = None
        self._state = ""
        self._resting = False

    def __enter__(self) -> Self:
        self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.stop()

    @contextmanager
    def hidden(self) -> Iterator[None]:
        """Hide the bar while the context is active."""
        self._bar.stop()
        try:
            yield
        finally:
            self._bar.start()

    def announce(self, line: str) -> None:
        """Show a line, except in quiet mode."""
        if not self._quiet:
            self._console.print(escape(line))

    def report(self, line: str) -> None:
        """Show a line, also in quiet mode: it answers an input of the user."""
        self._console.print(f"[yellow]{escape(line)}[/]")

    def show(self, position: RunPosition) -> None:
        """Show the progress of the run."""
        if self._quiet:
            return
        number = position.trial
        label = position.label or f"trial {number}"
        if number is not None and number != self._trial and not self._console.is_terminal:
            place = position.trials_done + 1
            named = "" if number == place else f" (number {number})"
            which = f"trial {place}/{position.trials_total}{named}"
            self._console.print(escape(f"{which}: {label}"))
        if position.state != self._state:
            self._report_state(position)
        if position.coming_to_rest and not self._resting:
            self._resting = True
            self.announce("coming to rest: rows are recorded on")
        self._trial, self._state = number, position.state
        title, left = _title(position), ""
        if number is not None:
            title = f"{label} · {position.step}" if position.step else label
            left = "" if position.left_s is None else f"{position.left_s:.0f} s left"
            if position.pause_in_s is not None:
                left = f"pauses in {position.pause_in_s:.0f} s at the latest"
        self._bar.update(
            self._task,
            total=max(position.trials_total, 1),
            completed=position.trials_done,
            description=escape(title),
            left=left,
        )

    def _report_state(self, position: RunPosition) -> None:
        """Show a line about a pause that was asked for, or that has begun."""
        if position.state in ("held", "paused"):
            does = f": {position.waits}" if position.waits else ""
            self.report(f"{position.state}{does}; {self._paused}")
        elif position.state == "pausing":
            within = position.pause_in_s
            self.report(
                "pausing" if within is None else f"pausing, in {within:.0f} s at the latest"
            )

    def show_silence(self, silent_s: float) -> None:
        """Show that the progress on the screen is old."""
        self._bar.update(self._task, description=f"[red]no message for {silent_s:.0f} s[/]")


def _title(position: RunPosition) -> str:
    """Return what the bar shows while no trial is played."""
    if position.coming_to_rest:
        return "coming to rest"
    is_cut = position.state == "done" and position.trials_done < position.trials_total
    return "ended" if is_cut else position.state  # a run that was stopped is not "done, 0 %"


@dataclass(frozen=True)
class Conclusion:
    """How a run ended, and what to do next.

    Numbers are None, and ``unknown`` is the reason, if there is no recording to read them from. The
    remote protocol does not report ``incomplete``, ``missed_cycles``, ``trips`` and ``problems``:
    they are None then. ``advice`` maps a purpose to a command.
    """

    recording: str
    ending: str
    reason: str
    exit_code: int
    trials_done: int | None = None
    trials_total: int | None = None
    run_s: float | None = None
    incomplete: Mapping[int, str] | None = None  #: trials that ended early, and why
    missed_cycles: int | None = None
    cycles: int = 0
    trips: tuple[str, ...] | None = None
    problems: tuple[str, ...] | None = None
    unknown: str = ""
    advice: Mapping[str, str] = field(default_factory=dict)

    def print(self) -> None:
        """Print it as text."""
        console = Console(highlight=False, soft_wrap=not sys.stdout.isatty())
        colour = "red" if self.exit_code else "green"
        amount = self.unknown
        if self.run_s is not None:
            amount = (
                f"{self.trials_done} of {self.trials_total} trials, {self.run_s:.1f} s of rig time"
            )
        console.print(f"[{colour}]{self.ending}[/]: {escape(self.reason)}; {amount}")
        for number, reason in (self.incomplete or {}).items():
            console.print(f"  trial {number} ended early: {escape(reason)}")
        for line in (*(self.trips or ()), *(self.problems or ())):
            console.print(f"  [red]{escape(line)}[/]")
        if self.missed_cycles:
            console.print(f"  {self.missed_cycles} of {self.cycles} cycles were missed")
        for purpose, command in self.advice.items():
            console.print(escape(f"{purpose + ':':12} {command}"), soft_wrap=True)

    def print_json(self, more: Mapping[str, object] = MappingProxyType({})) -> None:
        """Print it as JSON, with the keys of ``more`` at its end."""
        result = {
            "recording": self.recording,
            "state": self.ending,
            "reason": self.reason,
            "exit_code": self.exit_code,
            "trials_done": self.trials_done,
            "trials_total": self.trials_total,
            "incomplete_trials": self.incomplete,
            "run_s": None if self.run_s is None else round(self.run_s, 6),
            "missed_cycles": self.missed_cycles,
            "trips": self.trips,
            "problems": self.problems,
            **more,
        }
        print(json.dumps(result, indent=2, ensure_ascii=False))
