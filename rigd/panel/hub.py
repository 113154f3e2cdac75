"""Follows the rig over one connection to the daemon and passes the messages to all browsers."""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from time import monotonic
from typing import Final

from rigd.model.errors import RigdError
from rigd.panel.messages import (
    LiveDescription,
    LiveLatest,
    LiveLink,
    LiveState,
    LiveStatus,
    PageDescription,
    PageEvent,
    PageStatus,
    RigLink,
)
from rigd.panel.outbox import Outbox, joined
from rigd.panel.rig import Rig
from rigd.remote.client.watching import all_events
from rigd.remote.protocol import (
    ClientUser,
    Frame,
    Kind,
    Refusal,
    RigEvent,
    decode_frame,
    encode_frame,
)
from rigd.remote.protocol.results import Description, Events, History, LatestValues

log = logging.getLogger(__name__)

#: If the rig sends no status for this time, it is shown as lost; it sends a status every 0.5 s.
SILENCE_S: Final = 2.0
#: Period of the panel's own message to each browser.
BEAT_S: Final = 0.5
#: Period of requests for the newest values while no frames arrive, in s.
LATEST_EVERY_S: Final = 1.0
#: Period of the check for a missing description, in s.
RETRY_S: Final = 0.25
#: Events kept for a browser that joins late.
KEPT_EVENTS: Final = 300
#: Frames are kept in full for this time, in s, and up to so many bytes.
KEPT_S: Final = 30.0
KEPT_BYTES: Final = 32 * 1024 * 1024


