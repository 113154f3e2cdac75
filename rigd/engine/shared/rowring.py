"""Ring of the rows of one stream: one writer and one reader, in one process or two.

In a mapped file between processes, or within one. One writer, one reader that lets go of rows once
they are on disk, any number of viewers that hinder nobody. It has a fixed capacity and never waits:
a push onto a full ring is counted and the new row is dropped, rows already taken are never
destroyed.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import Final, Self

import numpy as np

from rigd.engine.shared.mapping import FIRST_FREE_WORD, SharedFile
from rigd.engine.sink import Rows
from rigd.model.channels import Stream
from rigd.model.rows import row_dtype, row_struct

_MAGIC: Final = b"rigdrow1"
_CAPACITY: Final = FIRST_FREE_WORD
# The writer's words and the reader's on cache lines of their own (64 bytes).
_HEAD: Final = 8  #: rows pushed since the beginning
_OVERRUNS: Final = 9
_CLAIM: Final = 10  #: rows up to which a block may be written, announced or not; before it is
_TAIL: Final = 16  #: rows released since the beginning


class RowRing:
    """Rows of ``stream``, laid out as :func:`rigd.model.rows.row_dtype`.

    One process pushes, one other peeks and releases; each holds an object of its own.
    """

    def __init__(self, stream: Stream, file: SharedFile) -> None:
        """Use :meth:`create`, :meth:`attach` or :meth:`unshared`."""
        self.stream = stream
        self.path = file.path
        self.capacity = file.words[_CAPACITY]
        self._words = file.words
        self._payload = file.payload
        layout = row_struct(stream)
        self._size = layout.size
        self._pack_into = layout.pack_into
        self._rows: Rows = np.frombuffer(file.payload, row_dtype(stream), self.capacity)
        # The writer's own copy of what it alone writes, and the tail as it last saw it.
        self._head = file.words[_HEAD]
        self._seen_tail = file.words[_TAIL]
        self._lost = file.words[_OVERRUNS]

    @classmethod
    def create(cls, path: Path, stream: Stream, capacity: int) -> Self:
        """Make an empty ring of ``capacity`` rows.

        Raises:
            RecordingError: it exists already, or there is no room for it.
        """
        size = row_struct(stream).size * capacity
        file = SharedFile.create(path, _MAGIC, _identity(stream), size)
        file.words[_CAPACITY] = capacity
        return cls(stream, file)

    @classmethod
    def unshared(cls, stream: Stream, capacity: int) -> Self:
        """Make an empty ring of ``capacity`` rows that stays within this process."""
        file = SharedFile.unshared(row_struct(stream).size * capacity)
        file.words[_CAPACITY] = capacity
        return cls(stream, file)

    @classmethod
    def attach(cls, path: Path, stream: Stream) -> Self:
        """Open a ring that another process made.

        Raises:
            RecordingError: it is missing, or that of a stream with another layout.
        """
        return cls(stream, SharedFile.attach(path, _MAGIC, _identity(stream)))

    @property
    def head(self) -> int:
        """Rows pushed since the beginning."""
        return self._words[_HEAD]

    @property
    def claimed(self) -> int:
        """Rows pushed since the beginning, with those that may be being written."""
        return max(self._words[_HEAD] + 1, self._words[_CLAIM])

    @property
    def tail(self) -> int:
        """Rows released since the beginning."""
        return self._words[_TAIL]

    @property
    def overruns(self) -> int:
        """Rows lost because the ring was full."""
        return self._words[_OVERRUNS]

    @property
    def fill(self) -> float:
        """Share of the ring that waits to be released, 0 to 1."""
        tail = self.tail  # first: for a third process, the tail may overtake an older head
        return (self.head - tail) / self.capacity

    def push(self, t_ns: int, row: Sequence[float]) -> None:
        """Append one row: the values in order, the status word (an int) last where there is one."""
        head = self._head
        if head - self._seen_tail >= self.capacity and not self._room():
            self._lose(1)
            return
        self._pack_into(self._payload, head % self.capacity * self._size, t_ns, *row)
        self._head = head + 1
        self._words[_HEAD] = head + 1

    def push_block(self, rows: Rows) -> None:
        """Append rows of the stream's row dtype, shape (n,); those that do not fit are lost."""
        count = min(len(rows), self._room())
        start = self._head % self.capacity
        first = min(count, self.capacity - start)
        self._words[_CLAIM] = self._head + count
        self._rows[start : start + first] = rows[:first]
        self._rows[: count - first] = rows[first:count]
        self._head += count
        self._words[_HEAD] = self._head
        if count < len(rows):
            self._lose(len(rows) - count)

    def peek(self) -> Rows:
        """Return a copy of all rows that were pushed and not released, shape (n,)."""
        return self.between(self.tail, self.head)

    def release(self, count: int) -> None:
        """Give the room of the ``count`` oldest rows back to the writer."""
        self._words[_TAIL] = self._words[_TAIL] + count

    def drain(self) -> Rows:
        """Peek, and release at once."""
        rows = self.peek()
        self.release(len(rows))
        return rows

    def between(self, start: int, stop: int) -> Rows:
        """Return a copy of the rows from number ``start`` to before ``stop``, at most a ringful.

        The caller makes sure that they are still there.
        """
        low, high = start % self.capacity, stop % self.capacity
        if start >= stop:
            return self._rows[:0].copy()
        if low < high:
            return self._rows[low:high].copy()
        return np.concatenate([self._rows[low:], self._rows[:high]])

    def latest(self, count: int) -> Rows:
        """Return the last ``count`` rows, or as many as there are; for a display."""
        view = View(self)
        view.position = max(self.head - count, 0)
        return view.read()

    def _room(self) -> int:
        self._seen_tail = self._words[_TAIL]
        return self.capacity - (self._head - self._seen_tail)

    def _lose(self, count: int) -> None:
        self._lost += count
        self._words[_OVERRUNS] = self._lost


class View:
    """A second reader, for the eye: it releases nothing, and skips what it was too slow for."""

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
        # Meanwhile the writer went on: what it has overwritten, or may be at, is torn.
        sound = max(start, min(self._ring.claimed - self._ring.capacity, head))
        self.skipped += sound - self.position
        self.position = head
        return rows[sound - start :]


def _identity(stream: Stream) -> int:
    """Return 64 bits that differ where names, units or order of a row's fields do."""
    text = repr((stream.name, [(c.name, c.unit) for c in stream.channels], stream.has_status))
    return int.from_bytes(hashlib.blake2b(text.encode(), digest_size=8).digest(), "little")
