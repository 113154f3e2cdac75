"""Serves a WebSocket for stops only; the page opens it at the start and keeps it open.

A browser opens at most six connections for the requests of all pages of a panel. A few dry runs or
downloads use all of them, and a stop would wait for one of them. A stop on this WebSocket does not
wait.
"""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field
from typing import Final

from pydantic import ValidationError
from starlette.websockets import WebSocket, WebSocketDisconnect

from rigd.model.errors import RigdError
from rigd.panel.answers import error_of
from rigd.panel.feed import MOST_PAGES, MOST_PER_SESSION, NO_SESSION, TOO_MANY, say_goodbye
from rigd.panel.login.sessions import Session
from rigd.panel.messages import StopRequest
from rigd.panel.routes import PanelApi
from rigd.remote.protocol import as_json

#: Most characters in a message of a page.
MOST_CHARACTERS: Final = 200


@dataclass
class StopLine:
    """Serves the stop WebSocket of every open page."""

    api: PanelApi
    open: dict[Session, int] = field(default_factory=dict)

    async def serve(self, socket: WebSocket) -> None:
        """Serve one page until it disconnects, or its session ends."""
        session = self.api.find(socket.cookies)
        if session is None:
            await say_goodbye(socket, NO_SESSION, "this page is not logged in")
            return
        lines = self.open.get(session, 0)
        if lines >= MOST_PER_SESSION or sum(self.open.values()) >= 2 * MOST_PAGES:
            await say_goodbye(socket, TOO_MANY, "too many pages are open")
            return
        self.open[session] = lines + 1
        try:
            await socket.accept()
            async with asyncio.TaskGroup() as group:
                over = group.create_task(_end(socket, session))
                await self._listen(socket, session, group)
                over.cancel()
        finally:
            self.open[session] -= 1
            if not self.open[session]:
                del self.open[session]

    async def _listen(self, socket: WebSocket, session: Session, group: asyncio.TaskGroup) -> None:
        """Carry out stops until the page disconnects; no stop waits for the answer to another."""
        try:
            while True:
                text = await socket.receive_text()
                request = StopRequest.model_validate_json(text[:MOST_CHARACTERS])
                group.create_task(self._carry_out(socket, session, request))
        except (WebSocketDisconnect, KeyError, RuntimeError):  # binary, or closed by this side
            return
        except ValidationError:
            await say_goodbye(socket, 1008, "unknown message")

    async def _carry_out(self, socket: WebSocket, session: Session, request: StopRequest) -> None:
        try:
            answer = {"answer": as_json(await self.api.stop_for(session, request.verb))}
        except RigdError as error:
            answer = {"error": as_json(error_of(error)[0])}
        try:
            await socket.send_json({"number": request.number, **answer})
        except (WebSocketDisconnect, RuntimeError):  # RuntimeError: this side has closed it
            return


async def _end(socket: WebSocket, session: Session) -> None:
    """Close the WebSocket when the session ends."""
    await session.over.wait()
    await say_goodbye(socket, NO_SESSION, "this session is over")
