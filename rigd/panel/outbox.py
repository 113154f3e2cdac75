"""The messages that wait for one browser: bounded, newest kept."""

from __future__ import annotations

import asyncio
import json
from collections import deque
from typing import Final

from rigd.panel.frames import merge
from rigd.panel.rig import Object
from rigd.remote.protocol.frame import Frame, encode_frame

#: Points per stream that a browser which has fallen behind gets in one frame.
MOST_POINTS: Final = 240
#: Events that wait for one browser; an older one is counted as skipped.
MOST_EVENTS: Final = 500
#: Batches of frames that may be under way to a browser that has not said it drew them.
MOST_UNDER_WAY: Final = 2


class Outbox:
    """The messages for one browser.

    Of each kind of text only the newest is kept, events in order up to a bound, and the frames of
    a stream are merged into one: a slow browser gets fewer and coarser frames, without gaps.
    """

    def __init__(self) -> None:
        self._newest: dict[str, str] = {}
        self._events: deque[str] = deque()
        self._skipped = 0
        self._frames: dict[int, Frame] = {}
        self._under_way = 0
        self._wake = asyncio.Event()

    def tell(self, kind: str, told: Object) -> None:
        """Put a text of which only the newest matters."""
        self._newest[kind] = json.dumps({"kind": kind, kind: told}, allow_nan=False)
        self._wake.set()

    def event(self, event: Object) -> None:
        """Put an event behind the others."""
        if len(self._events) >= MOST_EVENTS:
            self._events.popleft()
            self._skipped += 1
        self._events.append(json.dumps({"kind": "event", "event": event}, allow_nan=False))
        self._wake.set()

    def frame(self, frame: Frame) -> None:
        """Put a frame, merged with what already waits of its stream."""
        waiting = self._frames.get(frame.stream)
        self._frames[frame.stream] = (
            frame if waiting is None else merge(waiting, frame, MOST_POINTS)
        )
        self._wake.set()

    def drawn(self) -> None:
        """The browser has drawn a batch of frames and can take another."""
        self._under_way = max(0, self._under_way - 1)
        self._wake.set()

    async def take(self) -> list[str | bytes]:
        """Wait for something to send, and return all that may be sent now, in order.

        Frames come as one binary message: behind one another, each of a length that its head says.
        """
        while not (ready := self._ready()):
            self._wake.clear()
            await self._wake.wait()
        return ready

    def _ready(self) -> list[str | bytes]:
        ready: list[str | bytes] = [*self._newest.values()]
        self._newest.clear()
        if self._skipped:
            ready.append(json.dumps({"kind": "skipped", "skipped": self._skipped}))
            self._skipped = 0
        ready += self._events
        self._events.clear()
        if self._frames and self._under_way < MOST_UNDER_WAY:
            self._under_way += 1
            ready.append(b"".join(encode_frame(frame) for frame in self._frames.values()))
            self._frames.clear()
        return ready
