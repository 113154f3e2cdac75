"""Evaluates a trial as soon as it has ended, by the analysis that its procedure names.

In virtual time that is done here; on a rig in a process of its own, whose numerics do not keep the
daemon from giving signs of life. That process waits until the trial stands in the recording:

    python -m rigd.daemon.trial_check FILE NUMBER
"""

from __future__ import annotations

import json
import sys
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

from rigd.model.errors import RigdError

if TYPE_CHECKING:
    from rigd.engine.system.child import Child

#: The recorder writes every second; a disk may be slow.
WRITTEN_WITHIN_S: Final = 10.0
POLL_S: Final = 0.2
#: A process that takes longer than this is lost.
TIMEOUT_S: Final = 60.0
#: Low priority: the rig comes first.
NICENESS: Final = 10


class Unchecked(RigdError):
    """The trial could not be checked; the message has the reason."""


def check_trial(path: Path, number: int) -> Sequence[str]:
    """Return why the trial ``number`` of the recording at ``path`` cannot be used.

    Raises:
        RigdError: it cannot be checked: it is not in the recording, or that lacks something.
    """
    from rigd.analysis.analysis import ChecksTrials
    from rigd.analysis.plan import find_analysis
    from rigd.analysis.recordings.source import open_sweep

    sweep = open_sweep(path)
    analysis = find_analysis(sweep.plan.model)()
    ended = [trial for trial in sweep.info.trials if trial.number == number]
    if not ended or not isinstance(analysis, ChecksTrials):
        raise Unchecked(f"trial {number} is not in {path}")
    optional = analysis.needs.optional_signals
    return analysis.check_trial(sweep.without(optional), ended[-1])


class CheckApart:
    """Checks trials of the recording at ``path``, each in a process of its own."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._given_up = threading.Event()

    def check(self, number: int) -> Sequence[str]:
        """Return what :func:`check_trial` does.

        Raises:
            Unchecked: it cannot be checked, or was given up.
        """
        from rigd.engine.system.child import Child, module  # of Linux, as runs in real time are

        command = module("rigd.daemon.trial_check", str(self._path), str(number))
        try:
            child = Child(command, output=True, tied=True)
        except OSError as error:
            raise Unchecked(f"its process cannot be started: {error.strerror}") from error
        until_s, printed = time.monotonic() + TIMEOUT_S, None
        while printed is None:
            given_up = self._given_up.is_set()
            if given_up or time.monotonic() > until_s:
                child.fence(1.0)
                child.talk(None, 1.0)  # closes its pipes
                raise Unchecked(
                    "it was given up" if given_up else f"it took longer than {TIMEOUT_S:g} s"
                )
            printed = child.talk(None, POLL_S)
        return _reasons(child, *printed)

    def give_up(self) -> None:
        """End the check under way: nobody waits for it."""
        self._given_up.set()


def _reasons(child: Child, answer: str, errors: str) -> Sequence[str]:
    if child.code:
        last = errors.strip().splitlines()
        raise Unchecked(last[-1] if last else f"its process {child.ended}")
    reasons: list[str] = json.loads(answer)
    return reasons


def _written(path: Path, number: int) -> bool:
    """Return whether the end of the trial stands in the recording."""
    from rigd.record import Recording

    events = Recording.open(path, partial=True).all_events
    return any(event.kind == "trial_end" and event.trial == number for event in events)


def main() -> int:
    """Check the trial that the command names; print the reasons as JSON."""
    from rigd.engine.system.realtime import set_nice  # of Linux

    set_nice(NICENESS)
    path, number = Path(sys.argv[1]), int(sys.argv[2])
    until = time.monotonic() + WRITTEN_WITHIN_S
    try:
        while not _written(path, number):
            if time.monotonic() > until:
                raise Unchecked(f"it is not in {path} after {WRITTEN_WITHIN_S:g} s")
            time.sleep(POLL_S)
        sys.stdout.write(json.dumps(list(check_trial(path, number))))
    except RigdError as error:
        sys.stderr.write(f"{error.message}\n")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
