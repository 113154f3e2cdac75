"""Reads requests and builds responses of the panel as JSON; every refusal has the same form."""

from __future__ import annotations

import logging
from typing import Final, TypeVar

from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse, Response

from rigd.model.errors import LinkError, RigdError
from rigd.panel.messages import RequestError
from rigd.remote.protocol import Code, Message, Refusal, as_json, decode

log = logging.getLogger(__name__)

M = TypeVar("M", bound=Message)

#: The HTTP status for each code; the page reads the code in the body.
_STATUS: Final = {
    Code.BAD_REQUEST: 400,
    Code.UNKNOWN_VERB: 404,
    Code.NOT_FOUND: 404,
    Code.TOO_LARGE: 413,
    Code.FORBIDDEN: 403,
    Code.BUSY: 429,
    Code.INTERNAL: 502,
}


async def read_body(request: Request, kind: type[M]) -> M:
    """Return the message of ``kind`` that the body of ``request`` contains.

    Raises:
        Refusal: the body contains something else, or is too long.
    """
    try:
        body = await request.body()
    except ClientDisconnect as error:
        raise Refusal(Code.TOO_LARGE, "the body is too long, or was cut off") from error
    return decode(kind, body)


def respond(message: Message, status: int = 200) -> JSONResponse:
    """Return ``message`` as a response."""
    return JSONResponse(as_json(message), status)


def error_of(error: RigdError) -> tuple[RequestError, int]:
    """Return the reason why a request failed, and its HTTP status."""
    if isinstance(error, Refusal):
        code, status = error.code.value, _STATUS.get(error.code, 409)
    elif isinstance(error, LinkError):
        code, status = "unreachable", 504
    else:
        code, status = "failed", 502
        log.warning("a request failed: %s", error)
    return RequestError(code=code, message=error.message, hint=error.hint), status


def refuse(error: RigdError) -> Response:
    """Return the response to a request that failed."""
    reason, status = error_of(error)
    return JSONResponse({"error": as_json(reason)}, status)
