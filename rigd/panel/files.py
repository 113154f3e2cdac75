"""Passes reports and recordings on to the page in pieces."""

from __future__ import annotations

import base64
import binascii
import hashlib
from collections.abc import AsyncIterator
from dataclasses import dataclass
from typing import Final

from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response, StreamingResponse
from starlette.routing import Route

from rigd.model.errors import ProtocolError, RigdError
from rigd.panel.answers import refuse
from rigd.panel.rig import Object, Rig
from rigd.panel.routes import PanelApi
from rigd.remote.protocol.limits import MAX_PIECE_BYTES

#: A report is a page of its own: no script, nothing from elsewhere, shown inside the panel only.
REPORT_POLICY: Final = (
    "sandbox; default-src 'none'; style-src 'unsafe-inline'; img-src data:; font-src data:; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'self'"
)
#: A report larger than this is not shown.
MOST_REPORT_BYTES: Final = 64 * 1024 * 1024


@dataclass(frozen=True)
class Files:
    """The panel's doors to files."""

    rig: Rig
    doors: PanelApi

    def routes(self) -> list[Route]:
        """Return the routes."""
        return [
            Route("/api/run/{run}/report", self.report, methods=["GET"]),
            Route("/api/run/{run}/recording", self.recording, methods=["GET"]),
        ]

    async def report(self, request: Request) -> Response:
        """Send the report of a run."""
        if self.doors.find(request.cookies) is None:
            return PlainTextResponse("this page is not logged in", 401)
        try:
            page = "run" if request.query_params.get("page") == "run" else "identification"
            pieces = Pieces(self.rig, "report", request.path_params["run"], page=page)
            await pieces.begin(MOST_REPORT_BYTES)
            body = b"".join([piece async for piece in pieces])
        except RigdError as error:
            return refuse(error)
        return Response(
            body, media_type="text/html", headers={"content-security-policy": REPORT_POLICY}
        )

    async def recording(self, request: Request) -> Response:
        """Send a recording, piece by piece as it comes."""
        if self.doors.find(request.cookies) is None:
            return PlainTextResponse("this page is not logged in", 401)
        run = request.path_params["run"]
        pieces = Pieces(self.rig, "fetch", run)
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
    """A file of the rig, asked for piece by piece; what comes is checked against its hash."""

    def __init__(self, rig: Rig, what: str, run: str, **further: str) -> None:
        self._rig = rig
        self._what = what
        self._run = run
        self._further = further
        self._first: Object = {}

    async def begin(self, most: int | None = None) -> int:
        """Ask for the first piece and return the size of the whole in bytes.

        Raises:
            Refusal: there is no such file.
            ProtocolError: it is larger than ``most``.
        """
        self._first = await self._piece(0)
        size = int(self._first["size"])
        if most is not None and size > most:
            raise ProtocolError(f"the {self._what} has {size} bytes, at most {most} are shown")
        return size

    async def __aiter__(self) -> AsyncIterator[bytes]:
        """Yield the file.

        Raises:
            ProtocolError: it changed on the way; whoever reads it gets less than was promised.
        """
        piece, offset, digest = self._first, 0, hashlib.sha256()
        size, wanted = int(piece["size"]), piece["sha256"]
        while True:
            data = _data(piece)
            digest.update(data)
            offset += len(data)
            if offset >= size or not data:
                break
            yield data
            piece = await self._piece(offset)
        # The last piece is held back until the whole is known to be right.
        if offset != size or digest.hexdigest() != wanted:
            raise ProtocolError(f"{self._run} changed while it was read", hint="fetch it again")
        yield data

    async def _piece(self, offset: int) -> Object:
        args = {"run": self._run, "offset": offset, "length": MAX_PIECE_BYTES, **self._further}
        return await self._rig.ask(self._what, args)


def _data(piece: Object) -> bytes:
    try:
        return base64.b64decode(piece["data"], validate=True)
    except binascii.Error as error:
        raise ProtocolError("a piece of a file is not base64") from error
