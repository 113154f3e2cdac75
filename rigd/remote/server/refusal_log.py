"""Counts refused requests and logs them at a bounded rate."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from typing import Final

from rigd.remote.protocol import Code, Refusal
from rigd.remote.protocol.limits import ASK_PER_S
from rigd.remote.protocol.status import RefusedCounts

_log = logging.getLogger(__name__)

#: One line in the log per this many seconds, with the number of those in between.
_LOG_EVERY_S: Final = 1.0

_COUNTED: Final = {
    Code.BAD_REQUEST: "malformed",
    Code.UNKNOWN_VERB: "malformed",
    Code.VERSION: "malformed",
    Code.TOO_LARGE: "oversized",
    Code.REPLAYED: "replayed",
    Code.FORBIDDEN: "forbidden",
}


class TooManyQuestions(Refusal):
    """A question beyond the rate that each client has."""

    def __init__(self, identity: str) -> None:
        super().__init__(
            Code.BUSY,
            f"{identity} asks more than {ASK_PER_S:g} questions a second",
            hint="ask less often; the status and live data come by themselves",
        )
        self.identity = identity


class Refused:
    """Counts refused messages by reason; any thread may count."""

    def __init__(self, clock: Callable[[], int] = time.monotonic_ns) -> None:
        self._clock = clock
        self._lock = threading.Lock()
        self._counts = dict.fromkeys(RefusedCounts.model_fields, 0)
        self._unlogged = 0
        self._log_from_ns = clock()

    def count(self, key: str, refusal: Refusal) -> None:
        """Count a refusal, unless it is normal, such as a lease held by another client.

        ``key`` is the request.
        """
        too_many = isinstance(refusal, TooManyQuestions)
        kind = "too_many" if too_many else _COUNTED.get(refusal.code)
        if kind is None:
            return
        with self._lock:
            self._counts[kind] += 1
            now_ns = self._clock()
            if now_ns < self._log_from_ns:
                self._unlogged += 1
                return
            self._log_from_ns = now_ns + round(_LOG_EVERY_S * 1e9)
            unlogged, self._unlogged = self._unlogged, 0
        _log.warning(
            "refused (%s) %.200r: %.300r; %d more since the last line",
            refusal.code.value, key, refusal.message, unlogged,
        )  # fmt: skip

    def counts(self) -> RefusedCounts:
        """Return the counts so far."""
        with self._lock:
            return RefusedCounts(**self._counts)
