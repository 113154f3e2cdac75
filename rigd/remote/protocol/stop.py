"""Encodes a stop and reads its reply by plain JSON, without the models of the other messages.

To import these takes longer than all else that a stop from the command line does.
"""

from __future__ import annotations

import json
import secrets
import time
from dataclasses import dataclass, field

from rigd.remote.protocol.limits import MAX_REASON, VERSION


def one_line(text: str) -> str:
    """Return ``text`` with a space for each character that ends a line or controls a terminal."""
    return "".join(item if item.isprintable() else " " for item in text)


def stop_reason(text: str) -> str:
    """Return a reason as it travels, for any ``text``: no reason keeps a stop from being sent."""
    return one_line(text[:MAX_REASON]).encode(errors="replace").decode()


@dataclass(frozen=True)
class PlainStop:
    """A request to stop, of any severity: the verb is in its key."""

    reason: str = ""
    id: str = field(default_factory=lambda: secrets.token_hex(16))
    sent_ns: int = field(default_factory=time.time_ns)

    def encode(self) -> bytes:
        """Return the payload of the request."""
        message = {
            "v": VERSION,
            "id": self.id,
            "sent_ns": self.sent_ns,
            "args": {"reason": stop_reason(self.reason)},
        }
        return json.dumps(message).encode()

    def read_reply(self, payload: bytes) -> bool | None:
        """Return whether it acted, from the payload of the reply; None if it is no such reply."""
        try:
            reply = json.loads(payload)
            if reply["v"] == VERSION and reply["id"] == self.id:
                acted = reply["result"]["acted"]
                return acted if isinstance(acted, bool) else None
        except (ValueError, KeyError, TypeError, RecursionError):
            pass
        return None
