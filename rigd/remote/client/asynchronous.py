"""Provides the client of a daemon for asyncio programs."""

from __future__ import annotations

from collections.abc import AsyncGenerator, AsyncIterator
from contextlib import aclosing, asynccontextmanager
from typing import Final, Self

from rigd.config.remote import TlsFiles
from rigd.model.errors import LinkError
from rigd.remote.client.connection import EVENTS, FRAMES, STATUSES, Connection
from rigd.remote.client.lease.lease_keeper import LeaseKeeper
from rigd.remote.client.rigs.target import find_target
from rigd.remote.client.verbs import AsyncVerbs
from rigd.remote.client.watching import RunWatch, each, reader, without_gaps
from rigd.remote.protocol import (
    Frame,
    RigEvent,
    Status,
    decode_frame,
)
from rigd.remote.protocol.status import LastRun

#: How long a daemon may be silent to a client that watches it, in s; it reports twice a second.
PATIENCE_S: Final = 10.0


class AsyncClient(AsyncVerbs):
    """Controls one rig through its daemon: ``async with AsyncClient("lugre-1") as rig: ...``.

    ``rig`` is looked up in the client's own list (:mod:`rigd.remote.client.rigs.remotes`), or is on
    this machine; ``endpoint`` (``tls/rig.lab:7447``), ``tls`` and ``identity`` take precedence.

    Every verb raises :class:`~rigd.model.errors.LinkError` if no daemon answers, and
    :class:`~rigd.remote.protocol.Refusal`, with a ``code``, if the daemon refuses; then nothing has
    changed. Commands need the control lease, see :meth:`control`; a stop does not need it.

    Raises:
        ConfigError: the list or an argument is wrong.
        Refusal: a name is not allowed in a key.
    """

    def __init__(
        self,
        rig: str | None = None,
        *,
        endpoint: str | None = None,
        tls: TlsFiles | None = None,
        identity: str | None = None,
    ) -> None:
        self._target = find_target(rig, endpoint, tls, identity)
        self._opened: Connection | None = None
        self._holding = LeaseKeeper(self.lease_renew, self._release)

    async def open(self) -> Self:
        """Connect.

        Raises:
            LinkError: no daemon admits this client there, or there is no such rig.
            ConfigError: there are several rigs, and none is named.
        """
        if self._opened is None:
            self._opened = await Connection.open(self._target)
        return self

    async def close(self) -> None:
        """Disconnect; closing twice is silent.

        A lease that is still held then expires, and the daemon follows `on_client_loss` of the
        procedure. If the run must continue, release the lease first.
        """
        await self._holding.end()
        if self._opened is not None:
            await self._opened.close()
            self._opened = None

    async def __aenter__(self) -> Self:
        return await self.open()

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    @property
    def connection(self) -> Connection:
        """The connection beneath; LinkError if it is not open."""
        if self._opened is None:
            raise LinkError("this client is not connected", hint="open() it, or use it by `with`")
        return self._opened

    @property
    def rig(self) -> str:
        """The name of the rig."""
        return self.connection.rig

    @property
    def identity(self) -> str:
        """The name under which the daemon knows this client."""
        return self._target.identity

    @property
    def holds_lease(self) -> bool:
        """Whether this client keeps the control lease, as far as it knows."""
        return self._holding.holds

    # Looking

    async def status(self) -> Status:
        """Return the state of everything; at most half a second old."""
        return await self.connection.status()

    def watch(self, patience_s: float | None = PATIENCE_S) -> AsyncGenerator[Status, None]:
        """Yield the status at every change and twice a second; drop all but the newest if too fast.

        Raises:
            LinkError: no status arrived for ``patience_s``; None waits without limit.
        """
        payloads = self.connection.listen(self.connection.keys.status, STATUSES)
        return each(payloads, reader(Status), self.rig, patience_s)

    def watch_live(self, stream: str) -> AsyncGenerator[Frame, None]:
        """Yield the newest frames of a stream while it has data, at most 30 a second.

        The streams and their channels are those of :meth:`describe`.
        """
        payloads = self.connection.listen(self.connection.keys.live(stream), FRAMES)
        return each(payloads, decode_frame, self.rig)

    def watch_events(self, since: int | None = None) -> AsyncGenerator[RigEvent, None]:
        """Yield events, from now on or from number ``since``, without gaps.

        Events that were lost on the way are requested again; events that the daemon no longer has
        leave a gap in the numbers. A daemon that is restarted counts from 0 again.
        """
        payloads = self.connection.listen(self.connection.keys.event, EVENTS)
        return without_gaps(each(payloads, reader(RigEvent), self.rig), self.events, since)

    async def wait(self, run: str, *, patience_s: float = PATIENCE_S) -> LastRun:
        """Return how ``run`` ended, once it has.

        Raises:
            LinkError: the daemon fell silent, or was restarted, so that the run is interrupted.
            Refusal: the run is neither in progress nor the run that ended last.
        """
        watched = RunWatch(run)
        async with aclosing(self.watch(patience_s)) as statuses:
            async for status in statuses:
                ended = watched.ended(status)
                if ended is not None:
                    return ended
        raise LinkError("the client was closed")

    @asynccontextmanager
    async def control(self, *, brief: bool = False) -> AsyncIterator[None]:
        """Hold the control lease within a block.

        After an exception the lease is not released but expires, so that the daemon follows
        `on_client_loss` of the procedure. It is released after a refusal, and with ``brief`` after
        any exception: for single commands to a run that needs no client. A lease that this client
        held before does not change, nor does that of another process of its name; if that process
        does not renew it any more, since it was killed, the lease is given back too.
        """
        held = self._holding.holds
        was_ours = (await self.lease()).is_held_by(self.identity)
        await self.lease_take()
        if held:
            yield
            return
        async with self._holding.until_left(brief=brief, give_back=not was_ours):
            yield
        if was_ours and not brief:
            await self._holding.give_back_unless_renewed(self.lease)
