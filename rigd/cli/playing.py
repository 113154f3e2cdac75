"""Runs a procedure from a terminal: display for a person, JSON for a script."""

from __future__ import annotations

import json
import sys
from pathlib import Path

from rigd.cli.console import ConsoleAnswers, RunDisplay, conclude
from rigd.cli.junit import suite_of, write_junit
from rigd.daemon.execute import RecordedRun, RunRequest, execute
from rigd.engine.answers import Answers, OwnAnswers


def play(
    request: RunRequest,
    *,
    as_json: bool,
    quiet: bool,
    by_person: bool,
    junit: Path | None = None,
) -> int:
    """Execute ``request``, show it, and return the exit code.

    ``by_person``: prompts are answered at this terminal, otherwise by the procedure itself.
    ``junit`` is where the result goes as JUnit XML.
    """
    recorded = record(request, quiet=quiet or as_json, by_person=by_person)
    if junit is not None:
        write_junit(junit, suite_of(request.procedure, request.rig.name, recorded))
    if as_json:
        print(json.dumps(_result(recorded), indent=2))
    else:
        conclude(request.procedure, recorded)
    return int(recorded.result.exit_code)


def record(request: RunRequest, *, quiet: bool, by_person: bool) -> RecordedRun:
    """Execute ``request`` and show its progress; see :func:`play`."""
    screen = sys.stderr  # itself, not what stands in for it beside the bar: that ends every line
    with RunDisplay(request.procedure, request.title, quiet=quiet) as display:
        answers: Answers = OwnAnswers()
        if by_person:
            answers = ConsoleAnswers(sys.stdin, screen, display.quiet)
        return execute(
            request,
            answers=answers,
            watch=display.watch,
            tell=display.tell,
            announce=display.announce,
        )


def _result(recorded: RecordedRun) -> dict[str, object]:
    result = recorded.result
    return {
        "recording": str(recorded.path),
        "state": result.ending,
        "reason": result.reason,
        "exit_code": int(result.exit_code),
        "trials_done": result.trials_done,
        "trials_total": result.trials_total,
        "incomplete_trials": {str(n): why for n, why in result.incomplete},
        "run_s": round(result.run_s, 6),
        "missed_cycles": result.missed_cycles,
        "trips": list(result.trips),
        "problems": list(result.problems),
    }
