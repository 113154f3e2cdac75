"""Stores the messages that wait for a browser: a limited number, of which the newest are kept."""

from __future__ import annotations

import asyncio
import math
from collections import deque
from collections.abc import Callable, Sequence
from time import monotonic
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rigd.panel.messages import LiveEvent, LiveSkipped, LiveState, PageEvent
from rigd.remote.protocol.frame import Frame, encode_frame

#: Most points per stream in a frame for a browser that is behind.
MOST_POINTS: Final = 240
#: Most events that wait for a browser; older events are counted as skipped.
MOST_EVENTS: Final = 500
#: Batches of frames that may be in transit to a browser that has not reported them as drawn.
MOST_UNDER_WAY: Final = 2
#: Least time between two batches, in s: what changes more often is not read, but costs the browser
#: a drawing each time.
BATCH_S: Final = 0.125
#: Points of a stream in each second, until the page has told how many its plots can show.
USUAL_PER_S: Final = 80.0


class Outbox:
    """The messages for one browser.

    Of each kind of text the newest is kept, of events the newest up to a limit, and the frames of a
    stream are merged into one frame, with as many points as the page can show
    (:attr:`points_per_s`): a slow browser gets fewer and coarser frames, without gaps.
    """

    def __init__(self, now: Callable[[], float] = monotonic) -> None:
        self.points_per_s = USUAL_PER_S
        self._now = now
        self._batch_s = -math.inf  # of the last batch
        self._newest: dict[str, str] = {}
        self._events: deque[str] = deque()
        self._skipped = 0
        self._frames: dict[int, Frame] = {}
        self._under_way = 0
        self._wake = asyncio.Event()

    def put(self, message: LiveState) -> None:
        """Add a message; only the newest message of its kind is kept."""
        self._newest[message.kind] = message.model_dump_json()
        self._wake.set()

    def event(self, event: PageEvent) -> None:
        """Add an event at the end."""
        if len(self._events) >= MOST_EVENTS:
            self._events.popleft()
            self._skipped += 1
        self._events.append(LiveEvent(event=event).model_dump_json())
        self._wake.set()

    def frame(self, frame: Frame) -> None:
        """Add a frame; merge it with the waiting frames of its stream."""
        waiting = self._frames.get(frame.stream)
        self._frames[frame.stream] = (
            frame if waiting is None else merge(waiting, frame, MOST_POINTS)
        )
        self._wake.set()

    def drawn(self) -> None:
        """Note that the browser has drawn a batch of frames and can take another batch."""
        self._under_way = max(0, self._under_way - 1)
        self._wake.set()

    async def take(self) -> list[str | bytes]:
        """Wait for something to send, and return everything that may be sent now, in order.

        Frames come as one binary message: one after another, each with its length in its head.
        """
        while not (ready := self._ready()):
            self._wake.clear()
            await self._wake.wait()
        return ready

    def _ready(self) -> list[str | bytes]:
        ready: list[str | bytes] = [*self._newest.values()]
        self._newest.clear()
        if self._skipped:
            ready.append(LiveSkipped(skipped=self._skipped).model_dump_json())
            self._skipped = 0
        ready += self._events
        self._events.clear()
        # The next frame or text wakes this again: nothing has to wait for the end of the time.
        is_due = self._now() - self._batch_s >= BATCH_S
        if self._frames and self._under_way < MOST_UNDER_WAY and is_due:
            self._under_way += 1
            self._batch_s = self._now()
            ready.append(b"".join(map(self._encoded, self._frames.values())))
            self._frames.clear()
        return ready

    def _encoded(self, frame: Frame) -> bytes:
        lasts_s = float(frame.time_s.max() - frame.time_s.min()) if frame.time_s.size else 0.0
        return encode_frame(joined([frame], max(1, math.ceil(self.points_per_s * lasts_s))))


def merge(first: Frame, second: Frame, most: int) -> Frame:
    """Return one frame with the points of both; more than ``most`` are condensed to half of that.

    If the channels differ (another run has begun), only ``second`` is returned.
    """
    if first.low.shape[0] != second.low.shape[0]:
        return second
    if first.time_s.size + second.time_s.size > most:
        most = max(1, most // 2)
    return joined([first, second], most)


def joined(frames: Sequence[Frame], most: int) -> Frame:
    """Return one frame with the points of ``frames`` in their order, at most ``most``.

    Each remaining point represents an equal piece of the time, so that the oldest data, which are
    merged most often, are no coarser than the newest. Minimum and maximum are kept; a point keeps
    the time of the first point that it represents. All frames have the same channels.
    """
    first, last = frames[0], frames[-1]
    time_s = np.concatenate([item.time_s + (item.t0_ns - first.t0_ns) * 1e-9 for item in frames])
    low = np.concatenate([item.low for item in frames], axis=1)
    high = np.concatenate([item.high for item in frames], axis=1)
    if time_s.size > most:
        starts = _pieces(time_s, most)
        time_s = time_s[starts]
        low = np.fmin.reduceat(low, starts, axis=1)
        high = np.fmax.reduceat(high, starts, axis=1)
    return Frame(first.stream, last.sequence, first.t0_ns, time_s, low, high)


def _pieces(time_s: NDArray[np.float64], count: int) -> NDArray[np.intp]:
    """Return the indices at which at most ``count`` equal pieces of the time begin."""
    first_s = time_s.min()
    width_s = (time_s.max() - first_s) / count
    if width_s == 0.0:
        return np.zeros(1, dtype=np.intp)
    piece = np.minimum((time_s - first_s) // width_s, count - 1)
    # A clock that was set back does not begin a piece again.
    return np.flatnonzero(np.diff(np.maximum.accumulate(piece), prepend=-1.0))
