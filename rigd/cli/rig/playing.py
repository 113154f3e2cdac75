"""Runs a procedure from this terminal: shows progress and prompts to a person, JSON to a script."""

from __future__ import annotations

import sys
import threading
import time
from dataclasses import replace
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Any, TextIO

from rigd.analysis.plan import analysis_of
from rigd.cli.asking import ask_prompt
from rigd.cli.views.junit import suite_of, write_junit
from rigd.cli.views.output import outlive_output
from rigd.cli.views.run import Conclusion, RunDisplay, RunPosition
from rigd.daemon.execute import RecordedRun, RunRequest, execute
from rigd.daemon.provenance import trial_label
from rigd.daemon.waiting import what_waits
from rigd.engine.run.answers import Answers, OwnAnswers
from rigd.engine.run.result import Progress, TimeLeft
from rigd.model.errors import Exit, ProcedureError, RigdError
from rigd.procedure.program import Answer, CompiledProcedure, Prompt

if TYPE_CHECKING:
    from rigd.analysis.measures import MeasureResult


def play(
    request: RunRequest,
    *,
    as_json: bool,
    quiet: bool,
    by_person: bool,
    junit: Path | None = None,
) -> int:
    """Execute ``request``, show it, and return the exit code.

    ``by_person``: the operator answers prompts at this terminal, otherwise the procedure answers
    them. ``junit`` is the path of the JUnit XML result.
    """
    recorded = record(request, quiet=quiet or as_json, by_person=by_person)
    verdict = Exit.OK
    try:
        measured = _measured(request.procedure, recorded)
    except RigdError as error:  # how the run ended is shown all the same
        measured, verdict = None, error.exit_code
        print(f"rigd: the measures cannot be read: {error}", file=sys.stderr)
    except KeyboardInterrupt:
        measured, verdict = None, Exit.STOPPED
        print(
            f"rigd: interrupted while the measures are read: rigd measure {recorded.path}",
            file=sys.stderr,
        )
    if measured is not None and measured.judgement is not None:
        _keep(recorded.path, measured.judgement.value)
    if junit is not None:
        write_junit(junit, suite_of(request.procedure, request.rig.name, recorded, measured))
    conclusion = conclusion_of(request.procedure, recorded)
    if measured is not None and not measured.is_right:
        verdict = Exit.REJECTED
    conclusion = replace(conclusion, exit_code=conclusion.exit_code or int(verdict))
    if as_json:
        conclusion.print_json({} if measured is None else {"measures": _json(measured)})
    else:
        if measured is not None:
            from rigd.cli.views.measures import print_measures

            print_measures(measured)
        conclusion.print()
    return conclusion.exit_code


def _measured(procedure: CompiledProcedure, recorded: RecordedRun) -> MeasureResult | None:
    """Return what the trials of a run measured; None if it measures nothing or no trial began."""
    if not procedure.measures or not recorded.path.exists():
        return None
    from rigd.analysis.measures import measured_if_any
    from rigd.record import Recording

    return measured_if_any(Recording.open(recorded.path))


def _keep(path: Path, verdict: str) -> None:
    """Add the verdict to the recording, for the catalogue; without it nothing else is missing."""
    from rigd.record import add_metadata
    from rigd.record.read.info import VERDICT_METADATA

    try:
        add_metadata(path, {VERDICT_METADATA: {"verdict": verdict}})
    except RigdError as error:
        print(f"rigd: the verdict is not in the recording: {error}", file=sys.stderr)


def _json(result: MeasureResult) -> dict[str, Any]:
    from rigd.analysis.measures.view import result_json

    return result_json(result)


