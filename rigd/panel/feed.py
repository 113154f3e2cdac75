"""Sends status, events and live data to the page by WebSocket, as fast as the browser draws."""

from __future__ import annotations

import asyncio
import re
from collections.abc import Coroutine
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, Final

from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.websockets import WebSocket, WebSocketDisconnect, WebSocketState

from rigd.panel.hub import Hub
from rigd.panel.login.sessions import Session
from rigd.panel.outbox import Outbox
from rigd.panel.routes import PanelApi
from rigd.remote.protocol.limits import MAX_FRAME_POINTS
from rigd.remote.request_rates import Bucket

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
#: The message that tells how many points of each second a page can show: ``points 72``.
POINTS: Final = re.compile(r"points ([1-9]\d{0,3})")


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
                await say_goodbye(socket, NO_SESSION, "this session is over")
        finally:
            self.pages -= 1
            self.api.sessions.close_page(session)

    async def past(self, request: Request) -> Response:
        """Send the rows between two times of the last half minute, as finely as they came.

        ``from_s`` and ``to_s`` are s since the Unix epoch, ``points`` how many of a stream are
        sent at most, each with the extremes of its piece of the time.
        """
        session = self.api.find(request.cookies)
        if session is None:
            return PlainTextResponse("this page is not logged in", 401)
        if not session.requests.take():
            return PlainTextResponse("too many requests; wait a second", 429)
        wanted = request.query_params
        try:
            start_s, end_s, most = (
                float(wanted["from_s"]), float(wanted["to_s"]), int(wanted["points"])
            )  # fmt: skip
        except (KeyError, ValueError):
            return PlainTextResponse("from_s, to_s and points are numbers", 400)
        most = max(1, min(most, MAX_FRAME_POINTS))
        # A thread: pages that look at the past must not delay a stop.
        found = await asyncio.to_thread(self.hub.past, start_s, end_s, most)
        return Response(found, media_type="application/octet-stream")

    async def _refuse(self, socket: WebSocket, code: int, reason: str) -> None:
        """Close with a reason, which keeps the connection until the browser has received it.

        In a flood the connection is not accepted: it ends at once, with status 403.
        """
        if self.reasons.take():
            await socket.accept()
        await say_goodbye(socket, code, reason)


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
    except (WebSocketDisconnect, RuntimeError):  # RuntimeError: the page has just said goodbye
        return


async def say_goodbye(socket: WebSocket, code: int, reason: str) -> None:
    """Close, unless the page has just done so."""
    with suppress(WebSocketDisconnect, RuntimeError):
        await socket.close(code, reason)


async def _listen(socket: WebSocket, outbox: Outbox) -> None:
    """Receive what the page has drawn and can show until it leaves; other messages end it."""
    try:
        while True:
            text = await socket.receive_text()
            if text == DRAWN:
                outbox.drawn()
            elif points := POINTS.fullmatch(text):
                outbox.points_per_s = float(points[1])
            else:
                break
    except (WebSocketDisconnect, KeyError, RuntimeError):
        # KeyError: a binary message; RuntimeError: the page has gone, as a write to it has shown.
        return
    await say_goodbye(socket, 1008, "unknown message")
