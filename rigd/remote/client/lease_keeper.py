"""Renews the control lease (the right to command a rig) while a client holds it."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager, suppress

from rigd.model.errors import RigdError
from rigd.remote.protocol import Code, Refusal
from rigd.remote.protocol.limits import RENEW_S

_log = logging.getLogger(__name__)


class LeaseKeeper:
    """Renews the lease every two seconds, from :meth:`begin` until :meth:`end`.

    It stops if the daemon reports that another client has the lease; the next command then fails.
    """

    def __init__(
        self, renew: Callable[[], Awaitable[object]], release: Callable[[], Awaitable[object]]
    ) -> None:
        self._renew = renew
        self._release = release
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

    @asynccontextmanager
    async def until_left(self, *, brief: bool, give_back: bool) -> AsyncIterator[None]:
        """End with a block, in order or not; see :meth:`AsyncClient.control`.

        ``give_back``: release the lease if the block is left in order.
        """
        try:
            yield
        except BaseException as error:
            if not (give_back and (brief or isinstance(error, Refusal))):
                await self.end()
                raise
            try:
                await self._give_back()
            except RigdError as second:  # the first error is the one to raise: that of the command
                _log.warning("control could not be given back: %s", second.one_line)
            raise
        if give_back:
            await self._give_back()
        else:
            await self.end()

    async def _give_back(self) -> None:
        holds = self.holds
        await self.end()
        if not holds:
            return
        try:
            await self._release()
        except Refusal as refusal:
            if refusal.code is not Code.NO_LEASE:  # else another has it: nothing to give back
                raise

    async def _keep(self) -> None:
        logged = False
        while True:
            await asyncio.sleep(RENEW_S)
            try:
                await self._renew()
                logged = False
            except RigdError as error:
                if isinstance(error, Refusal) and error.code is Code.NO_LEASE:
                    _log.warning("control is lost: %s", error.message)
                    return
                # Try again: the cause may be over before the lease expires.
                if not logged:
                    _log.warning("control could not be renewed: %s", error.message)
                logged = True