def record(request: RunRequest, *, quiet: bool, by_person: bool) -> RecordedRun:
    """Execute ``request`` and show its progress; see :func:`play`."""
    outlive_output()
    screen = (
        sys.stderr
    )  # sys.stderr itself, not rich's replacement while the bar is shown, which ends every line
    trials = len(request.procedure.trials)
    title = f"{request.title}, {trials} trial{'' if trials == 1 else 's'}"
    time_left, begun_s = TimeLeft(), time.monotonic()
    with RunDisplay(quiet=quiet, paused="Ctrl-Z resumes, Ctrl-C stops") as display:

        def show(progress: Progress) -> None:
            # The remaining time passes on the wall clock, also in virtual time.
            on_wall = replace(progress, run_s=time.monotonic() - begun_s)
            time_left.watch(on_wall)
            display.show(_position(progress, request, time_left, on_wall))

        answers: Answers = OwnAnswers()
        if by_person:
            answers = ConsoleAnswers(sys.stdin, screen, display)
        return execute(
            request,
            answers=answers,
            watch=show,
            notify=display.report,
            announce=lambda path: display.announce(f"{title}, recording to {path}"),
        )


def _position(
    progress: Progress, request: RunRequest, time_left: TimeLeft, on_wall: Progress
) -> RunPosition:
    trial, procedure = progress.trial, request.procedure
    return RunPosition(
        state=progress.state.name.lower(),
        trial=None if trial is None else trial.number,
        label="" if trial is None else trial_label(trial, procedure),
        step=progress.step,
        trials_done=progress.trials_done,
        trials_total=progress.trials_total,
        left_s=time_left.left_s(on_wall),
        pause_in_s=time_left.until_pause_s(on_wall, procedure),
        waits=what_waits(progress, request),
        coming_to_rest=progress.coming_to_rest,
    )


def conclusion_of(procedure: CompiledProcedure, recorded: RecordedRun) -> Conclusion:
    """Return how a run of ``procedure`` ended, and what to do next."""
    result, path = recorded.result, quote(str(recorded.path))
    advice = {"recording": str(recorded.path)}
    if result.trials_done < result.trials_total:
        advice = {"continue with": f"rigd run --resume {path}"}
    elif result.exit_code is Exit.OK and procedure.identify is not None:
        advice = {"identify": f"rigd identify {path}"}
        if analysis_of(procedure.identify).measures:
            advice = {"calibrate": f"rigd calibrate --from {path} --operator NAME"}
    return Conclusion(
        recording=str(recorded.path),
        ending=result.ending,
        reason=result.reason,
        exit_code=int(result.exit_code),
        trials_done=result.trials_done,
        trials_total=result.trials_total,
        run_s=result.run_s,
        incomplete=dict(result.incomplete),
        missed_cycles=result.missed_cycles,
        cycles=result.cycles + result.missed_cycles,
        trips=result.trips,
        problems=result.problems,
        advice=advice | {"show it with": f"rigd report {path}"},
    )


class ConsoleAnswers:
    """The operator at this terminal; without one, a run that has prompts is blocked."""

    by = "operator"
    asks_again = True

    def __init__(self, lines: TextIO, screen: TextIO, display: RunDisplay) -> None:
        """``display`` is hidden while a question is on the screen."""
        self._lines = lines
        self._screen = screen
        self._display = display
        self._withdrawn = threading.Event()  # of the question that is on the screen

    def can_answer(self, prompt: Prompt) -> bool:
        """Return whether both ends are a terminal."""
        return self._lines.isatty() and self._screen.isatty()

    def answer(self, prompt: Prompt, objection: str = "") -> Answer:
        """Ask until the answer can be parsed; the run checks the rest, and may ask again.

        Raises:
            ProcedureError: the terminal closed.
        """
        withdrawn = self._withdrawn = threading.Event()
        with self._display.hidden():
            given = ask_prompt(prompt, objection, self._lines, self._screen, withdrawn.is_set)
        if given is None:
            raise ProcedureError(f"prompt {prompt.name!r} was not answered")
        return given

    def withdraw(self) -> None:
        """Leave the question on the screen; the next typed line is not its answer."""
        self._withdrawn.set()
