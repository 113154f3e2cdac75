"""The panel as an ASGI application."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Final

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import FileResponse
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles

from rigd.panel.feed import Feed
from rigd.panel.files import Files
from rigd.panel.guard import Guard, Place
from rigd.panel.hub import Hub
from rigd.panel.rates import Bucket
from rigd.panel.rig import Rig
from rigd.panel.routes import Doors
from rigd.panel.seat import Seat
from rigd.panel.sessions import Sessions

STATIC: Final = Path(__file__).parent / "static"
#: Attempts to log in, of everybody together.
LOGINS_PER_S: Final = 0.2
LOGINS_BURST: Final = 10.0


def build_app(rig: Rig, sessions: Sessions, place: Place, port: int) -> Guard:
    """Return the panel of ``rig``, reached at ``place``; it follows the rig while it runs."""

    def changed() -> None:
        hub.refresh()

    seat = Seat(rig, sessions, changed)
    hub = Hub(rig, lambda status: status | {"control": seat.describe(status["lease"])})
    secure = place.scheme == "https"
    logins = Bucket(LOGINS_PER_S, LOGINS_BURST)
    doors = Doors(rig, sessions, seat, f"rigd-{port}", secure, logins)
    feed = Feed(hub, doors, changed)

    @asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        async with asyncio.TaskGroup() as group:
            tasks = [group.create_task(hub.run()), group.create_task(seat.keep())]
            yield
            for task in tasks:
                task.cancel()

    async def page(_: Request) -> FileResponse:
        return FileResponse(STATIC / "index.html")

    app = Starlette(
        lifespan=lifespan,
        routes=[
            Route("/", page, methods=["GET"]),
            Mount("/static", StaticFiles(directory=STATIC)),
            WebSocketRoute("/api/live", feed.serve),
            *doors.routes(),
            *Files(rig, doors).routes(),
        ],
    )
    return Guard(app, place)
