"""Bounds what one browser connection may use, so that stops of others always get through.

By itself uvicorn waits without end for a request that was begun, and turns everybody away where
very many do so: a few hundred connections of one who says nothing would be in the way of a stop.
"""

from __future__ import annotations

import asyncio
from time import monotonic
from typing import Final

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

#: Connections at once, but for those of open pages. A browser has six.
MOST_CONNECTIONS: Final = 128
#: How long the head of a request may take to come, in s.
HEAD_S: Final = 10.0


class BrowserConnection(H11Protocol):
    """A connection by HTTP: closed where no request comes, or where others need its place.

    Where all places are taken, that makes way which has waited longest for a request, or else that
    whose request takes longest.
    """

    since_s = 0.0  #: it waits for a request, or carries one out, since then; monotonic
    _patience: asyncio.TimerHandle | None = None  # runs while it waits for a request

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Take a place."""
        others = [
            connection
            for connection in self.connections
            if isinstance(connection, BrowserConnection)
        ]
        if len(others) >= MOST_CONNECTIONS:
            least = min(others, key=lambda item: (item.is_busy, item.since_s))
            self.connections.discard(least)  # others may come before its end is known
            least.transport.abort()
        super().connection_made(transport)
        self._wait()

    def data_received(self, data: bytes) -> None:
        """Take what came; the patience ends with the head, and not with every byte of it."""
        super().data_received(data)
        if self.is_busy and self._patience is not None:
            self.since_s = monotonic()
            self._stop_waiting()

    def on_response_complete(self) -> None:
        """Wait for the next request, unless it has come already."""
        super().on_response_complete()
        if not self.is_busy:
            self._wait()

    def handle_websocket_upgrade(self, event: h11.Request) -> None:
        """Become the connection of a page, which has bounds of its own."""
        self._stop_waiting()
        super().handle_websocket_upgrade(event)

    def connection_lost(self, exc: Exception | None) -> None:
        """Give the place back."""
        self._stop_waiting()
        super().connection_lost(exc)

    @property
    def is_busy(self) -> bool:
        """Whether a request has come that is not answered yet."""
        return self.conn.our_state in (h11.SEND_RESPONSE, h11.SEND_BODY)

    def _wait(self) -> None:
        self._stop_waiting()
        self.since_s = monotonic()
        self._patience = self.loop.call_later(HEAD_S, self.transport.abort)

    def _stop_waiting(self) -> None:
        if self._patience is not None:
            self._patience.cancel()
            self._patience = None
