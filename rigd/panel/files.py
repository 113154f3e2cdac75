"""Sends reports and recordings from the daemon to the page in pieces."""

from __future__ import annotations

import hashlib
from collections.abc import AsyncIterator
from dataclasses import dataclass
from typing import Final

from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response, StreamingResponse
from starlette.routing import Route

from rigd.model.errors import ProtocolError, RigdError
from rigd.panel.answers import refuse
from rigd.panel.rig import Rig
from rigd.panel.routes import PanelApi
from rigd.remote.protocol import Kind
from rigd.remote.protocol.limits import MAX_PIECE_BYTES
from rigd.remote.protocol.results import PieceView

#: A report is an isolated page: no scripts, no external resources, shown inside the panel only.
REPORT_POLICY: Final = (
    "sandbox; default-src 'none'; style-src 'unsafe-inline'; img-src data:; font-src data:; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'self'"
)
#: A report larger than this is not shown.
MOST_REPORT_BYTES: Final = 64 * 1024 * 1024


@dataclass(frozen=True)
class Files:
    """The HTTP routes of reports and recordings."""

    rig: Rig
    api: PanelApi

    def routes(self) -> list[Route]:
        """Return the routes."""
        return [
            Route("/api/run/{run}/report", self.report, methods=["GET"]),
            Route("/api/comparison", self.comparison, methods=["GET"]),
            Route("/api/run/{run}/recording", self.recording, methods=["GET"]),
        ]

    async def report(self, request: Request) -> Response:
        """Send the report of a run."""
        page = "run" if request.query_params.get("page") == "run" else "identification"
        run = request.path_params["run"]
        return await self._page(request, Pieces(self.rig, "report", run, run=run, page=page))

    async def comparison(self, request: Request) -> Response:
        """Send the page that compares runs; each is a ``run`` of the query, the first the base."""
        runs = request.query_params.getlist("run")
        return await self._page(request, Pieces(self.rig, "compare", "the comparison", runs=runs))

    async def _page(self, request: Request, pieces: Pieces) -> Response:
        if self.api.find(request.cookies) is None:
            return PlainTextResponse("this page is not logged in", 401)
        try:
            await pieces.begin(MOST_REPORT_BYTES)
            body = b"".join([piece async for piece in pieces])
        except RigdError as error:
            return refuse(error)
        return Response(
            body, media_type="text/html", headers={"content-security-policy": REPORT_POLICY}
        )

    async def recording(self, request: Request) -> Response:
        """Send a recording, piece by piece."""
        if self.api.find(request.cookies) is None:
            return PlainTextResponse("this page is not logged in", 401)
        run = request.path_params["run"]
        pieces = Pieces(self.rig, "fetch", run, run=run)
        try:
            size = await pieces.begin()
        except RigdError as error:
            return refuse(error)
        name = "".join(c if (c.isalnum() and c.isascii()) or c in "._-" else "_" for c in run)
        return StreamingResponse(
            pieces,
            media_type="application/octet-stream",
            headers={
                "content-length": str(size),
                "content-disposition": f'attachment; filename="{name}"',
            },
        )


class Pieces:
    """Requests a file of the rig piece by piece, and checks the received data against its hash.

    ``verb`` gives the pieces of what ``args`` name; ``name`` is its name in errors.
    """

    def __init__(self, rig: Rig, verb: str, name: str, **args: str | list[str]) -> None:
        self._rig = rig
        self._verb = verb
        self._name = name
        self._args = args
        self._first: PieceView | None = None

    async def begin(self, most: int | None = None) -> int:
        """Request the first piece and return the size of the file in bytes.

        Raises:
            Refusal: the file does not exist.
            ProtocolError: the file is larger than ``most``.
        """
        self._first = await self._piece(0)
        size = self._first.size
        if most is not None and size > most:
            raise ProtocolError(f"the {self._verb} has {size} bytes, at most {most} are shown")
        return size

    async def __aiter__(self) -> AsyncIterator[bytes]:
        """Yield the pieces of the file.

        Raises:
            ProtocolError: the file changed meanwhile; the reader gets fewer bytes than announced.
        """
        piece, offset, digest = self._first or await self._piece(0), 0, hashlib.sha256()
        size, wanted = piece.size, piece.sha256
        while True:
            data = piece.data
            digest.update(data)
            offset += len(data)
            if offset >= size or not data:
                break
            yield data
            piece = await self._piece(offset)
        # The last piece is sent only after the hash of the whole file is checked.
        if offset != size or digest.hexdigest() != wanted:
            raise ProtocolError(f"{self._name} changed while it was read", hint="fetch it again")
        yield data

    async def _piece(self, offset: int) -> PieceView:
        args = {**self._args, "offset": offset, "length": MAX_PIECE_BYTES}
        return await self._rig.request(Kind.ASK, self._verb, args, PieceView)
