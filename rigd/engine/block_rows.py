"""Checks the rows that a block device returns in blocks, and records them in bulk."""

from __future__ import annotations

from collections import deque
from typing import Any, Final, Protocol

import numpy as np

from rigd.engine.sink import Rows
from rigd.engine.windows import Windows
from rigd.model.channels import STATUS_FIELD, Stream
from rigd.model.errors import DeviceError
from rigd.model.rows import TIME_FIELD, row_dtype
from rigd.sdk import Block

#: A cycle that decides nothing for so long does not run: no window opens until it does.
PATIENCE_NS: Final = 1_000_000_000
_VALUES: Final = "values"


class BlockSink(Protocol):
    """Where the recorded rows of one block device go; a ring between processes is one."""

    def push_block(self, rows: Rows) -> None:
        """Append rows of the stream's row dtype, shape (n,)."""
        ...


class BlockQueue:
    """Rows of ``stream`` that come in blocks, within one process: it takes the room it needs."""

    overruns = 0  #: for those who count them of every ring

    def __init__(self, stream: Stream) -> None:
        self._empty: Rows = np.empty(0, row_dtype(stream))
        self._blocks: list[Rows] = []

    def push_block(self, rows: Rows) -> None:
        """Append rows of the stream's row dtype, shape (n,); they must not change any more."""
        self._blocks.append(rows)

    def drain(self) -> Rows:
        """Return all rows pushed since the last drain, shape (n,)."""
        blocks, self._blocks = self._blocks, []
        return np.concatenate(blocks) if blocks else self._empty


class BlockRows:
    """Makes rows of ``stream`` from blocks; ``offset_ns`` takes the driver's times to Unix time."""

    def __init__(self, stream: Stream, offset_ns: int = 0) -> None:
        self._stream = stream
        self._offset_ns = offset_ns
        self._width = len(stream.channels) + stream.has_status
        self._layout = _layout(stream)
        self._dtype = row_dtype(stream)
        self._last_ns = -1  # of the row before; virtual time may begin at 0

    def make(self, block: Block) -> Rows:
        """Return the rows of ``block``, shape (n,).

        Raises:
            DeviceError: they are not as the driver has to give them.
        """
        times_ns, values = block.times_ns, block.values
        if values.shape != (len(times_ns), self._width):
            raise DeviceError(
                f"the driver gave values of shape {values.shape} for {len(times_ns)} times, "
                f"expected ({len(times_ns)}, {self._width})",
                hint="correct its read_block()",
            )
        rows = np.empty(len(times_ns), self._layout)
        if len(times_ns):
            if times_ns[0] <= self._last_ns or np.any(np.diff(times_ns) <= 0):
                raise DeviceError(
                    "the driver gave times that do not increase", hint="correct its read_block()"
                )
            self._last_ns = int(times_ns[-1])
            rows[TIME_FIELD] = times_ns + self._offset_ns
            rows[_VALUES] = values[:, : len(self._stream.channels)]
            if self._stream.has_status:
                rows[STATUS_FIELD] = values[:, -1].astype(np.uint32)
        return rows.view(self._dtype)


class BlockRecorder:
    """Records every ``every``-th row, of those inside ``windows`` (None: of all) once decided."""

    def __init__(self, sink: BlockSink, every: int, windows: Windows | None) -> None:
        self._sink = sink
        self._every = every
        self._skip = 0  # rows until the next one that is recorded
        self._windows = windows
        self._waiting: deque[Rows] = deque()  # rows that the cycle has not decided about yet

    def take(self, rows: Rows) -> None:
        """Take the next rows of the device.

        Raises:
            DeviceError: they come too late, see :meth:`Windows.covers`.
        """
        recorded = rows[self._skip :: self._every]
        self._skip = (self._skip - len(rows)) % self._every
        if self._windows is None:
            self._sink.push_block(recorded)
        elif len(recorded):
            self._waiting.append(recorded)
            self.settle()

    def settle(self) -> None:
        """Record or drop the rows that the cycle has decided about meanwhile."""
        if self._windows is not None and self._waiting:
            newest_ns = int(self._waiting[-1][TIME_FIELD][-1])
            self._settle(self._windows, max(self._windows.decided_ns, newest_ns - PATIENCE_NS))

    def finish(self) -> None:
        """Record or drop what still waits, by what is decided so far: no more will be."""
        if self._windows is not None and self._waiting:
            self._settle(self._windows, int(self._waiting[-1][TIME_FIELD][-1]))

    def _settle(self, windows: Windows, until_ns: int) -> None:
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
