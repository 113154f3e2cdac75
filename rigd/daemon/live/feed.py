"""Passes rows and events of a rig to its clients while a run plays.

A thread of the daemon reads the rings (buffers of rows) of the current run. The thread releases no
rows, delays no other process, and skips rows if it is too slow. The cycle process does not depend
on this thread.
"""

from __future__ import annotations

import itertools
import logging
import math
import threading
import time
from base64 import b64encode
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, Final, Protocol, Self

from rigd.config.rig import RigConfig
from rigd.daemon.live.eventlog import EventLog
from rigd.daemon.live.stream import LiveStream
from rigd.engine.cycle.wiring import streams_of
from rigd.engine.shared import EVENT_SOURCES, EventView, RunFolder, Word
from rigd.engine.sink import Rows
from rigd.model.channels import Stream
from rigd.record.events.event import NO_TRIAL
from rigd.record.events.event import Event as RecordedEvent
from rigd.remote.protocol import Code, Refusal, RigEvent, encode_frame
from rigd.remote.protocol.limits import LIVE_HZ
from rigd.remote.protocol.results import History, LatestReply, LatestValues

_LOG: Final = logging.getLogger(__name__)
#: If rows cannot be shown, the error is logged once in so many seconds.
QUIET_S: Final = 10.0


class Outlet(Protocol):
    """Receives frames and events, never waits long (:class:`rigd.remote.server.RigPublisher`)."""

    def frame(self, stream: str, payload: bytes, /) -> None:
        """Take a frame of ``stream``, encoded."""
        ...

    def event(self, event: RigEvent, /) -> None:
        """Take an event."""
        ...


