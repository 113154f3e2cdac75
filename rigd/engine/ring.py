"""A ring in the memory of one process: rows of one stream, one writer and one reader.

One writer, one reader, fixed capacity, never waits. A push onto a full ring is counted as an
overrun and the new row is dropped: rows already taken are never destroyed.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rigd.engine.sink import Rows
from rigd.model.channels import Stream
from rigd.model.rows import row_dtype, row_struct


class Ring:
    """Rows of ``stream`` in one block of memory, laid out as :func:`rigd.model.rows.row_dtype`."""

    def __init__(self, stream: Stream, capacity: int) -> None:
        self.stream = stream
        self.capacity = capacity
        self.overruns = 0
        self._layout = row_struct(stream)
        self._memory = bytearray(self._layout.size * capacity)
        self._rows = np.frombuffer(self._memory, dtype=row_dtype(stream))
        self._head = 0  # rows pushed since the beginning
        self._tail = 0  # rows drained since the beginning

    def push(self, t_ns: int, row: Sequence[float]) -> None:
        """Append one row: the values in order, the status word (an int) last where there is one."""
        if self._head - self._tail >= self.capacity:
            self.overruns += 1
            return
        offset = (self._head % self.capacity) * self._layout.size
        self._layout.pack_into(self._memory, offset, t_ns, *row)
        self._head += 1

    @property
    def fill(self) -> float:
        """Share of the ring that waits to be drained, 0 to 1."""
        return (self._head - self._tail) / self.capacity

    def drain(self) -> Rows:
        """Return all rows pushed since the last drain, as a copy of shape (n,)."""
        start, stop = self._tail % self.capacity, self._head % self.capacity
        if self._head == self._tail:
            return self._rows[:0].copy()
        if start < stop:
            rows = self._rows[start:stop].copy()
        else:
            rows = np.concatenate([self._rows[start:], self._rows[:stop]])
        self._tail = self._head
        return rows


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
