"""The panel as an ASGI application."""

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
from rigd.panel.quantities import complete_status
from rigd.panel.rates import BucketByAddress
from rigd.panel.rig import Object, Rig
from rigd.panel.routes import PanelApi
from rigd.panel.seat import Seat
from rigd.panel.sessions import Sessions
from rigd.panel.stop_line import StopLine

STATIC: Final = Path(__file__).parent / "static"
#: Attempts to log in, of everybody together.
LOGINS_PER_S: Final = 0.2
LOGINS_BURST: Final = 10.0


@dataclass(frozen=True)
class PanelApp:
    """The application, and what has to run beside it."""

    app: ASGIApp
    hub: Hub
    seat: Seat


def build_panel(rig: Rig, sessions: Sessions, place: PanelAddress, port: int) -> PanelApp:
    """Return the panel of ``rig``, reached at ``place``."""
    seat = Seat(rig, sessions, lambda: hub.refresh())

    def decorate(status: Object) -> Object:
        seat.heed(status["lease"])
        return complete_status(status) | {"control": seat.describe(status["lease"])}

    hub = Hub(rig, decorate)
    secure = place.scheme == "https"
    logins = BucketByAddress(LOGINS_PER_S, LOGINS_BURST)
    doors = PanelApi(rig, sessions, seat, f"rigd-{port}", secure, logins)

    async def page(_: Request) -> FileResponse:
        return FileResponse(STATIC / "index.html")

    app = Starlette(
        routes=[
            Route("/", page, methods=["GET"]),
            Mount("/static", StaticFiles(directory=STATIC)),
            WebSocketRoute("/api/live", PageSocket(hub, doors).serve),
            WebSocketRoute("/api/stop/line", StopLine(doors).serve),
            *doors.routes(),
            *Files(rig, doors).routes(),
        ],
    )
    return PanelApp(RequestGuard(app, place), hub, seat)
