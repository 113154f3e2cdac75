"""Keeps the control lease while it is held."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable
from contextlib import suppress

from rigd.model.errors import RigdError
from rigd.remote.protocol import Code, Refusal
from rigd.remote.protocol.limits import RENEW_S

_log = logging.getLogger(__name__)


class Holding:
    """Renews the lease every two seconds, from :meth:`begin` until :meth:`end`.

    It stops where the daemon says that the lease is another's; the next command then says so too.
    """

    def __init__(self, renew: Callable[[], Awaitable[object]]) -> None:
        self._renew = renew
        self._task: asyncio.Task[None] | None = None

    @property
    def holds(self) -> bool:
        """Whether the lease is held, as far as this client knows."""
        return self._task is not None and not self._task.done()

    def begin(self) -> None:
        """Renew from now on: the lease has been taken."""
        if not self.holds:
            self._task = asyncio.create_task(self._keep(), name="lease")

    async def end(self) -> None:
        """Renew no more."""
        task, self._task = self._task, None
        if task is not None:
            task.cancel()
            with suppress(asyncio.CancelledError):
                await task

    async def _keep(self) -> None:
        while True:
            await asyncio.sleep(RENEW_S)
            try:
                await self._renew()
            except RigdError as error:
                if isinstance(error, Refusal) and error.code is Code.NO_LEASE:
                    _log.warning("the control lease is lost: %s", error.told)
                    return
                # Whatever keeps it from being renewed may be over before it runs out.
                _log.warning("the control lease could not be renewed: %s", error.told)
