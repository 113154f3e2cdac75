"""Buffers the rows of one stream in a ring, in one process or between two processes.

Between processes the ring is a mapped file. There is one writer and one reader. The reader releases
rows once they are on disk. Any number of viewers may read too; they do not slow down the others.
The ring has a fixed capacity and never waits. If the ring is full, a new row is dropped and
counted; rows already in the ring are never destroyed.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import Final, Self

import numpy as np

from rigd.engine.shared.mapping import SharedFile
from rigd.engine.shared.ring import CAPACITY, CLAIM, HEAD, OVERRUNS, TAIL, Ring
from rigd.engine.sink import Rows
from rigd.model.channels import Stream
from rigd.model.rows import row_dtype, row_struct

_MAGIC: Final = b"rigdrow1"


class RowRing(Ring):
    """Buffers rows of ``stream`` with the layout of :func:`rigd.model.rows.row_dtype`.

    One process pushes, another process peeks and releases; each has its own object.
    """

    def __init__(self, stream: Stream, file: SharedFile) -> None:
        """Use :meth:`create`, :meth:`attach` or :meth:`unshared`."""
        super().__init__(file)
        self.stream = stream
        layout = row_struct(stream)
        self._size = layout.size
        self._pack_into = layout.pack_into
        self._rows: Rows = np.frombuffer(file.payload, row_dtype(stream), self.capacity)
        # The writer's copy of the words that only it writes, and the last known tail.
        self._head = file.words[HEAD]
        self._seen_tail = file.words[TAIL]
        self._lost = file.words[OVERRUNS]

    @classmethod
    def create(cls, path: Path, stream: Stream, capacity: int) -> Self:
        """Make an empty ring of ``capacity`` rows.

        Raises:
            RecordingError: it exists already, or there is no room for it.
        """
        size = row_struct(stream).size * capacity
        file = SharedFile.create(path, _MAGIC, _identity(stream), size)
        file.words[CAPACITY] = capacity
        return cls(stream, file)

    @classmethod
    def unshared(cls, stream: Stream, capacity: int) -> Self:
        """Make an empty ring of ``capacity`` rows for this process only."""
        file = SharedFile.unshared(row_struct(stream).size * capacity)
        file.words[CAPACITY] = capacity
        return cls(stream, file)

    @classmethod
    def attach(cls, path: Path, stream: Stream) -> Self:
        """Open a ring that another process made.

        Raises:
            RecordingError: it is missing, or belongs to a stream with another layout.
        """
        return cls(stream, SharedFile.attach(path, _MAGIC, _identity(stream)))

    @property
    def claimed(self) -> int:
        """Rows pushed since the beginning, with those that may be in writing."""
        return max(self._words[HEAD] + 1, self._words[CLAIM])

    def push(self, t_ns: int, row: Sequence[float]) -> None:
        """Append a row: the values in order, the status word (an int) last if there is one."""
        head = self._head
        if head - self._seen_tail >= self.capacity and not self._room():
            self._lose(1)
            return
        self._pack_into(self._payload, head % self.capacity * self._size, t_ns, *row)
        self._head = head + 1
        self._words[HEAD] = head + 1

    def push_packed(self, row: memoryview) -> None:
        """Append a row that has the bytes of the stream's row dtype already."""
        head = self._head
        if head - self._seen_tail >= self.capacity and not self._room():
            self._lose(1)
            return
        at = head % self.capacity * self._size
        self._payload[at : at + self._size] = row
        self._head = head + 1
        self._words[HEAD] = head + 1

    def push_block(self, rows: Rows) -> None:
        """Append rows of the stream's row dtype, shape (n,); rows without room are lost."""
        count = min(len(rows), self._room())
        start = self._head % self.capacity
        first = min(count, self.capacity - start)
        self._words[CLAIM] = self._head + count
        self._rows[start : start + first] = rows[:first]
        self._rows[: count - first] = rows[first:count]
        self._head += count
        self._words[HEAD] = self._head
        if count < len(rows):
            self._lose(len(rows) - count)

    def peek(self) -> Rows:
        """Return a copy of all rows that are pushed and not released, shape (n,)."""
        return self.between(self.tail, self.head)

    def release(self, count: int) -> None:
        """Return the room of the ``count`` oldest rows to the writer."""
        self._words[TAIL] = self._words[TAIL] + count

    def drain(self) -> Rows:
        """Peek, and release at once."""
        rows = self.peek()
        self.release(len(rows))
        return rows

    def between(self, start: int, stop: int) -> Rows:
        """Return a copy of the rows from number ``start`` to before ``stop``, at most a full ring.

        The caller makes sure that they still exist.
        """
        low, high = start % self.capacity, stop % self.capacity
        if start >= stop:
            return self._rows[:0].copy()
        if low < high:
            return self._rows[low:high].copy()
        return np.concatenate([self._rows[low:], self._rows[:high]])

    def latest(self, count: int) -> Rows:
        """Return the last ``count`` rows, or as many as exist; for a display."""
        view = View(self)
        view.position = max(self.head - count, 0)
        return view.read()

    def _room(self) -> int:
        self._seen_tail = self._words[TAIL]
        return self.capacity - (self._head - self._seen_tail)

    def _lose(self, count: int) -> None:
        self._lost += count
        self._words[OVERRUNS] = self._lost


class View:
    """Reads rows for display: releases none, and skips rows that were overwritten."""

    def __init__(self, ring: RowRing) -> None:
        """Begin with the next row."""
        self._ring = ring
        self.position = ring.head  #: number of the next row to read
        self.skipped = 0  #: rows overwritten before they were read

    def read(self) -> Rows:
        """Return a copy of the rows pushed since the last call, without those overwritten."""
        head = self._ring.head
        start = max(self.position, head - self._ring.capacity)
        rows = self._ring.between(start, head)
        # The writer has continued meanwhile: rows that it has overwritten, or may be writing, are
        # invalid.
        sound = max(start, min(self._ring.claimed - self._ring.capacity, head))
        self.skipped += sound - self.position
        self.position = head
        return rows[sound - start :]


def _identity(stream: Stream) -> int:
    """Return 64 bits that differ if names, units or order of a row's fields differ."""
    text = repr((stream.name, [(c.name, c.unit) for c in stream.channels], stream.has_status))
    return int.from_bytes(hashlib.blake2b(text.encode(), digest_size=8).digest(), "little")