class Feed:
    """The live data and the events of one rig.

    Call :meth:`start` once, then :meth:`attach` for each run, and :meth:`detach` when that has
    ended. Every method may be called from any thread.

    Args:
        rig: the rig; its streams are numbered in the order of its file, that of the cycle last.
        outlet: gets a frame of each stream that has new rows, 30 times a second, and every event.
        raw: gets the rows themselves, as the ring stores them (``t_ns`` Unix); must not wait long.
        happened: gets every event of a run, likewise.

    A run may have streams that the rig does not have (derived channels of its procedure). They stay
    until other streams are shown; each gets a number that no stream had before.
    """

    def __init__(
        self,
        rig: RigConfig,
        outlet: Outlet,
        *,
        raw: Callable[[Stream, Rows], None] = lambda _, __: None,
        happened: Callable[[RecordedEvent], None] = lambda _: None,
    ) -> None:
        self._streams = {
            stream.name: LiveStream(number, stream) for number, stream in enumerate(streams_of(rig))
        }
        self._of_rig = frozenset(self._streams)
        self._numbers = itertools.cycle(range(len(self._streams), 2**16))  # a frame has 16 bits
        self._outlet, self._raw, self._happened = outlet, raw, happened
        self._log = EventLog()
        self._views: list[EventView] = []
        #: Unix time less monotonic time, on the clock of the run shown last.
        self._offset_ns = time.time_ns() - time.monotonic_ns()
        self._quiet_until = 0.0  #: monotonic, s
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._work, name="live", daemon=True)

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    @property
    def t_ns(self) -> int:
        """Unix time now, in ns, on the clock of the rows."""
        return self._offset_ns + time.monotonic_ns()

    @property
    def skipped(self) -> int:
        """Rows that were overwritten before they could be shown."""
        with self._lock:
            return sum(stream.skipped for stream in self._streams.values())

    @property
    def of_run(self) -> Sequence[LiveStream]:
        """The streams that the rig has only in the present or the last run."""
        with self._lock:
            return [live for name, live in self._streams.items() if name not in self._of_rig]

    def start(self) -> None:
        """Begin to show; once."""
        self._thread.start()

    def stop(self) -> None:
        """Stop sending; stopping twice is silent."""
        self._stop.set()
        if self._thread.ident is not None:
            self._thread.join()

    def attach(self, folder: RunFolder, *, events: bool = True) -> None:
        """Show the run in ``folder``, from its next rows on; ``events`` False leaves those out.

        Events are shown from the beginning, as far as the rings still have them.

        Raises:
            RecordingError: the folder holds no run.
        """
        job = folder.job
        board, rings = folder.board(), folder.row_rings(job)
        views = [EventView(folder.event_ring(source)) for source in EVENT_SOURCES if events]
        with self._lock:
            self._offset_ns = board[Word.START_NS] - board[Word.ORIGIN_NS]
            self._views = views
            self._know(job.streams)
            for name, live in self._streams.items():
                live.attach(rings.get(name))

    def detach(self) -> None:
        """Send the remaining rows of the rings, and release them; silent if there are none.

        The rings may be removed from their folder already: the mapped memory stays valid.
        """
        with self._lock:
            self._show()
            self._views = []
            for live in self._streams.values():
                live.attach(None)

    def _know(self, streams: Sequence[Stream]) -> None:
        """Take the streams of a run that the rig does not have in place of those before."""
        added = [stream for stream in streams if stream.name not in self._of_rig]
        before = {name: live for name, live in self._streams.items() if name not in self._of_rig}
        if added == [live.stream for live in before.values()]:
            return
        for name in before:
            del self._streams[name]
        for stream in added:
            self._streams[stream.name] = LiveStream(next(self._numbers), stream)
        data = {"added": [stream.name for stream in added]}
        event = self._log.add(RecordedEvent(self.t_ns, "streams", NO_TRIAL, data))
        self._guarded(partial(self._outlet.event, event))

    def publish(self, kind: str, data: Mapping[str, Any]) -> None:
        """Add an event of the daemon's own, which is in no recording.

        Raises:
            TypeError: the data has no form in JSON.
        """
        with self._lock:
            event = self._log.add(RecordedEvent(self.t_ns, kind, NO_TRIAL, data))
            self._guarded(partial(self._outlet.event, event))

    def events(self, number: int) -> tuple[Sequence[RigEvent], int]:
        """Return events from ``number`` on, and the number of the next request.

        The newest 1000 are stored; an answer may contain fewer than are available.
        """
        with self._lock:
            found = self._log.since(number)
            return found, found[-1].seq + 1 if found else self._log.next

    def latest(self) -> LatestValues:
        """Return the newest value of every channel that has had a value, with its age."""
        with self._lock:
            now_ns, values = self.t_ns, dict[str, LatestReply]()
            for name, live in self._streams.items():
                newest = live.newest()
                if newest is None:
                    continue
                age_s = max(now_ns - newest[0], 0) * 1e-9
                for channel, value in zip(live.stream.channels, newest[1], strict=True):
                    finite = value if math.isfinite(value) else None
                    values[f"{name}.{channel.name}"] = LatestReply(value=finite, age_s=age_s)
        return LatestValues(t_ns=now_ns, values=values)

    def history(self, stream: str) -> History:
        """Return the last ten seconds of ``stream``, in at most 600 points.

        Raises:
            Refusal: the rig has no such stream.
        """
        live = self._streams.get(stream)
        if live is None:
            raise Refusal(
                Code.NOT_FOUND,
                f"there is no stream {stream!r}",
                hint=f"known: {', '.join(self._streams)}",
            )
        with self._lock:
            frame = live.history()
        return History(frame=None if frame is None else b64encode(encode_frame(frame)))

    def tick(self) -> None:
        """Send the rows since the last call; the thread does so 30 times a second."""
        with self._lock:
            self._show()

    def _show(self) -> None:
        self._guarded(self._show_events)
        for live in self._streams.values():
            self._guarded(partial(self._show_rows, live))

    def _guarded(self, show: Callable[[], None]) -> None:
        """Call ``show``; if it fails, log the error and continue with the other streams.

        A viewer must never end a run, and a failing stream must not hide the others.
        """
        try:
            show()
        except Exception:  # noqa: BLE001 - the boundary of the task
            now = time.monotonic()
            if now > self._quiet_until:
                _LOG.exception("live data could not be shown; the next attempt follows")
                self._quiet_until = now + QUIET_S

    def _show_events(self) -> None:
        events = [event for view in self._views for event in view.read()]
        events.sort(key=lambda item: item.t_ns)
        # All are numbered before any is published: a client that misses one can ask for it.
        for event in [self._log.add(item) for item in events]:
            self._outlet.event(event)
        for recorded in events:
            self._happened(recorded)

    def _show_rows(self, live: LiveStream) -> None:
        rows = live.read()
        if rows is not None:
            self._outlet.frame(live.stream.name, encode_frame(live.frame(rows)))
            self._raw(live.stream, rows)

    def _work(self) -> None:
        due = time.monotonic()
        while not self._stop.is_set():
            self.tick()
            # At fixed times; a time that has passed is left out.
            due = max(due + 1.0 / LIVE_HZ, time.monotonic())
            self._stop.wait(due - time.monotonic())
