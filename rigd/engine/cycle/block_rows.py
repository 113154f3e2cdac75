"""Checks and records the rows of a device whose library returns rows in blocks (a block device)."""

from __future__ import annotations

from collections import deque
from typing import Any, Final, Protocol

import numpy as np

from rigd.engine.play.windows import Windows
from rigd.engine.sink import Rows
from rigd.model.channels import STATUS_FIELD, Stream
from rigd.model.errors import DeviceError
from rigd.model.rows import TIME_FIELD, row_dtype
from rigd.sdk import Block

#: A cycle that decides nothing for this time does not run: no window opens until it runs.
PATIENCE_NS: Final = 1_000_000_000
_VALUES: Final = "values"


class BlockSink(Protocol):
    """Receives the recorded rows of a block device; a ring between processes is such a sink."""

    def push_block(self, rows: Rows) -> None:
        """Append rows of the stream's row dtype, shape (n,)."""
        ...


class BlockQueue:
    """Queues rows of ``stream`` that arrive in blocks within one process; has no size limit."""

    overruns = 0  #: every ring has this counter

    def __init__(self, stream: Stream) -> None:
        self._empty: Rows = np.empty(0, row_dtype(stream))
        self._blocks: list[Rows] = []

    def push_block(self, rows: Rows) -> None:
        """Append rows of the stream's row dtype, shape (n,); the caller keeps them unchanged."""
        self._blocks.append(rows)

    def drain(self) -> Rows:
        """Return all rows pushed since the last drain, shape (n,)."""
        blocks, self._blocks = self._blocks, []
        return np.concatenate(blocks) if blocks else self._empty


class BlockRows:
    """Converts blocks to rows of ``stream``; adds ``offset_ns`` to the times to get Unix time."""

    def __init__(self, stream: Stream, offset_ns: int = 0) -> None:
        self._stream = stream
        self._offset_ns = offset_ns
        self._width = len(stream.channels) + stream.has_status
        self._layout = _layout(stream)
        self._dtype = row_dtype(stream)
        self._last_ns = -1  # time of the previous row; virtual time may begin at 0

    def make(self, block: Block) -> Rows:
        """Return the rows of ``block``, shape (n,).

        Raises:
            DeviceError: the block violates the interface of drivers.
        """
        times_ns, values = block.times_ns, block.values
        if values.shape != (len(times_ns), self._width):
            raise DeviceError(
                f"the driver returned values of shape {values.shape} for {len(times_ns)} "
                f"times, expected ({len(times_ns)}, {self._width})",
                hint="correct its read_block()",
            )
        rows = np.empty(len(times_ns), self._layout)
        if len(times_ns):
            if times_ns[0] <= self._last_ns or np.any(np.diff(times_ns) <= 0):
                raise DeviceError(
                    "the driver returned times that do not increase",
                    hint="correct its read_block()",
                )
            self._last_ns = int(times_ns[-1])
            rows[TIME_FIELD] = times_ns + self._offset_ns
            rows[_VALUES] = values[:, : len(self._stream.channels)]
            if self._stream.has_status:
                rows[STATUS_FIELD] = values[:, -1].astype(np.uint32)
        return rows.view(self._dtype)


class BlockRecorder:
    """Records every ``every``-th row, of those inside ``windows`` (None: of all), once decided."""

    def __init__(self, sink: BlockSink, every: int, windows: Windows | None) -> None:
        self._sink = sink
        self._every = every
        self._skip = 0  # rows until the next recorded row
        self._windows = windows
        self._waiting: deque[Rows] = deque()  # rows about which the cycle has not decided yet

    def take(self, rows: Rows) -> None:
        """Take the next rows of the device.

        Raises:
            DeviceError: the rows arrive too late, see :meth:`Windows.covers`.
        """
        recorded = rows[self._skip :: self._every]
        self._skip = (self._skip - len(rows)) % self._every
        if self._windows is None:
            self._sink.push_block(recorded)
            return
        if len(recorded):
            self._waiting.append(recorded)
        self.settle()

    @property
    def waits(self) -> bool:
        """Whether there are rows about which the cycle has not decided yet."""
        return bool(self._waiting)

    def settle(self) -> None:
        """Record or drop the rows about which the cycle has decided meanwhile."""
        if self._windows is not None and self._waiting:
            newest_ns = int(self._waiting[-1][TIME_FIELD][-1])
            self._record_until(
                self._windows,
                max(self._windows.decided_ns, newest_ns - PATIENCE_NS - self._windows.lag_ns),
            )

    def finish(self) -> None:
        """Record or drop the rows that still wait, by the last decision of the cycle."""
        if self._windows is not None and self._waiting:
            self._record_until(self._windows, int(self._waiting[-1][TIME_FIELD][-1]))

    def _record_until(self, windows: Windows, until_ns: int) -> None:
        """Of the rows up to ``until_ns``, Unix time, record those in ``windows``, drop the rest."""
        while self._waiting:
            rows = self._waiting.popleft()
            count = int(np.searchsorted(rows[TIME_FIELD], until_ns, side="right"))
            if count < len(rows):
                self._waiting.appendleft(rows[count:])
            inside = windows.covers(rows[TIME_FIELD][:count])
            if inside.any():
                self._sink.push_block(rows[:count][inside])
            if count < len(rows):
                return


def _layout(stream: Stream) -> np.dtype[np.void]:
    """Return the bytes of :func:`~rigd.model.rows.row_dtype` with all channels as one field."""
    fields: list[Any] = [(TIME_FIELD, "<i8"), (_VALUES, "<f8", (len(stream.channels),))]
    if stream.has_status:
        fields.append((STATUS_FIELD, "<u4"))
    return np.dtype(fields)
