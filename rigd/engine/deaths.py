"""How a process ended, in words."""

from __future__ import annotations

import signal


def how_ended(code: int) -> str:
    """Return what an exit code of :mod:`subprocess` says: ``signal SIGKILL``, ``exit code 1``."""
    if code >= 0:
        return f"exit code {code}"
    try:
        return f"signal {signal.Signals(-code).name}"
    except ValueError:  # most real-time signals have no name
        return f"signal {-code}"
