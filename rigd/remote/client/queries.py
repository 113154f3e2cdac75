"""Awaits the replies to queries, on an event loop."""

from __future__ import annotations

import asyncio
from contextlib import suppress
from typing import Final

import zenoh

from rigd.remote.client.session import QueryReply, TimedOut, begin_look, begin_query

#: How often rigs are looked for again, and after what pause, in s.
_ASKED_AGAIN: Final = 5
_PAUSE_S: Final = 0.05
#: zenoh's own answer if no peer gave one in time.
_TIMED_OUT: Final = b"Timeout"


async def query(
    session: zenoh.Session,
    key: str,
    timeout_s: float,
    payload: bytes = b"",
    *,
    urgent: bool = False,
) -> list[QueryReply]:
    """Return all answers to a query; none if no peer can answer it.

    Raises:
        TimedOut: no daemon answered in time.
    """
    done = _Done()
    answers = begin_query(session, key, timeout_s, payload, done.set, urgent=urgent)
    await done.wait()
    if any(not answer.ok and answer.payload == _TIMED_OUT for answer in answers):
        raise TimedOut
    return answers


async def rigs_alive(session: zenoh.Session) -> list[str]:
    """Return the names of the rigs that a session reaches, in order.

    The query is repeated for a moment if there seem to be none: with a router, zenoh leaves every
    second query unanswered.
    """
    for _ in range(_ASKED_AGAIN):
        if found := await _rigs_alive(session):
            return found
        await asyncio.sleep(_PAUSE_S)
    return await _rigs_alive(session)


async def _rigs_alive(session: zenoh.Session) -> list[str]:
    done = _Done()
    rigs = begin_look(session, done.set)
    await done.wait()
    return sorted(rigs)


class _Done:
    """The end of a query: zenoh's thread reports it, and the event loop that made it awaits it."""

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._event = asyncio.Event()

    def set(self) -> None:
        with suppress(RuntimeError):  # the loop has ended: nothing waits any more
            self._loop.call_soon_threadsafe(self._event.set)

    async def wait(self) -> None:
        await self._event.wait()
