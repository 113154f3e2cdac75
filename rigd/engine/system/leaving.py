"""Leaves what the main thread waits for, once nobody supervises this process any more."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

#: The signal by which a thread of this process ends what the main thread does.
LEAVE: Final = signal.SIGUSR1
#: How often it is looked, in s.
LOOK_S: Final = 0.005
#: After something was left, this process ends by itself within this time: a driver may have been
#: left where it cannot be, and must not hold the rig for ever.
END_S: Final = 20.0


class WaitLeft(BaseException):
    """Ends what the main thread does."""


class Leaving:
    """Raises :class:`WaitLeft` in the main thread once ``gone`` returns a reason.

    The handler of :data:`LEAVE`, and of signals that end this process, calls :meth:`signalled`.
    """

    def __init__(self, gone: Callable[[], str]) -> None:
        self._gone = gone
        self._guarded = False  #: whether a signal ends what the main thread does

    def signalled(self) -> None:
        """Raise :class:`WaitLeft` in what is guarded; else do nothing."""
        if self._guarded:
            self.check(left=True)

    def check(self, *, left: bool = False) -> None:
        """Raise :class:`WaitLeft` if ``gone`` returns a reason, or with ``left``."""
        if left or self._gone():
            self._guarded = False
            end = threading.Timer(END_S, os._exit, (1,))
            end.daemon = True
            end.start()
            raise WaitLeft

    @contextmanager
    def guarded(self) -> Iterator[None]:
        """Look all the time; a wait of a driver ends, and what it has to do in the end, it does."""
        over, main = threading.Event(), threading.get_ident()

        def watch() -> None:
            while not over.wait(LOOK_S):
                if self._gone():
                    signal.pthread_kill(main, LEAVE)
                    return

        threading.Thread(target=watch, name="looks at the daemon", daemon=True).start()
        try:
            self._guarded = True
            yield
        finally:
            self._guarded = False
            over.set()
