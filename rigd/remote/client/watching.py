"""Receives the messages of a rig in order and without gaps; waits for the end of a run."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncGenerator, Awaitable, Callable
from contextlib import aclosing
from dataclasses import dataclass
from functools import partial
from typing import Final, TypeVar

from rigd.model.errors import LinkError
from rigd.remote.client.decoding import decode_or_raise
from rigd.remote.protocol import Code, Message, Refusal, RigEvent, Status
from rigd.remote.protocol.results import Events
from rigd.remote.protocol.status import LastRun

#: A status that is so much younger than the first received one is from after the run began, in ns.
_SETTLED_NS: Final = 1_000_000_000
#: They hold all events that a daemon keeps. New ones may come as fast as a client asks.
_MOST_ANSWERS: Final = 100

M = TypeVar("M", bound=Message)
T = TypeVar("T")


async def each(
    payloads: AsyncGenerator[bytes, None],
    read: Callable[[bytes], T],
    rig: str,
    patience_s: float | None = None,
) -> AsyncGenerator[T, None]:
    """Yield the result of ``read`` for each payload.

    Raises:
        LinkError: no payload arrived for ``patience_s``.
    """
    async with aclosing(payloads):
        while True:
            try:
                async with asyncio.timeout(patience_s):
                    payload = await anext(payloads)
            except StopAsyncIteration:
                return
            except TimeoutError as error:
                raise LinkError(
                    f"{rig} has sent no message for {patience_s:g} s",
                    hint="is its daemon running, and the network there?",
                ) from error
            yield read(payload)


async def all_events(ask: Callable[[int], Awaitable[Events]], since: int) -> Events:
    """Return the events from number ``since``; one answer has as many as it can contain."""
    found: list[RigEvent] = []
    for _ in range(_MOST_ANSWERS):
        answer = await ask(since)
        found += answer.events
        since = answer.next
        if not answer.events:
            break
    return Events(events=tuple(found), next=since)


async def without_gaps(
    received: AsyncGenerator[RigEvent, None],
    ask: Callable[[int], Awaitable[Events]],
    since: int | None,
) -> AsyncGenerator[RigEvent, None]:
    """Yield events from number ``since``, or from the first; missing events are requested.

    If numbers go back while the time advances, the daemon was restarted.
    """
    wanted, newest_ns = since, 0
    async with aclosing(received):
        if wanted is not None:
            for event in (await ask(wanted)).events:
                yield event
                wanted, newest_ns = event.seq + 1, max(newest_ns, event.t_ns)
        async for event in received:
            if wanted is not None and event.seq < wanted and event.t_ns <= newest_ns:
                continue  # among those asked for
            if wanted is not None and event.seq > wanted:
                for missed in (await ask(wanted)).events:
                    if missed.seq < event.seq:
                        yield missed
            yield event
            wanted, newest_ns = event.seq + 1, max(newest_ns, event.t_ns)


@dataclass
class RunWatch:
    """Follows one run through the statuses of its rig."""

    run: str
    _first_ns: int | None = None
    _seen: bool = False

    def ended(self, status: Status) -> LastRun | None:
        """Return how the run ended, if ``status`` shows that it has.

        A run that continues an interrupted run has ended before: until it was seen in progress, a
        status that may be from before is ignored.

        Raises:
            LinkError: the daemon ended with the run, and was restarted.
            Refusal: another run is in progress, or has ended since.
        """
        if self._first_ns is None:
            self._first_ns = status.t_ns
        if status.run == self.run:
            self._seen = True
        settled = self._seen or status.t_ns - self._first_ns > _SETTLED_NS
        goes_on = status.state != "idle" and status.run in (self.run, None)
        if goes_on or not settled:
            return None
        if status.last is not None and status.last.run == self.run:
            return status.last
        if any(item.run == self.run for item in status.interrupted):
            raise LinkError(
                f"the daemon of {status.rig} ended with {self.run}, and was restarted",
                hint=f"look at the rig; `rigd remote resume-run {self.run}` goes on with it",
            )
        raise Refusal(
            Code.NOT_FOUND,
            f"{self.run} is not under way on {status.rig}, nor is it the run that ended last",
            hint="its recording, if there is one, contains how it ended",
        )


def reader(kind: type[M]) -> Callable[[bytes], M]:
    """Return the function that parses payloads as messages of ``kind``."""
    return partial(decode_or_raise, kind)
