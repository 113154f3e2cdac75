"""Renews the control lease (the right to command a rig) while a client holds it."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager, suppress
from typing import Final

from rigd.model.errors import RigdError
from rigd.remote.client.lease.renewing import renew_until_lost
from rigd.remote.protocol import Code, LeaseView, Refusal
from rigd.remote.protocol.limits import RENEW_S

_log = logging.getLogger(__name__)

#: Another process of this name renews the lease within so many times the interval, if it lives.
_WAIT_PART: Final = 3.0
#: How often is looked meanwhile.
_LOOKS: Final = 12
#: The end of a lease moves by less without a renewal: by what a clock of the daemon is set.
_RENEWED_NS: Final = 20_000_000


class LeaseKeeper:
    """Renews the lease every second, from :meth:`begin` until :meth:`end`.

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

    async def give_back_unless_renewed(self, look: Callable[[], Awaitable[LeaseView]]) -> None:
        """Release a lease that had this client's name before, unless another process renews it.

        It may be of a process that was killed: then the lease would run out, and the daemon would
        take it that the client of a run has vanished. ``look`` returns the lease.
        """
        first = await look()
        for _ in range(_LOOKS):
            await asyncio.sleep(RENEW_S * _WAIT_PART / _LOOKS)
            view = await look()
            if view.holder != first.holder or view.until_ns - first.until_ns > _RENEWED_NS:
                return
        _log.warning("no other process renews control any more: it is given back")
        await self._release_if_held()

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
        if holds:
            await self._release_if_held()

    async def _release_if_held(self) -> None:
        try:
            await self._release()
        except Refusal as refusal:
            if refusal.code is not Code.NO_LEASE:  # else another has it: nothing to give back
                raise

    async def _keep(self) -> None:
        def failed(error: RigdError) -> None:
            _log.warning("control could not be renewed: %s", error.message)

        refusal = await renew_until_lost(self._renew, failed)
        _log.warning("control is lost: %s", refusal.message)