class Hub:
    """Follows the rig, and passes its messages to every browser that has joined."""

    def __init__(self, rig: Rig) -> None:
        self._rig = rig
        self._outboxes: set[Outbox] = set()
        self._drawing: set[Outbox] = (
            set()
        )  # browsers that have received the past, and now get frames
        self._status: PageStatus | None = None
        self._process: tuple[int, int] | None = None  # pid and start of the daemon
        self._description: PageDescription | None = None
        self._described = False  # whether no event has come since that changes the description
        self._latest: LatestValues | None = None
        self._events: deque[PageEvent] = deque(maxlen=KEPT_EVENTS)
        self._kept: deque[tuple[float, bytes]] = deque()  # when it came, and a frame
        self._kept_bytes = 0
        self._status_s = -SILENCE_S
        self._frame_s = -LATEST_EVERY_S

    @property
    def alive(self) -> bool:
        """Whether a status arrived within :data:`SILENCE_S`."""
        return monotonic() - self._status_s < SILENCE_S

    @property
    def lease_holder(self) -> ClientUser | None:
        """The holder of the lease in the newest status; None if there is no holder."""
        return None if self._status is None else self._status.lease.holder

    @contextmanager
    def join(self) -> Iterator[Outbox]:
        """Return an outbox for a browser, filled with the newest state and the past events."""
        outbox = Outbox()
        self._beat_to(outbox)
        if self._description is not None:
            outbox.put(LiveDescription(describe=self._description))
        if self._status is not None:
            outbox.put(LiveStatus(status=self._status))
        if self._latest is not None:
            outbox.put(LiveLatest(latest=self._latest))
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
            self._status_s = monotonic()
            process = status.daemon.pid, status.daemon.started_ns
            if process != self._process and self._process is not None:
                # Another daemon: its rig file may differ, and the numbers of its events start
                # again.
                self._description = None
                self._events.clear()
            self._process = process
            self._status = PageStatus.of(status)
            if not was_alive:
                self._beat_all()
            self._put(LiveStatus(status=self._status))

    async def _follow_events(self) -> None:
        async for event in self._rig.events():
            if self._events and event.seq > self._events[-1].seq + 1:
                await self._fill_events()  # some events were lost on the way
            self._take_event(event)

    async def _follow_frames(self) -> None:
        async for data in self._rig.frames():
            self._frame_s = monotonic()
            self._keep(data)
            if not self._drawing:
                continue
            try:
                frame = decode_frame(data)
            except Refusal as error:
                log.warning("a live frame was left out: %s", error)
                continue
            for outbox in self._drawing:
                outbox.frame(frame)

    def _keep(self, data: bytes) -> None:
        """Keep a frame, and only the newest of all."""
        self._kept.append((self._frame_s, data))
        self._kept_bytes += len(data)
        while self._kept_bytes > KEPT_BYTES or self._kept[0][0] < self._frame_s - KEPT_S:
            self._kept_bytes -= len(self._kept.popleft()[1])

    def past(self, start_s: float, end_s: float, most: int) -> bytes:
        """Return the kept frames between two times in s since the Unix epoch, joined by stream.

        Each stream has at most ``most`` points. May be called from any thread.
        """
        found: dict[int, list[Frame]] = {}
        for _, data in self._kept.copy():
            with suppress(Refusal):
                frame = decode_frame(data)
                t_s = frame.t0_ns * 1e-9 + frame.time_s
                inside = (t_s >= start_s) & (t_s <= end_s)
                if not inside.any():
                    continue
                before = found.setdefault(frame.stream, [])
                if before and before[0].low.shape[0] != frame.low.shape[0]:
                    before.clear()  # another run has begun
                before.append(
                    replace(
                        frame, time_s=frame.time_s[inside],
                        low=frame.low[:, inside], high=frame.high[:, inside],
                    )
                )  # fmt: skip
        return b"".join(encode_frame(joined(frames, most)) for frames in found.values())

    async def _bring_past(self, outbox: Outbox) -> None:
        """Send a browser the last seconds of every stream, then frames."""
        streams = () if self._description is None else self._description.streams
        past: list[Frame] = []
        for stream in streams if self.alive else ():
            try:
                args = {"stream": stream.name}
                history = await self._rig.request(Kind.ASK, "history", args, History)
                if history.frame is not None:
                    past.append(decode_frame(history.frame))
            except RigdError as error:
                log.debug("the past of %s is missing: %s", stream.name, error)
        for frame in past:  # in one batch: otherwise it would be merged with the frames that follow
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
                    self._described = True
                    found = await self._rig.request(Kind.ASK, "describe", {}, Description)
                    if not self._described:
                        continue  # the streams have changed since it was asked
                    self._description = PageDescription.of(found)
                    self._put(LiveDescription(describe=self._description))
                    await self._fill_events()
                except RigdError as error:
                    log.warning("no description of the rig: %s", error)
            await asyncio.sleep(RETRY_S)

    async def _fill_events(self) -> None:
        """Fetch events from before the start of the panel, and events lost on the way."""
        since = self._events[-1].seq + 1 if self._events else 0
        try:
            answer = await all_events(
                lambda seq: self._rig.request(Kind.ASK, "events", {"seq": seq}, Events), since
            )
        except RigdError as error:
            log.warning("events may be missing: %s", error)
            return
        for event in answer.events[-KEPT_EVENTS:]:
            self._take_event(event)

    async def _keep_latest(self) -> None:
        """Fetch the latest values while no frames arrive and a page is open."""
        while True:
            await asyncio.sleep(LATEST_EVERY_S)
            if not self._outboxes or not self.alive:
                continue
            if monotonic() - self._frame_s < LATEST_EVERY_S:
                continue
            try:
                self._latest = await self._rig.request(Kind.ASK, "latest", {}, LatestValues)
            except RigdError as error:
                log.debug("no latest values: %s", error)
                continue
            self._put(LiveLatest(latest=self._latest))

    def _take_event(self, event: RigEvent) -> None:
        if self._events and event.seq <= self._events[-1].seq:
            return
        if event.kind == "streams":  # this run has others than the run before
            self._description, self._described = None, False
        shown = PageEvent.of(event)
        self._events.append(shown)
        for outbox in self._outboxes:
            outbox.event(shown)

    def _put(self, message: LiveState) -> None:
        for outbox in self._outboxes:
            outbox.put(message)

    def _beat_all(self) -> None:
        for outbox in self._outboxes:
            self._beat_to(outbox)

    def _beat_to(self, outbox: Outbox) -> None:
        silent_s = None if self._status is None else monotonic() - self._status_s
        outbox.put(LiveLink(panel=RigLink(alive=self.alive, silent_s=silent_s)))
