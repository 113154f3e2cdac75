"""Collects the rows of a stream in an open chunk until that chunk is sealed (changes no more).

Only the data decide when a chunk is sealed, never the clock or a flush, so that the same rows
always make the same file.
"""

from __future__ import annotations

from typing import Final, Protocol

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

from rigd.model import RecordingError, Stream
from rigd.model.rows import row_dtype
from rigd.record.events.event import CDR_HEADER, message_record
from rigd.record.mcap.chunks import LOG_TIME_AT, MessageBlock, Times, blob_dtype, message_dtype
from rigd.record.mcap.wire import FRAME

#: A chunk is sealed when it spans this long ...
SPAN_NS: Final = 1_000_000_000
#: ... and holds this much: otherwise a slow stream would consist mostly of headers. Rewriting
#: 32 KiB at each flush costs 10 µs.
MIN_BYTES: Final = 32 * 1024
#: Events are few but state which trial a sample belongs to: damage in the middle of a file must
#: not destroy the events before it.
EVENTS_SPAN_NS: Final = 10_000_000_000
#: Sealed at this size in any case: the chunk size of the MCAP library, which Foxglove recommends.
MAX_BYTES: Final = 1024 * 1024
#: Latest time that a row's int64 holds; seen as unsigned, later ones are negative.
MAX_NS: Final = 2**63 - 1


class OpenChunk(Protocol):
    """The messages of one channel that are not sealed yet."""

    @property
    def count(self) -> int:
        """Number of messages held."""
        ...

    def block(self) -> MessageBlock:
        """Return the stored rows as a block, valid until more rows are added."""
        ...

    def clear(self) -> None:
        """Begin again, and continue the numbers; the last block is valid until rows are added."""
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
        self._capacity = max(MAX_BYTES // dtype.itemsize, 1)
        self._least = min(-(-MIN_BYTES // dtype.itemsize), self._capacity)
        self._first_ns = 0  #: time of the first row held
        records = np.zeros(self._capacity, dtype)
        records["opcode"] = Opcode.MESSAGE
        records["length"] = dtype.itemsize - FRAME.size
        records["channel"] = channel
        records["sequence"] = np.arange(sequence, sequence + self._capacity) & 0xFFFFFFFF
        records["cdr"] = np.frombuffer(CDR_HEADER, "<u4")[0]
        self._itemsize = dtype.itemsize
        self._bytes = records.data.cast("B")
        self._sequence = records["sequence"]
        self._sealed = 0  #: rows sealed since the sequence was brought up to date
        # Log and publish time as two columns, which each call fills at once.
        self._times = np.ndarray(
            (self._capacity, 2), np.uint64, records, LOG_TIME_AT, (dtype.itemsize, 8)
        )
        self._values = records["values"]
        self._offsets: Times = np.arange(self._capacity, dtype=np.uint64) * dtype.itemsize

    @property
    def full(self) -> bool:
        """Whether the chunk takes no further row."""
        return self.count == self._capacity

    def accepts(self, rows: NDArray[np.void]) -> bool:
        """Return whether ``rows`` have the layout of the stream."""
        return rows.dtype is self._dtype or rows.dtype == self._dtype

    def fill(self, rows: NDArray[np.void]) -> int:
        """Copy rows up to where the chunk must be sealed; return their number.

        ``rows`` have the stream's row dtype, not empty. Called for every few rows of a run: each
        numpy call counts.

        Raises:
            RecordingError: the first time is before 1970.
        """
        block = rows.view(self._blob)
        start = self.count
        if len(block) > self._capacity - start:
            block = block[: self._capacity - start]
        times = block["t_ns"]
        first_ns: int = times.item(0)
        if first_ns > MAX_NS:
            raise before_1970(first_ns - (1 << 64), self.stream.name)
        if not start:
            self._first_ns = first_ns
            self._sequence += np.uint32(self._sealed)
            self._sealed = 0
        if not 0 <= times.item(-1) - self._first_ns < SPAN_NS:
            block = block[: self._fitting(times)]
            times = block["t_ns"]
        end = start + len(block)
        self._times[start:end] = times[:, None]
        self._values[start:end] = block["values"]
        self.count = end
        return len(block)

    def block(self) -> MessageBlock:
        """Return the stored rows as a block, valid until more rows are added."""
        count = self.count
        return MessageBlock(
            self.channel,
            self._bytes[: count * self._itemsize],
            self._times[:count, 0],
            self._offsets[:count],
        )

    def clear(self) -> None:
        """Begin again, and continue the numbers; the last block is valid until rows are added."""
        self._sealed += self.count
        self.count = 0

    def _fitting(self, times: Times) -> int:
        """Return how many of these rows still belong to the chunk, by the limit of its span.

        Unsigned: a clock that steps back makes a huge span, and so seals as well.
        """
        needed = max(self._least - self.count, 0)
        late = np.flatnonzero(times[needed:] - np.uint64(self._first_ns) >= SPAN_NS)
        return needed + int(late[0]) if late.size else len(times)


class OpenMessages:
    """Open chunk of messages of any size, sealed by their size, or by a span of time in ns."""

    def __init__(self, channel: int, sequence: int, span_ns: int = MAX_NS) -> None:
        """Begin with message number ``sequence``."""
        self.channel = channel
        self._sequence = sequence
        self._span_ns = span_ns
        self._records = bytearray()
        self._times: list[int] = []
        self._offsets: list[int] = []

    @property
    def count(self) -> int:
        """Number of messages held."""
        return len(self._times)

    @property
    def full(self) -> bool:
        """Whether the chunk takes no further message."""
        if len(self._records) >= MIN_BYTES:
            return True
        return bool(self._times) and abs(self._times[-1] - self._times[0]) >= self._span_ns

    def add(self, t_ns: int, payload: bytes) -> None:
        """Add a message of time ``t_ns``."""
        self._times.append(t_ns)
        self._offsets.append(len(self._records))
        self._records += message_record(t_ns, payload, self.channel, self._sequence)
        self._sequence += 1

    def block(self) -> MessageBlock:
        """Return the stored messages as a block, valid until more are added."""
        times, offsets = np.array(self._times, np.uint64), np.array(self._offsets, np.uint64)
        return MessageBlock(self.channel, memoryview(bytes(self._records)), times, offsets)

    def clear(self) -> None:
        """Begin again, and continue the numbers; the last block is a copy, and so stays valid."""
        self._records.clear()
        self._times.clear()
        self._offsets.clear()


def before_1970(t_ns: int, stream: str) -> RecordingError:
    """Return the message for the user about a time that MCAP cannot contain."""
    return RecordingError(
        f"a row of {stream!r} has the time {t_ns} ns, before 1970",
        hint="Times are ns since the Unix epoch.",
    )
