"""Shows the channels of a rig to clients while no run plays; the rig is never armed."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from typing import Final

from rigd.config.rig import RigConfig
from rigd.daemon.live.feed import Feed
from rigd.daemon.manual import open_unarmed
from rigd.engine.play.control import Control
from rigd.engine.shared import RunFolder
from rigd.model.errors import Blocked, RigdError
from rigd.model.severity import Severity

_LOG: Final = logging.getLogger(__name__)
#: A device that cannot be reached is tried again so often, in s: each time starts a process.
AGAIN_S: Final = 30.0
#: The events of the idle rig are discarded this often, in s: it may be shown for days.
_FORGET_S: Final = 1.0


class Monitor:
    """Opens ``rig`` unarmed (:func:`rigd.daemon.manual.open_unarmed`) for ``feed``, in a thread.

    Its cycle runs at rest with interlocks that only report, which takes as much of a processor as a
    run. It must be stopped before a run begins. ``held`` is the rig's folder if the caller has
    taken it. If a device fails or is missing, opening is repeated; ``notify`` gets the reason once
    until data are shown again.
    """

    def __init__(
        self,
        rig: RigConfig,
        feed: Feed,
        held: RunFolder | None = None,
        *,
        notify: Callable[[str], None] = lambda _: None,
    ) -> None:
        self.problem = ""  #: why nothing is shown
        self._rig, self._feed, self._held = rig, feed, held
        self._notify = notify
        self._control = Control()
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._work, name="monitor", daemon=True)

    @property
    def running(self) -> bool:
        """Whether it has the rig: no run can begin."""
        return self._thread.is_alive()

    def start(self) -> None:
        """Begin to open the devices; once."""
        self._thread.start()

    def stop(self) -> None:
        """End, and return once every device is closed; stopping twice is silent."""
        self._ending.set()
        self._control.request(Severity.STOP, "the idle rig is closed")
        if self._thread.ident is not None:
            self._thread.join()

    def _work(self) -> None:
        while not self._ending.is_set():
            try:
                self._look()
            except RigdError as error:
                self._failed(str(error))
            except Exception as error:  # noqa: BLE001 - the thread's boundary: nothing is armed
                _LOG.exception("showing the idle rig failed by a bug in rigd")
                self._failed(f"{type(error).__name__}: {error}")
            self._ending.wait(AGAIN_S)

    def _failed(self, problem: str) -> None:
        if not self.problem:
            self._notify(f"the idle rig is not shown: {problem}")
        self.problem = problem

    def _look(self) -> None:
        with open_unarmed(self._rig, self._control, command="rigd serve", held=self._held) as look:
            reasons = look.open()
            if look.stopped:
                return
            if reasons:
                raise Blocked(reasons, f"rig {self._rig.name} cannot be shown")
            self._feed.attach(look.folder, events=False)
            self.problem = ""
            try:
                while not look.stopped:
                    look.rest(_FORGET_S)
                    look.events.clear()
            finally:
                self._feed.detach()
