"""One connection to the daemon, shared by all browsers."""

from __future__ import annotations

import asyncio
import base64
import logging
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import monotonic
from typing import Final

from rigd.model.errors import RigdError
from rigd.panel.outbox import Outbox
from rigd.panel.quantities import complete_event
from rigd.panel.rig import Object, Rig
from rigd.remote.protocol.frame import Frame, decode_frame
from rigd.remote.protocol.refusal import Refusal

log = logging.getLogger(__name__)

#: A rig that says nothing for so long is shown as lost; it speaks every 0.5 s.
SILENCE_S: Final = 2.0
#: How often each browser hears from the panel, whatever the rig does.
BEAT_S: Final = 0.5
#: How often the newest values are asked for while no frames come, in s.
LATEST_EVERY_S: Final = 1.0
#: How often it is looked whether the description is missing, in s.
RETRY_S: Final = 0.25
#: Events kept for a browser that joins late.
KEPT_EVENTS: Final = 300


class Hub:
    """Follows the rig, and hands what it says to every browser that has joined.

    ``decorate`` completes a status with what the panel itself knows (who of its users has
    control).
    """

    def __init__(self, rig: Rig, decorate: Callable[[Object], Object]) -> None:
        self._rig = rig
        self._decorate = decorate
        self._outboxes: set[Outbox] = set()
        self._drawing: set[Outbox] = set()  # those that have had the past, and get frames
        self._status: Object | None = None
        self._description: Object | None = None
        self._latest: Object | None = None
        self._events: deque[Object] = deque(maxlen=KEPT_EVENTS)
        self._heard_s = -SILENCE_S
        self._frame_s = -LATEST_EVERY_S

    @property
    def alive(self) -> bool:
        """Whether the rig has spoken lately."""
        return monotonic() - self._heard_s < SILENCE_S

    @contextmanager
    def join(self) -> Iterator[Outbox]:
        """Give a browser an outbox, filled with what it missed; frames follow the past ones."""
        outbox = Outbox()
        self._beat_to(outbox)
        if self._description is not None:
            outbox.tell("describe", self._description)
        if self._status is not None:
            outbox.tell("status", self._decorate(self._status))
        if self._latest is not None:
            outbox.tell("latest", self._latest)
        for event in self._events:
            outbox.event(event)
        self._outboxes.add(outbox)
        catching_up = asyncio.create_task(self._bring_past(outbox))
        try:
            yield outbox
        finally:
            catching_up.cancel()
            self._outboxes.discard(outbox)
            self._drawing.discard(outbox)

    def refresh(self) -> None:
        """Tell every browser the status again: what the panel itself knows has changed."""
        if self._status is not None:
            self._tell("status", self._decorate(self._status))

    async def run(self) -> None:
        """Follow the rig until cancelled."""
        async with asyncio.TaskGroup() as group:
            for task in (
                self._follow_status, self._follow_events, self._follow_frames,
                self._beat, self._keep_description, self._keep_latest,
            ):  # fmt: skip
                group.create_task(task(), name=task.__name__)

    async def _follow_status(self) -> None:
        async for status in self._rig.statuses():
            was_alive = self.alive
            self._heard_s = monotonic()
            if self._status is not None and self._status["daemon"] != status["daemon"]:
                # Another daemon: its rig file may be another, and its events are numbered anew.
                self._description = None
                self._events.clear()
            self._status = status
            if not was_alive:
                self._beat_all()
            self._tell("status", self._decorate(status))

    async def _follow_events(self) -> None:
        async for event in self._rig.events():
            if self._events and event["seq"] > self._events[-1]["seq"] + 1:
                await self._fill_events()  # some were lost on the way
            self._take_event(event)

    async def _follow_frames(self) -> None:
        async for data in self._rig.frames():
            self._frame_s = monotonic()
            if not self._drawing:
                continue
            try:
                frame = decode_frame(data)
            except Refusal as error:
                log.warning("a live frame was left out: %s", error)
                continue
            for outbox in self._drawing:
                outbox.frame(frame)

    async def _bring_past(self, outbox: Outbox) -> None:
        """Give a browser the last seconds of every stream, then let it have frames."""
        streams = [] if self._description is None else self._description["streams"]
        past: list[Frame] = []
        for stream in streams if self.alive else []:
            try:
                answer = await self._rig.ask("history", {"stream": stream["name"]})
                if answer["frame"] is not None:
                    past.append(decode_frame(base64.b64decode(answer["frame"])))
            except RigdError as error:
                log.debug("no past of %s: %s", stream["name"], error)
        for frame in past:  # in one batch: what waits for another is condensed with what follows
            outbox.frame(frame)
        self._drawing.add(outbox)

    async def _beat(self) -> None:
        while True:
            self._beat_all()
            await asyncio.sleep(BEAT_S)

    async def _keep_description(self) -> None:
        while True:
            if self._description is None and self.alive:
                try:
                    self._description = await self._rig.ask("describe", {})
                    self._tell("describe", self._description)
                    await self._fill_events()
                except RigdError as error:
                    log.warning("the rig does not describe itself: %s", error)
            await asyncio.sleep(RETRY_S)

    async def _fill_events(self) -> None:
        """Take the events that were before the panel, or were lost on the way."""
        since = self._events[-1]["seq"] + 1 if self._events else 0
        try:
            answer = await self._rig.ask("events", {"seq": since})
        except RigdError as error:
            log.warning("events may be missing: %s", error)
            return
        for event in answer["events"][-KEPT_EVENTS:]:
            self._take_event(event)

    async def _keep_latest(self) -> None:
        """Ask for the newest values while nothing plays and somebody looks."""
        while True:
            await asyncio.sleep(LATEST_EVERY_S)
            if not self._outboxes or not self.alive:
                continue
            if monotonic() - self._frame_s < LATEST_EVERY_S:
                continue
            try:
                self._latest = await self._rig.ask("latest", {})
            except RigdError as error:
                log.debug("no latest values: %s", error)
                continue
            self._tell("latest", self._latest)

    def _take_event(self, event: Object) -> None:
        if self._events and event["seq"] <= self._events[-1]["seq"]:
            return
        event = complete_event(event)
        self._events.append(event)
        for outbox in self._outboxes:
            outbox.event(event)

    def _tell(self, kind: str, told: Object) -> None:
        for outbox in self._outboxes:
            outbox.tell(kind, told)

    def _beat_all(self) -> None:
        for outbox in self._outboxes:
            self._beat_to(outbox)

    def _beat_to(self, outbox: Outbox) -> None:
        silent_s = None if self._status is None else monotonic() - self._heard_s
        outbox.tell("panel", {"alive": self.alive, "silent_s": silent_s})
