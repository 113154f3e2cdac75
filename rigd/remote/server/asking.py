"""Whether the client of the request that a thread carries out is still connected."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_CONNECTED: ContextVar[Callable[[], bool]] = ContextVar("connected", default=lambda: True)


def still_connected() -> bool:
    """Return whether the client is still there for whom this thread works.

    True where that is not known: a client says which session is its own if it likes, as those of
    rigd do.
    """
    return _CONNECTED.get()()


@contextmanager
def working_for(connected: Callable[[], bool]) -> Iterator[None]:
    """Let :func:`still_connected` be answered by ``connected`` within."""
    token = _CONNECTED.set(connected)
    try:
        yield
    finally:
        _CONNECTED.reset(token)
