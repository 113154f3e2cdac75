"""Builds the panel as an ASGI application (a Python interface for web servers)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import FileResponse
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp

from rigd.panel.feed import PageSocket
from rigd.panel.files import Files
from rigd.panel.guard import PanelAddress, RequestGuard
from rigd.panel.hub import Hub
from rigd.panel.login.sessions import Sessions
from rigd.panel.rig import Rig
from rigd.panel.routes import PanelApi
from rigd.panel.stop_line import StopLine
from rigd.remote.request_rates import BucketByClient

STATIC: Final = Path(__file__).parent / "static"
#: Attempts to log in, of all clients together.
LOGINS_PER_S: Final = 0.2
LOGINS_BURST: Final = 10.0


@dataclass(frozen=True)
class PanelApp:
    """The application, and the connection to the rig that must run with it."""

    app: ASGIApp
    hub: Hub


def build_panel(rig: Rig, sessions: Sessions, place: PanelAddress, port: int) -> PanelApp:
    """Return the panel of ``rig``, which browsers reach at ``place``."""
    hub = Hub(rig)
    secure = place.scheme == "https"
    logins = BucketByClient(LOGINS_PER_S, LOGINS_BURST)
    api = PanelApi(rig, sessions, f"rigd-{port}", secure, logins)

    socket = PageSocket(hub, api)

    async def page(_: Request) -> FileResponse:
        return FileResponse(STATIC / "index.html")

    app = Starlette(
        routes=[
            Route("/", page, methods=["GET"]),
            Mount("/static", StaticFiles(directory=STATIC)),
            WebSocketRoute("/api/live", socket.serve),
            Route("/api/past", socket.past, methods=["GET"]),
            WebSocketRoute("/api/stop/line", StopLine(api).serve),
            *api.routes(),
            *Files(rig, api).routes(),
        ],
    )
    return PanelApp(RequestGuard(app, place), hub)
