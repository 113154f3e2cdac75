"""Requests and responses of the panel as JSON; every refusal has the same form."""

from __future__ import annotations

import json
import logging
from typing import Any, Final

from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse, Response

from rigd.model.errors import LinkError, RigdError
from rigd.panel.rig import Object
from rigd.remote.protocol.refusal import Code, Refusal

log = logging.getLogger(__name__)

#: HTTP says only roughly what happened; the page reads the code in the body.
_STATUS: Final = {
    Code.BAD_REQUEST: 400,
    Code.UNKNOWN_VERB: 404,
    Code.NOT_FOUND: 404,
    Code.TOO_LARGE: 413,
    Code.FORBIDDEN: 403,
    Code.BUSY: 429,
    Code.INTERNAL: 502,
}


async def read_object(request: Request) -> Object:
    """Return the object that the body holds.

    Raises:
        Refusal: it holds something else.
    """
    try:
        body = await request.body()
    except ClientDisconnect as error:
        raise Refusal(Code.TOO_LARGE, "the body is too long, or was cut off") from error
    try:
        found = json.loads(body.decode(), parse_constant=_not_finite)
    except (ValueError, RecursionError) as error:
        raise Refusal(Code.BAD_REQUEST, "the body is not JSON") from error
    if not isinstance(found, dict):
        raise Refusal(Code.BAD_REQUEST, "the body is not an object")
    return found


def text_of(found: Object, key: str, most: int) -> str:
    """Return the text under ``key``, of at most ``most`` characters.

    Raises:
        Refusal: there is none.
    """
    text = found.get(key)
    if not isinstance(text, str) or len(text) > most:
        raise Refusal(Code.BAD_REQUEST, f"{key} is no text of at most {most} characters")
    return text


def object_of(found: Object, key: str) -> Object:
    """Return the object under ``key``, empty where there is none.

    Raises:
        Refusal: something else stands there.
    """
    inner = found.get(key, {})
    if not isinstance(inner, dict):
        raise Refusal(Code.BAD_REQUEST, f"{key} is not an object")
    return inner


def refusal_of(error: RigdError) -> tuple[Object, int]:
    """Return why a request was not carried out, and the status of HTTP that says so roughly."""
    if isinstance(error, Refusal):
        code, status = error.code.value, _STATUS.get(error.code, 409)
    elif isinstance(error, LinkError):
        code, status = "unreachable", 504
    else:
        code, status = "failed", 502
        log.warning("a request failed: %s", error)
    return {"code": code, "message": error.message, "hint": error.hint}, status


def refuse(error: RigdError) -> Response:
    """Return the answer that says why a request was not carried out."""
    told, status = refusal_of(error)
    return JSONResponse({"error": told}, status)


def _not_finite(text: str) -> Any:
    raise ValueError(f"{text} is not JSON")
