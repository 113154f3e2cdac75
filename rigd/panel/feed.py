"""Sends status, events and live data to the page by WebSocket, as fast as the browser draws."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from dataclasses import dataclass, field
from typing import Any, Final

from starlette.websockets import WebSocket, WebSocketDisconnect, WebSocketState

from rigd.panel.hub import Hub
from rigd.panel.outbox import Outbox
from rigd.panel.routes import PanelApi
from rigd.panel.sessions import Session
from rigd.remote.rates import Bucket

#: Close codes of our own (4000 to 4999 are free for applications, RFC 6455, section 7.4.2).
NO_SESSION: Final = 4401
TOO_MANY: Final = 4429
#: Pages of one session, of all sessions, and the limit at which observers are refused: the
#: difference is reserved for operators.
MOST_PER_SESSION: Final = 8
MOST_PAGES: Final = 64
MOST_WATCHING: Final = 48
#: The message of a browser that has drawn a batch of frames.
DRAWN: Final = "drawn"


@dataclass
class PageSocket:
    """Serves the WebSocket of every open page."""

    hub: Hub
    api: PanelApi
    pages: int = 0
    reasons: Bucket = field(default_factory=lambda: Bucket(per_s=2.0, burst=20.0))

    async def serve(self, socket: WebSocket) -> None:
        """Serve one page until it disconnects."""
        session = self.api.find(socket.cookies)
        if session is None:
            await self._refuse(socket, NO_SESSION, "this page is not logged in")
            return
        most = MOST_PAGES if session.role == "operator" else MOST_WATCHING
        if session.pages >= MOST_PER_SESSION or self.pages >= most:
            await self._refuse(socket, TOO_MANY, "too many pages are open")
            return
        await socket.accept()
        self.pages += 1
        self.api.sessions.open_page(session)
        try:
            with self.hub.join() as outbox:
                await _until_first(
                    _send(socket, outbox), _listen(socket, outbox), _until_over(session)
                )
            if session.over.is_set() and socket.client_state is WebSocketState.CONNECTED:
                await socket.close(NO_SESSION, "this session is over")
        finally:
            self.pages -= 1
            self.api.sessions.close_page(session)

    async def _refuse(self, socket: WebSocket, code: int, reason: str) -> None:
        """Close with a reason, which keeps the connection until the browser has received it.

        In a flood the connection is not accepted: it ends at once, with status 403.
        """
        if self.reasons.take():
            await socket.accept()
        await socket.close(code, reason)


async def _until_first(*jobs: Coroutine[Any, Any, None]) -> None:
    """Run all jobs until the first ends; then cancel the others."""
    tasks = [asyncio.create_task(job) for job in jobs]
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.wait(tasks)
    for task in tasks:
        if not task.cancelled():
            task.result()


async def _until_over(session: Session) -> None:
    await session.over.wait()


async def _send(socket: WebSocket, outbox: Outbox) -> None:
    """Send until the page disconnects."""
    try:
        while True:
            for message in await outbox.take():
                if isinstance(message, bytes):
                    await socket.send_bytes(message)
                else:
                    await socket.send_text(message)
    except WebSocketDisconnect:
        return


async def _listen(socket: WebSocket, outbox: Outbox) -> None:
    """Receive the numbers of drawn batches until the page leaves; other messages end it."""
    try:
        while await socket.receive_text() == DRAWN:
            outbox.drawn()
    except (WebSocketDisconnect, KeyError):  # KeyError: a binary message
        return
    await socket.close(1008, "unknown message")
