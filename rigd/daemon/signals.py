"""Signals of the terminal and of service managers, turned into requests to the run."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

from rigd.engine.control import Control, Verb


@contextmanager
def heed_signals(control: Control, tell: Callable[[str], None]) -> Iterator[None]:
    """While inside, Ctrl-C, SIGTERM and SIGHUP stop the run; once more aborts, then drops power.

    Ctrl-Z (or SIGUSR1) pauses after the trial under way, and resumes. ``tell`` gets a line for
    the operator.
    """
    words = {
        Verb.STOP: "stopping; once more aborts",
        Verb.ABORT: "aborting; once more drops power",
        Verb.ESTOP: "dropping power",
    }

    def end(number: int, frame: FrameType | None) -> None:
        name = signal.Signals(number).name
        verb = control.escalate(f"stopped by {name}")
        control.pause_wanted = False
        tell(f"{name}: {words[verb]}")

    def pause(number: int, frame: FrameType | None) -> None:
        wanted = control.toggle_pause()
        tell("pausing after this trial; Ctrl-Z resumes" if wanted else "resuming")

    handlers = dict.fromkeys((signal.SIGINT, signal.SIGTERM, signal.SIGHUP), end)
    handlers |= dict.fromkeys((signal.SIGTSTP, signal.SIGUSR1), pause)
    before = {number: signal.signal(number, handler) for number, handler in handlers.items()}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
