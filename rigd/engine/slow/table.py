"""Stores data that the cycle and off-cycle devices share in a mapped file.

An off-cycle device runs outside the control cycle. The process that runs the device writes the
newest row for the cycle. The cycle writes at which times the rows of the device are recorded.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import Final, Self

from rigd.engine.play.windows import Windows
from rigd.engine.shared.mapping import SharedFile
from rigd.model.channels import Stream

_MAGIC: Final = b"rigdlat2"
_SEQUENCE, _TIME, _BEAT, _VALUES = 0, 1, 2, 3  #: words of a slot
_LINE_WORDS: Final = 8  #: a cache line; two writers never share a line
#: A writer is between its two marks only for a microsecond, unless it was killed there.
_TRIES: Final = 4


class Slot:
    """Stores the newest row of one device: one process writes it, any process reads it.

    A sequence lock: the sequence number is odd while the row is being written; if a reader finds it
    odd or changed, it has read an invalid row. See :mod:`rigd.engine.shared.mapping` for the order
    of stores.
    """

    def __init__(self, memory: memoryview, width: int) -> None:
        """Use :meth:`LatestTable.slot`."""
        self.width = width
        self._words = memory.cast("Q")
        self._values = memory[8 * _VALUES :].cast("d")[:width]

    @property
    def sequence(self) -> int:
        """Changes with every row; 0 before the first row."""
        return self._words[_SEQUENCE]

    def write(self, t_ns: int, row: Sequence[float]) -> None:
        """Make ``row``, taken at ``t_ns`` (monotonic), the newest row.

        Raises:
            ValueError: the number of values differs from that of the device's channels.
        """
        if len(row) != self.width:
            raise ValueError(f"the row has {len(row)} values, expected {self.width}")
        writing = self._words[_SEQUENCE] | 1  # odd already if a former writer was killed
        self._words[_SEQUENCE] = writing
        self._words[_TIME] = t_ns
        for index, value in enumerate(row):
            self._values[index] = value
        self._words[_SEQUENCE] = writing + 1

    def read(self) -> tuple[int, list[float]] | None:
        """Return monotonic time in ns and values of the newest row; None if there is none.

        Also None if its writer was killed while writing it.
        """
        for _ in range(_TRIES):
            sequence = self._words[_SEQUENCE]
            if not sequence:
                return None
            t_ns, row = self._words[_TIME], list(self._values)
            if not sequence & 1 and self._words[_SEQUENCE] == sequence:
                return t_ns, row
        return None

    @property
    def beat_ns(self) -> int:
        """Time of the last sign of life of its writer, monotonic; 0 if there was none."""
        return self._words[_BEAT]

    def beat(self, t_ns: int) -> None:
        """Give a sign of life, with or without rows."""
        self._words[_BEAT] = t_ns


class LatestTable:
    """Stores a slot for each given stream, in the given order, and after them the windows."""

    def __init__(self, streams: Sequence[Stream], file: SharedFile) -> None:
        """Use :meth:`create` or :meth:`attach`."""
        self._slots: dict[str, Slot] = {}
        start = 0
        for stream in streams:
            size = slot_bytes(_width(stream))
            self._slots[stream.name] = Slot(file.payload[start : start + size], _width(stream))
            start += size
        self._windows: dict[str, memoryview] = {}
        for stream in streams:
            self._windows[stream.name] = file.payload[start : start + Windows.BYTES]
            start += Windows.BYTES

    @classmethod
    def create(cls, path: Path, streams: Sequence[Stream]) -> Self:
        """Make a table without rows.

        Raises:
            RecordingError: it exists already, or there is no room for it.
        """
        size = sum(slot_bytes(_width(stream)) + Windows.BYTES for stream in streams)
        return cls(streams, SharedFile.create(path, _MAGIC, _identity(streams), size))

    @classmethod
    def attach(cls, path: Path, streams: Sequence[Stream]) -> Self:
        """Open the table that another process made of the same streams.

        Raises:
            RecordingError: it is missing, or has other streams.
        """
        return cls(streams, SharedFile.attach(path, _MAGIC, _identity(streams)))

    def slot(self, stream: str) -> Slot:
        """Return the slot of a stream.

        Raises:
            KeyError: it has no slot.
        """
        return self._slots[stream]

    def windows(self, stream: str) -> Windows:
        """Return the recording windows of a stream, as an object for the caller only.

        Raises:
            KeyError: it has none.
        """
        return Windows(self._windows[stream])


def _width(stream: Stream) -> int:
    return len(stream.channels) + stream.has_status


def slot_bytes(width: int) -> int:
    """Return the bytes of a slot with ``width`` values."""
    words = _VALUES + width
    return 8 * _LINE_WORDS * -(-words // _LINE_WORDS)  # rounded up to whole lines


def _identity(streams: Sequence[Stream]) -> int:
    """Return 64 bits that differ if names, units or order of the values differ."""
    layout = [
        (
            stream.name,
            [(channel.name, channel.unit) for channel in stream.channels],
            stream.has_status,
        )
        for stream in streams
    ]
    return int.from_bytes(hashlib.blake2b(repr(layout).encode(), digest_size=8).digest(), "little")
