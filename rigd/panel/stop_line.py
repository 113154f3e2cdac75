"""The WebSocket of the page that carries only stops; it is open from the start.

A browser has six connections for the requests of all pages of a panel. A few dry runs or downloads
take them all, and a stop would wait for one of them. What is said here waits for nothing.
"""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field
from typing import Final

from pydantic import BaseModel, ConfigDict, ValidationError
from starlette.websockets import WebSocket, WebSocketDisconnect

from rigd.model.errors import RigdError
from rigd.panel.answers import refusal_of
from rigd.panel.feed import MOST_OF_ONE, MOST_PAGES, NO_SESSION, TOO_MANY
from rigd.panel.rig import Object
from rigd.panel.routes import PanelApi
from rigd.panel.sessions import Session

#: Characters of what a page says.
MOST_SAID: Final = 200


class _Said(BaseModel):
    """A stop, with the number under which its answer is expected."""

    model_config = ConfigDict(extra="forbid", strict=True)

    number: int
    verb: str


@dataclass
class StopLine:
    """Serves the line of every open page."""

    doors: PanelApi
    open: dict[Session, int] = field(default_factory=dict)

    async def serve(self, socket: WebSocket) -> None:
        """Serve one page until it leaves, or its session ends."""
        session = self.doors.find(socket.cookies)
        if session is None:
            await socket.close(NO_SESSION, "this page is not logged in")
            return
        lines = self.open.get(session, 0)
        if lines >= MOST_OF_ONE or sum(self.open.values()) >= 2 * MOST_PAGES:
            await socket.close(TOO_MANY, "too many pages are open")
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
        """Hear stops until the page leaves; none waits for the answer to another."""
        try:
            while True:
                text = await socket.receive_text()
                said = _Said.model_validate_json(text[:MOST_SAID])
                group.create_task(self._carry_out(socket, session, said))
        except (WebSocketDisconnect, KeyError):  # KeyError: a binary message
            return
        except ValidationError:
            await socket.close(1008, "not understood")

    async def _carry_out(self, socket: WebSocket, session: Session, said: _Said) -> None:
        try:
            answer: Object = {"answer": await self.doors.stop_for(session, said.verb)}
        except RigdError as error:
            answer = {"error": refusal_of(error)[0]}
        try:
            await socket.send_json({"number": said.number, **answer})
        except (WebSocketDisconnect, RuntimeError):  # RuntimeError: it was closed on this side
            return


async def _end(socket: WebSocket, session: Session) -> None:
    """Close the line once the session is over."""
    await session.over.wait()
    await socket.close(NO_SESSION, "this session is over")
