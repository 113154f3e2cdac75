"""Limits the rate of requests of HTTP clients."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from time import monotonic
from typing import Final

#: Most addresses that are kept: the newest.
MOST_ADDRESSES: Final = 1024


class Bucket:
    """A token bucket: ``burst`` at once, ``per_s`` in the long run."""

    def __init__(self, per_s: float, burst: float, now: Callable[[], float] = monotonic) -> None:
        self._per_s = per_s
        self._burst = burst
        self._now = now
        self._tokens = burst
        self._at_s = now()

    def take(self) -> bool:
        """Return whether another request may pass, and count it."""
        now = self._now()
        self._tokens = min(self._burst, self._tokens + (now - self._at_s) * self._per_s)
        self._at_s = now
        if self._tokens < 1.0:
            return False
        self._tokens -= 1.0
        return True


class BucketByAddress:
    """A bucket for each address, so that one client does not use up the rate of others."""

    def __init__(self, per_s: float, burst: float) -> None:
        self._per_s, self._burst = per_s, burst
        self._buckets: OrderedDict[str, Bucket] = OrderedDict()

    def take(self, address: str) -> bool:
        """Return whether another request from ``address`` may pass, and count it."""
        bucket = self._buckets.setdefault(address, Bucket(self._per_s, self._burst))
        self._buckets.move_to_end(address)
        if len(self._buckets) > MOST_ADDRESSES:
            self._buckets.popitem(last=False)
        return bucket.take()
