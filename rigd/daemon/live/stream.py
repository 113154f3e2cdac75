"""Prepares one stream (channels that are sampled together) of a rig for live plots."""

from __future__ import annotations

from collections import deque
from typing import Final

import numpy as np

from rigd.daemon.live.points import Points
from rigd.engine.shared import RowRing, View
from rigd.engine.sink import Rows
from rigd.model.channels import STALE, STATUS_FIELD, Stream
from rigd.remote.protocol import Frame

#: Points of one frame, at most: every row of a stream of up to 1.8 kHz at 30 frames per second.
FRAME_POINTS: Final = 60
#: A client that connects later gets the points of this time, in s.
HISTORY_NS: Final = 10_000_000_000
#: At most so many points of it: about the width of a plot in pixels.
HISTORY_POINTS: Final = 600
#: At most so many bytes of it, for a stream of very many channels.
_HISTORY_BYTES: Final = 128 * 1024
#: Points of each frame that are kept for it.
_KEPT_POINTS: Final = 2


class LiveStream:
    """Returns the new rows of a stream from its ring, its newest row, and its last ten seconds.

    ``number`` is that of its frames. Rows that repeat earlier values because the device gave none
    (:data:`~rigd.model.channels.STALE`) are not shown: clients see the age of its last value grow.
    """

    def __init__(self, number: int, stream: Stream) -> None:
        self.number = number
        self.stream = stream
        self.frames = 0  #: frames made so far
        self._view: View | None = None
        self._skipped = 0
        self._recent: deque[Points] = deque()

    @property
    def skipped(self) -> int:
        """Rows that were overwritten before they were seen."""
        return self._skipped + (0 if self._view is None else self._view.skipped)

    def attach(self, ring: RowRing | None) -> None:
        """Send the rows that come into ``ring`` from now on; None: no rows come."""
        self._skipped = self.skipped
        self._view = None if ring is None else View(ring)

    def read(self) -> Rows | None:
        """Return the rows that came since the last call, in time order; None if none did."""
        rows = None if self._view is None else self._view.read()
        if rows is None or not len(rows):
            return None
        if self.stream.has_status:
            rows = rows[rows[STATUS_FIELD] & STALE == 0]
        return rows if len(rows) else None

    def frame(self, rows: Rows) -> Frame:
        """Return a frame with ``rows``, and store them for clients that join later."""
        points = Points.of(self.stream, rows).reduced(FRAME_POINTS)
        recent = self._recent
        while recent and recent[-1].times_ns[-1] > points.times_ns[0]:
            recent.pop()  # the clock was set back between two runs
        recent.append(points.reduced(_KEPT_POINTS))
        oldest_ns = int(points.times_ns[-1]) - HISTORY_NS
        while recent[0].times_ns[-1] < oldest_ns:
            recent.popleft()
        self.frames += 1
        return self._frame(points)

    def history(self) -> Frame | None:
        """Return the last ten seconds of the stream as one frame; None if it had no row yet.

        Its sequence is that of the last frame: the next frame follows without a gap.
        """
        if not self._recent:
            return None
        most = min(HISTORY_POINTS, _HISTORY_BYTES // (8 + 8 * len(self.stream.channels)))
        return self._frame(Points.joined(list(self._recent)).reduced(most))

    def newest(self) -> tuple[int, list[float]] | None:
        """Return the time (Unix, ns) and the values of the newest row; None if there is none."""
        if not self._recent:
            return None
        last = self._recent[-1]
        return int(last.times_ns[-1]), last.low[-1].tolist()

    def _frame(self, points: Points) -> Frame:
        t0_ns = int(points.times_ns[0])
        with np.errstate(over="ignore"):  # values beyond 3.4e38 become infinite
            low = points.low.T.astype(np.float32)
            high = low if points.high is points.low else points.high.T.astype(np.float32)
        time_s = (points.times_ns - t0_ns).astype(np.float64) * 1e-9
        return Frame(self.number, self.frames - 1, t0_ns, time_s, low, high)
