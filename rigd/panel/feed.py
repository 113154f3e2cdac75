"""The WebSocket of the page: status, events and frames at the rate at which the browser draws."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from dataclasses import dataclass, field
from typing import Any, Final

from starlette.websockets import WebSocket, WebSocketDisconnect, WebSocketState

from rigd.panel.hub import Hub
from rigd.panel.outbox import Outbox
from rigd.panel.rates import Bucket
from rigd.panel.routes import PanelApi
from rigd.panel.sessions import Session

#: Close codes of our own (4000 to 4999 are free for applications, RFC 6455, section 7.4.2).
NO_SESSION: Final = 4401
TOO_MANY: Final = 4429
#: Pages of one session, of all, and of all where those only watch: who commands finds room.
MOST_OF_ONE: Final = 8
MOST_PAGES: Final = 64
MOST_WATCHING: Final = 48
#: What the browser says when it has drawn a batch of frames.
DRAWN: Final = "drawn"


@dataclass
class PageSocket:
    """Serves every open page."""

    hub: Hub
    doors: PanelApi
    pages: int = 0
    told: Bucket = field(default_factory=lambda: Bucket(per_s=2.0, burst=20.0))  #: turned away

    async def serve(self, socket: WebSocket) -> None:
        """Serve one page until it leaves."""
        session = self.doors.find(socket.cookies)
        if session is None:
            await self._turn_away(socket, NO_SESSION, "this page is not logged in")
            return
        most = MOST_PAGES if session.role == "operator" else MOST_WATCHING
        if session.pages >= MOST_OF_ONE or self.pages >= most:
            await self._turn_away(socket, TOO_MANY, "too many pages are open")
            return
        await socket.accept()
        self.pages += 1
        self.doors.sessions.open_page(session)
        try:
            with self.hub.join() as outbox:
                await _until_first(
                    _send(socket, outbox), _listen(socket, outbox), _until_over(session)
                )
            if session.over.is_set() and socket.client_state is WebSocketState.CONNECTED:
                await socket.close(NO_SESSION, "this session is over")
        finally:
            self.pages -= 1
            self.doors.sessions.close_page(session)

    async def _turn_away(self, socket: WebSocket, code: int, reason: str) -> None:
        """Say why, which takes a connection until the other side has heard it; a flood is not told.

        Not accepted, it is closed at once, with status 403.
        """
        if self.told.take():
            await socket.accept()
        await socket.close(code, reason)


async def _until_first(*jobs: Coroutine[Any, Any, None]) -> None:
    """Do all until one of them has ended; then end the others."""
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
    """Send until the page is gone."""
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
    """Hear what the page has drawn, until it leaves; anything else ends the connection."""
    try:
        while await socket.receive_text() == DRAWN:
            outbox.drawn()
    except (WebSocketDisconnect, KeyError):  # KeyError: a binary message
        return
    await socket.close(1008, "not understood")
