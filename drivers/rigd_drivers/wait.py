"""Asks a device again and again for a limited time, so that no stall of this computer ends it."""

from __future__ import annotations

import time
from collections.abc import Iterator


def looks(timeout_s: float, *, late: int = 1) -> Iterator[float]:
    """Yield the time left, in s, as each look at a device begins, until it has had ``timeout_s``.

    What was read before this computer stood still says nothing: ``late`` looks begin when no time
    is left. One is enough if a look asks the device itself.
    """
    deadline_ns = time.monotonic_ns() + round(timeout_s * 1e9)
    while late:
        left_ns = deadline_ns - time.monotonic_ns()
        late -= left_ns <= 0
        yield max(left_ns, 0) * 1e-9
