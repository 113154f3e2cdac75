"""Remembers executed requests: a repeated request gets its reply and is not executed twice.

If a client receives no reply, it sends the same bytes again. An attacker can record these bytes and
send them later. Such a request is not executed: while it is remembered, it counts as repeated; when
it is forgotten, it is too old. A request that was sent before this memory existed is refused too,
because another daemon may have executed it.
"""

from __future__ import annotations

import time
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from rigd.remote.protocol import Code, Refusal
from rigd.remote.protocol.limits import FRESH_S

#: How long a reply is remembered: a request may be FRESH_S old when it comes, and as much ahead.
MEMORY_S: Final = 2 * FRESH_S + 1
#: Requests of one identity, and identities, that are remembered.
MAX_REQUESTS: Final = 512
MAX_SENDERS: Final = 64


@dataclass(frozen=True)
class StoredReply:
    """The bytes of a reply, or of an error reply."""

    ok: bool
    payload: bytes


@dataclass(frozen=True)
class _Done:
    digest: bytes
    answer: StoredReply
    until_ns: int


class Requests:
    """The stored requests of one lane; only the thread of this lane uses them.

    ``wait_s`` is how long a request may wait for its turn without growing older: of a lane whose
    clients wait that long, while an old request of another lane must not start a rig. ``clock`` is
    monotonic, ns; ``wall`` is ns since the Unix epoch.
    """

    def __init__(
        self,
        *,
        wait_s: float = 0.0,
        clock: Callable[[], int] = time.monotonic_ns,
        wall: Callable[[], int] = time.time_ns,
    ) -> None:
        self._wait_ns = round(wait_s * 1e9)
        self._memory_s = MEMORY_S + wait_s
        self._clock = clock
        self._wall = wall
        self._since_ns = clock()
        self._done: dict[str, OrderedDict[str, _Done]] = {}  # by identity and id, oldest first

    def recall(self, identity: str, request_id: str, digest: bytes) -> StoredReply | None:
        """Return the stored answer to this request, or None if it is new.

        ``digest`` is of its key and its bytes.

        Raises:
            Refusal: another request had that id.
        """
        mine = self._done.get(identity)
        done = None if mine is None else mine.get(request_id)
        if done is None:
            return None
        if done.digest != digest:
            raise Refusal(
                Code.REPLAYED,
                f"another request had the id {request_id}",
                hint="make a new id for each request",
            )
        return done.answer

    def admit(self, identity: str, sent_ns: int, waited_ns: int = 0) -> None:
        """Check that a new request is fresh, and that it can be remembered.

        ``waited_ns`` is how long it has waited here for its turn.

        Raises:
            Refusal: it is not, or it cannot.
        """
        spared_ns = min(waited_ns, self._wait_ns)
        age_ns = self._wall() - sent_ns - spared_ns
        if abs(age_ns) > FRESH_S * 1e9:
            if abs(age_ns - (waited_ns - spared_ns)) <= FRESH_S * 1e9:
                raise Refusal(
                    Code.REPLAYED,
                    f"the request waited {waited_ns * 1e-9:.1f} s for others before it, "
                    f"at most {self._wait_ns * 1e-9 or FRESH_S:.0f} s are allowed",
                    hint="look at the status, then make a new request",
                )
            side = "old" if age_ns > 0 else "ahead of the daemon's clock"
            raise Refusal(
                Code.REPLAYED,
                f"the request is {abs(age_ns) * 1e-9:.1f} s {side}, "
                f"at most {FRESH_S:.0f} s are allowed",
                hint="set the clocks of both computers (NTP)",
            )
        if age_ns > self._clock() - self._since_ns - spared_ns:
            raise Refusal(
                Code.REPLAYED,
                "the request is older than this daemon; an earlier daemon may have carried it out",
                hint="look at the status, then make a new request",
            )
        self._forget()
        mine = self._done.get(identity)
        if mine is None and len(self._done) >= MAX_SENDERS:
            raise Refusal(Code.BUSY, f"{MAX_SENDERS} others have commanded within a minute")
        if mine is not None and len(mine) >= MAX_REQUESTS:
            raise Refusal(
                Code.BUSY,
                f"{identity} has sent {MAX_REQUESTS} commands within {self._memory_s:.0f} s",
                hint="send fewer",
            )

    def remember(self, identity: str, request_id: str, digest: bytes, answer: StoredReply) -> None:
        """Store the answer to a request; one that was not admitted may displace the oldest."""
        until_ns = self._clock() + round(self._memory_s * 1e9)
        mine = self._done.setdefault(identity, OrderedDict())
        mine[request_id] = _Done(digest, answer, until_ns)
        if len(mine) > MAX_REQUESTS:
            mine.popitem(last=False)
        if len(self._done) > MAX_SENDERS:
            del self._done[next(iter(self._done))]

    def _forget(self) -> None:
        now_ns = self._clock()
        for identity in list(self._done):
            mine = self._done[identity]
            while mine and next(iter(mine.values())).until_ns <= now_ns:
                mine.popitem(last=False)
            if not mine:
                del self._done[identity]
