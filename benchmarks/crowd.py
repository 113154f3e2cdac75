"""Ten clients that watch every stream of a rig, and a client that floods it with questions."""

from __future__ import annotations

import json
import secrets
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from typing import Final

from support.daemon.zenoh_client import Refused, ZenohClient, config

WATCHERS: Final = 10
TRIES: Final = 10
#: The flood ends with its client; a client that is left behind ends after this, in s.
FLOOD_S: Final = 600.0


def elsewhere(endpoint: str) -> ZenohClient:
    """Return a client in the place of one on another computer: it runs at niceness 19.

    On a crowded machine it may have to try again.
    """
    for _ in range(TRIES - 1):
        with suppress(Refused):
            return ZenohClient(config(endpoint), niceness=19)
    return ZenohClient(config(endpoint), niceness=19)


def message() -> bytes:
    """Return the bytes of a new request without arguments."""
    content = {"v": 1, "id": secrets.token_hex(16), "sent_ns": time.time_ns(), "args": {}}
    return json.dumps(content).encode()


@contextmanager
def crowded(endpoint: str, rig: str) -> Iterator[None]:
    """Let ten clients watch ``rig`` and one flood it while inside."""
    with ExitStack() as others:
        for _ in range(WATCHERS):
            watcher = others.enter_context(elsewhere(endpoint))
            watcher.subscribe(f"rigd/{rig}/**")
        flood = others.enter_context(elsewhere(endpoint))
        flood.flood(f"rigd/{rig}/ask/mallory/describe", message(), FLOOD_S)
        yield
