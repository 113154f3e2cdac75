"""Limits the number and age of browser connections, so that the panel always receives a stop.

Without these limits, uvicorn (the HTTP server) waits without end for the rest of a request that has
begun. It also accepts no connection if very many are open. A few hundred silent connections of one
client would block a stop.
"""

from __future__ import annotations

import asyncio
from time import monotonic
from typing import Final

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

#: Simultaneous connections, except those of open pages. A browser has six.
MOST_CONNECTIONS: Final = 128
#: Longest time for the head of a request, in s.
HEAD_S: Final = 10.0


class BrowserConnection(H11Protocol):
    """An HTTP connection: closed if no request comes, or if another connection needs its place.

    If all places are in use, the panel closes the connection that has waited longest for a request,
    or else the connection whose request takes longest.
    """

    since_s = 0.0  #: start of waiting for a request, or of carrying out a request; monotonic
    _time_limit: asyncio.TimerHandle | None = None  # runs while the connection waits for a request

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]  # as uvicorn's own
        """Take a place."""
        others = [
            connection
            for connection in self.connections
            if isinstance(connection, BrowserConnection)
        ]
        if len(others) >= MOST_CONNECTIONS:
            least = min(others, key=lambda item: (item.is_busy, item.since_s))
            self.connections.discard(least)  # others may come before it has ended
            least.transport.abort()
        super().connection_made(transport)
        self._wait()

    def data_received(self, data: bytes) -> None:
        """Receive data; the time limit ends with the head of the request, not with each byte."""
        super().data_received(data)
        if self.is_busy and self._time_limit is not None:
            self.since_s = monotonic()
            self._stop_waiting()

    def on_response_complete(self) -> None:
        """Wait for the next request, unless it has arrived already."""
        super().on_response_complete()
        if not self.is_busy:
            self._wait()

    def handle_websocket_upgrade(self, event: h11.Request) -> None:
        """Become the WebSocket of a page, which has limits of its own."""
        self._stop_waiting()
        super().handle_websocket_upgrade(event)

    def connection_lost(self, exc: Exception | None) -> None:
        """Free the place."""
        self._stop_waiting()
        super().connection_lost(exc)

    @property
    def is_busy(self) -> bool:
        """Whether a request has arrived that is not answered yet."""
        return self.conn.our_state in (h11.SEND_RESPONSE, h11.SEND_BODY)

    def _wait(self) -> None:
        self._stop_waiting()
        self.since_s = monotonic()
        self._time_limit = self.loop.call_later(HEAD_S, self.transport.abort)

    def _stop_waiting(self) -> None:
        if self._time_limit is not None:
            self._time_limit.cancel()
            self._time_limit = None
