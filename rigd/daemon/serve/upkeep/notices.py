"""Keeps the notices to the operator: shows them in the daemon's status and logs them."""

from __future__ import annotations

import logging
import time
from collections import deque
from collections.abc import Callable
from typing import Final, Literal

from rigd.remote.protocol.status import OperatorNotice
from rigd.remote.protocol.stop import one_line

_LOG: Final = logging.getLogger("rigd.daemon")
#: The status has so many notices, the newest.
KEPT: Final = 20
#: A line is no longer than this.
_LENGTH: Final = 1000

Level = Literal["info", "warning", "error"]
_LEVELS: Final = {"info": logging.INFO, "warning": logging.WARNING, "error": logging.ERROR}


class Notices:
    """Stores the newest notices; each new notice calls ``changed``. Any thread may add one."""

    def __init__(
        self, changed: Callable[[], None], clock: Callable[[], int] = time.time_ns
    ) -> None:
        self._changed = changed
        self._clock = clock
        self._kept: deque[OperatorNotice] = deque(maxlen=KEPT)

    def note(self, text: str, level: Level = "info") -> None:
        """Add a line; it may contain a client's own text."""
        line = one_line(text[:_LENGTH])
        _LOG.log(_LEVELS[level], "%s", line)
        self._kept.append(OperatorNotice(t_ns=self._clock(), level=level, text=line))
        self._changed()

    def views(self) -> tuple[OperatorNotice, ...]:
        """Return them, the newest last."""
        return tuple(self._kept)
