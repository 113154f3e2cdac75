"""Open chunks: what a stream has been given since its last sealed chunk.

When a chunk is sealed is decided by the data alone, never by the clock or by a flush, so that
the same rows always make the same file.
"""

from __future__ import annotations

from typing import Final, Protocol

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

from rigd.model import Stream
from rigd.model.rows import row_dtype
from rigd.record.chunks import Block, blob_dtype, message_dtype
from rigd.record.events import CDR_HEADER, Event, event_message
from rigd.record.wire import FRAME

#: A chunk is sealed when it spans this long ...
SPAN_NS: Final = 1_000_000_000
#: ... and holds this much: without it, a slow stream would be all headers. Rewriting 32 KiB at
#: each flush costs 10 µs.
MIN_BYTES: Final = 32 * 1024
#: Events are few but tell which trial a sample belongs to: damage in the middle of a file must
#: not cost those before it.
EVENTS_SPAN_NS: Final = 10_000_000_000
#: Sealed whatever it spans: the chunk size of the MCAP library and Foxglove's advice.
MAX_BYTES: Final = 1024 * 1024


class OpenChunk(Protocol):
    """The messages of one channel that are not sealed yet."""

    @property
    def count(self) -> int:
        """Number of messages held."""
        ...

    def block(self) -> Block:
        """Return a copy of what is held."""
        ...

    def clear(self) -> None:
        """Forget what is held, keep counting the sequence."""
        ...


class OpenRows:
    """Open chunk of a stream: a preallocated array of whole Message records."""

    def __init__(self, stream: Stream, channel: int, sequence: int) -> None:
        """Begin with message number ``sequence``."""
        self.stream = stream
        self.channel = channel
        self.count = 0
        self._dtype = row_dtype(stream)
        self._blob = blob_dtype(stream)
        dtype = message_dtype(self._blob.itemsize - 8)
        capacity = max(MAX_BYTES // dtype.itemsize, 1)
        self._least = min(-(-MIN_BYTES // dtype.itemsize), capacity)
        self._records: NDArray[np.void] = np.zeros(capacity, dtype)
        self._records["opcode"] = Opcode.MESSAGE
        self._records["length"] = dtype.itemsize - FRAME.size
        self._records["channel"] = channel
        self._records["sequence"] = np.arange(sequence, sequence + capacity) & 0xFFFFFFFF
        self._records["cdr"] = np.frombuffer(CDR_HEADER, "<u4")[0]
        # Views of the three columns that each call fills.
        self._log_time = self._records["log_time"]
        self._publish_time = self._records["publish_time"]
        self._values = self._records["values"]

    @property
    def full(self) -> bool:
        """Whether the chunk takes no further row."""
        return self.count == len(self._records)

    def fill(self, rows: NDArray[np.void]) -> int:
        """Copy rows up to where the chunk must be sealed; return how many.

        ``rows`` are of the stream's row dtype, not empty.
        """
        block = rows[: len(self._records) - self.count].view(self._blob)
        times = block["t_ns"]
        first = times[0] if self.count == 0 else self._log_time[0]
        if not 0 <= int(times[-1]) - int(first) < SPAN_NS:
            # Unsigned: a clock that steps back makes a huge span, and so seals as well.
            needed = max(self._least - self.count, 0)
            late = np.flatnonzero(times[needed:] - first >= SPAN_NS)
            if late.size:
                block = block[: needed + int(late[0])]
                times = block["t_ns"]
        end = self.count + len(block)
        self._log_time[self.count : end] = times
        self._publish_time[self.count : end] = times
        self._values[self.count : end] = block["values"]
        self.count = end
        return len(block)

    def block(self) -> Block:
        """Return a copy of what is held."""
        held = self._records[: self.count]
        offsets = np.arange(self.count, dtype=np.uint64) * np.uint64(held.dtype.itemsize)
        return Block(self.channel, held.tobytes(), self._log_time[: self.count].copy(), offsets)

    def clear(self) -> None:
        """Forget what is held, keep counting the sequence."""
        self._records["sequence"] += np.uint32(self.count)
        self.count = 0

    def accepts(self, rows: NDArray[np.void]) -> bool:
        """Return whether ``rows`` have the layout of the stream."""
        return rows.dtype is self._dtype or rows.dtype == self._dtype


class OpenEvents:
    """Open chunk of ``/events``: messages of any size, sealed by span or size."""

    def __init__(self, channel: int, sequence: int, start_ns: int) -> None:
        """Begin with message number ``sequence``; event times count from ``start_ns``."""
        self.channel = channel
        self._sequence = sequence
        self._start_ns = start_ns
        self._records = bytearray()
        self._times: list[int] = []
        self._offsets: list[int] = []

    @property
    def count(self) -> int:
        """Number of events held."""
        return len(self._times)

    @property
    def full(self) -> bool:
        """Whether the chunk takes no further event."""
        if len(self._records) >= MIN_BYTES:
            return True
        return bool(self._times) and abs(self._times[-1] - self._times[0]) >= EVENTS_SPAN_NS

    def add(self, event: Event) -> None:
        """Take one event.

        Raises:
            TypeError: its data holds something that JSON has no form for.

        """
        message = event_message(event, self.channel, self._sequence, self._start_ns)
        self._times.append(event.t_ns)
        self._offsets.append(len(self._records))
        self._records += message
        self._sequence += 1

    def block(self) -> Block:
        """Return a copy of what is held."""
        times, offsets = np.array(self._times, np.uint64), np.array(self._offsets, np.uint64)
        return Block(self.channel, bytes(self._records), times, offsets)

    def clear(self) -> None:
        """Forget what is held, keep counting the sequence."""
        self._records.clear()
        self._times.clear()
        self._offsets.clear()
