"""Reports the state of the daemon to the service manager: ready, alive, stopping (sd_notify(3)).

Each message is a datagram to the socket that ``NOTIFY_SOCKET`` names. Without this variable, the
daemon sends no message.
"""

from __future__ import annotations

import logging
import os
import socket
import time
from collections.abc import Mapping
from typing import Final, Self

_LOG: Final = logging.getLogger(__name__)
#: Signs of life are this far apart; `WatchdogSec=` must be several times as long.
SIGN_S: Final = 1.0
#: How long a message may wait for the manager to read the message before, in s.
PATIENCE_S: Final = 0.1


class Notifier:
    """Reports to the service manager, if ``environ`` names one."""

    def __init__(self, environ: Mapping[str, str] = os.environ) -> None:
        self._address = environ.get("NOTIFY_SOCKET", "")
        if self._address.startswith("@"):
            self._address = "\0" + self._address[1:]  # a name in the abstract name space
        # Made at the start: the daemon must be able to report that no descriptor is left.
        self._link = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)
        self._link.settimeout(PATIENCE_S)
        self._failed = False
        self._doing = ""
        self._next_sign = 0.0

    def ready(self) -> None:
        """Report that clients are served."""
        self._send("READY=1")

    def alive(self, doing: str) -> None:
        """Give a sign of life, not too often; ``doing`` is shown by ``systemctl status``."""
        now = time.monotonic()
        if doing != self._doing or now >= self._next_sign:
            self._doing, self._next_sign = doing, now + SIGN_S
            self._send("WATCHDOG=1", f"STATUS={doing}")

    def hanging(self, why: str) -> None:
        """Report why the daemon gives no signs of life any more."""
        self._send(f"STATUS=clients are not served any more: {why}")

    def ending(self) -> None:
        """Report that the end has begun; it may take a while."""
        self._send("STOPPING=1", "STATUS=ending")

    def close(self) -> None:
        """Send no further message."""
        self._link.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _send(self, *lines: str) -> None:
        if not self._address:
            return
        try:
            self._link.sendto("\n".join(lines).encode(), self._address)
        except OSError as error:
            if not self._failed:  # the manager acts on the silence; one line in the log is enough
                _LOG.warning("the service manager cannot be reached: %s", error)
            self._failed = True
        else:
            self._failed = False
