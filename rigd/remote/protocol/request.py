"""Defines requests and their replies, and encodes them."""

from __future__ import annotations

import secrets
import time
from collections.abc import Mapping
from typing import Annotated, Any, Generic, TypeVar

from pydantic import Field, JsonValue, StringConstraints

from rigd.remote.protocol.limits import MAX_REQUEST_BYTES, VERSION
from rigd.remote.protocol.message import DaemonText, Message, User, Version, decode, encode
from rigd.remote.protocol.refusal import Code, Refusal

#: 16 random bytes; unique among all requests ever made.
RequestId = Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{32}$")]

A = TypeVar("A", bound=Message)


class RemoteRequest(Message, Generic[A]):
    """A request; its verb is in its key."""

    v: Version
    id: RequestId
    """The same id sent again is the same request: it gets the same reply, and acts once."""
    sent_ns: Annotated[int, Field(ge=0, lt=2**63)]
    """When it was made, in ns since the Unix epoch."""
    args: A
    user: User = ""
    """The user of a client that acts for several people, and vouches for them; else empty."""
    certificate_until_ns: Annotated[int, Field(ge=0, lt=2**63)] = 0
    """When the client's certificate expires, in ns since the Unix epoch; 0: it does not say."""


class Reply(Message):
    """A request that was carried out."""

    v: Version
    id: RequestId
    result: dict[str, JsonValue]


class Error(Message):
    """Why a request was not carried out."""

    code: Code
    message: DaemonText
    hint: DaemonText | None = None


class ErrorReply(Message):
    """A request that was not carried out; of the same form in every version to come.

    So a client that is older or newer than the daemon can read the reason.
    """

    v: Annotated[int, Field(ge=1)]
    id: RequestId | Annotated[str, StringConstraints(max_length=0)]
    """That of the request; empty if none could be read."""
    error: Error


def request_kind(arguments: type[A]) -> type[RemoteRequest[A]]:
    """Return the message type of requests that are asked with ``arguments``."""
    return RemoteRequest[arguments]  # type: ignore[valid-type]  # made at run time, from the verb table


def new_request(args: A, user: str = "", certificate_until_ns: int = 0) -> RemoteRequest[A]:
    """Return a request made now, with an id of its own."""
    return request_kind(type(args))(
        v=VERSION,
        id=secrets.token_hex(16),
        sent_ns=time.time_ns(),
        args=args,
        user=user,
        certificate_until_ns=certificate_until_ns,
    )


def encode_request(request: RemoteRequest[A]) -> bytes:
    """Return the payload of a request.

    Raises:
        Refusal: it is too large.
    """
    return encode(request, MAX_REQUEST_BYTES)


def encode_reply(request_id: str, result: Mapping[str, Any]) -> bytes:
    """Return the payload of a reply.

    Raises:
        Refusal: it is too large.
        pydantic.ValidationError: ``result`` holds something that JSON has no form for.
    """
    return encode(Reply(v=VERSION, id=request_id, result=dict(result)))


def encode_refusal(request_id: str, refusal: Refusal) -> bytes:
    """Return the payload of an error reply."""
    error = Error(code=refusal.code, message=refusal.message, hint=refusal.hint)
    return encode(ErrorReply(v=VERSION, id=request_id, error=error))


def decode_refusal(payload: bytes) -> Refusal:
    """Return the refusal that an error reply holds.

    An answer that is none, such as zenoh's own ``Timeout``, becomes a refusal as ``internal``.
    """
    try:
        error = decode(ErrorReply, payload).error
    except Refusal:
        return Refusal(Code.INTERNAL, f"no error reply of rigd: {payload[:80]!r}")
    return Refusal(error.code, error.message, hint=error.hint)
