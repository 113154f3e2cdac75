"""Decodes the messages that a client receives from a daemon."""

from __future__ import annotations

from typing import TypeVar

from rigd.model.errors import ProtocolError
from rigd.remote.protocol import Message, Refusal, decode
from rigd.remote.protocol.limits import MAX_MESSAGE_BYTES

M = TypeVar("M", bound=Message)


def decode_or_raise(kind: type[M], payload: bytes) -> M:
    """Return the message of ``kind`` that a daemon sent.

    Raises:
        ProtocolError: the payload is no such message.
    """
    try:
        return decode(kind, payload, MAX_MESSAGE_BYTES)
    except Refusal as refusal:
        raise ProtocolError(
            f"the daemon sent an invalid message: {refusal.message}",
            hint="install the same rigd at both ends",
        ) from refusal
