"""Converts Unix signals from a terminal or a service manager into requests to the run."""

from __future__ import annotations

import signal
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from types import FrameType
from typing import Final

from rigd.engine.play.control import Control
from rigd.model.severity import Severity


def present(*names: str) -> list[signal.Signals]:
    """Return the signals of these names that this system has: Windows has only some."""
    return [getattr(signal, name) for name in names if hasattr(signal, name)]


#: The signals in words for the user.
_NAMES: Final[dict[int, str]] = {
    signal.SIGINT: "Ctrl-C",
    **dict.fromkeys(present("SIGHUP"), "SIGHUP (the terminal is gone)"),
}
#: The line for the user at each press of Ctrl-C.
ESCALATION: Final[Mapping[Severity, str]] = {
    Severity.STOP: "stopping. Again: abort",
    Severity.ABORT: "aborting. Again: drop power",
    Severity.ESTOP: "dropping power",
}


@contextmanager
def handle_signals(control: Control) -> Iterator[None]:
    """While inside, Ctrl-C, SIGTERM and SIGHUP stop the run; once more aborts, then drops power.

    Ctrl-Z (or SIGUSR1) pauses, and resumes. A handler only sets flags
    and leaves a line in ``control.notices``: it must not print, because the terminal may be gone. A
    signal that was ignored before (nohup) stays ignored.
    """

    def end(number: int, frame: FrameType | None) -> None:
        name = _NAMES.get(number) or signal.Signals(number).name
        stop = control.escalate(f"stopped by {name}")
        control.pause_wanted = False
        control.notices.append(f"{name}: {ESCALATION[stop]}")

    def pause(number: int, frame: FrameType | None) -> None:
        wanted = control.toggle_pause()
        line = "pausing; Ctrl-Z resumes" if wanted else "resuming"
        control.notices.append(line)

    handlers = dict.fromkeys(present("SIGINT", "SIGTERM", "SIGHUP"), end)
    handlers |= dict.fromkeys(present("SIGTSTP", "SIGUSR1"), pause)
    before = {
        number: signal.signal(number, handler)
        for number, handler in handlers.items()
        if signal.getsignal(number) is not signal.SIG_IGN
    }
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
