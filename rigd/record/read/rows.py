"""Reads the messages of a recording chunk by chunk: the rows of its streams, and its events."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from mcap.opcode import Opcode
from mcap.records import ChunkIndex
from numpy.typing import NDArray

from rigd.model import RecordingError
from rigd.model.rows import row_dtype
from rigd.record.events.event import Event, parse_event
from rigd.record.mcap.bounds import require_events
from rigd.record.mcap.chunks import blob_dtype, parse_chunk, parse_torn_chunk, unpack_chunk
from rigd.record.mcap.contents import Contents, rows_of
from rigd.record.mcap.crc import crc32
from rigd.record.mcap.file import RecordingInUse
from rigd.record.mcap.wire import Malformed
from rigd.record.read.condition import LAST_NS
from rigd.record.read.index import bytes_at, damaged, opened, record_in, require_same
from rigd.record.read.messages.chunk_rows import (
    Channels,
    KeptMessages,
    Messages,
    in_order,
    numbered_dtype,
)
from rigd.record.read.messages.topics import Topics


@dataclass(frozen=True, eq=False)
class Chunks:
    """The chunks that an index names. Keeps no open file; each read opens the file again.

    Rows and events of a file of another program are given in order of time, each once; those of
    rigd are in order as they stand.
    """

    path: Path
    size: int  #: bytes of the file when its index was read
    contents: Contents
    topics: Topics
    others: bool  #: whether another program wrote the file
    checked: bool  #: whether the index is that of a check of every byte
    kept: KeptMessages = field(default_factory=KeptMessages)

    def within(self, channels: Channels, low: int = 0, high: int = LAST_NS) -> list[ChunkIndex]:
        """Return the chunks with messages of the channels from ``low`` to before ``high`` ns."""
        return [
            chunk
            for chunk in self.contents.chunks
            if not chunk.message_index_offsets.keys().isdisjoint(channels)
            and chunk.message_end_time >= low
            and chunk.message_start_time < high
        ]

    def read(self, stream: str, low: int, high: int, *, check_crc: bool) -> NDArray[np.void]:
        """Return the rows with ``low <= t_ns < high``.

        Raises:
            RecordingError: a damaged chunk.
        """
        blob, dtype = self._blob(stream), row_dtype(self.topics.streams[stream])
        pieces = self.pieces(stream, low, high, check_crc=check_crc)
        if self.others:
            return np.concatenate([np.empty(0, blob), *pieces], dtype=blob).view(dtype)
        # Filled piece by piece: joining them at the end would need twice the memory. Every row
        # has 16 bytes of index in the file, which bounds the rows that a damaged index can state.
        chunks = self.within(self.topics.channels[stream], low, high)
        most = min(sum(map(rows_of, chunks)), self.size // 16)
        joined, end = np.empty(most, blob), 0
        for rows in pieces:
            if end + len(rows) > most:
                raise self.damaged("a chunk has more messages than its index")
            joined[end : end + len(rows)] = rows
            end += len(rows)
        return joined[:end].view(dtype)

    def batches(self, stream: str, low: int, high: int, rows: int) -> Iterator[NDArray[np.void]]:
        """Yield what :meth:`read` returns in parts of at least ``rows``.

        Raises:
            RecordingError: a damaged chunk.
        """
        waiting: list[NDArray[np.void]] = []
        blob, dtype = self._blob(stream), row_dtype(self.topics.streams[stream])
        for piece in self.pieces(stream, low, high, check_crc=True):
            waiting.append(piece)
            if sum(map(len, waiting)) >= rows:
                yield np.concatenate(waiting, dtype=blob).view(dtype)
                waiting = []
        if waiting:
            yield np.concatenate(waiting, dtype=blob).view(dtype)

    def pieces(
        self, stream: str, low: int, high: int, *, check_crc: bool
    ) -> Iterator[NDArray[np.void]]:
        """Yield the rows with ``low <= t_ns < high`` in parts, as times and blobs."""
        take = self._in_order if self.others else self._as_they_stand
        return take(stream, low, high, check_crc=check_crc)

    def _as_they_stand(
        self, stream: str, low: int, high: int, *, check_crc: bool
    ) -> Iterator[NDArray[np.void]]:
        channels, blob = self.topics.channels[stream], self._blob(stream)
        with opened(self.path) as fd:
            for index in self.within(channels, low, high):
                messages = self._unpack(fd, index, check_crc=check_crc)
                try:
                    rows = messages.rows(channels, blob)
                except Malformed as error:
                    raise self.damaged(error) from error
                if index.message_start_time < low or index.message_end_time >= high:
                    times = rows["t_ns"].astype(np.int64)
                    rows = rows[(times >= low) & (times < high)]
                yield rows

    def _in_order(
        self, stream: str, low: int, high: int, *, check_crc: bool
    ) -> Iterator[NDArray[np.void]]:
        """Yield rows by time; only those are held that a later chunk may stand before."""
        channels, blob = self.topics.channels[stream], self._blob(stream)
        chunks = self.within(channels, low, high)
        chunks.sort(key=lambda chunk: chunk.message_start_time)
        begins = [*(chunk.message_start_time for chunk in chunks[1:]), 2**64 - 1]
        held = np.empty(0, numbered_dtype(blob))
        with opened(self.path) as fd:
            for index, following in zip(chunks, begins, strict=False):
                messages = self._unpack(fd, index, check_crc=check_crc)
                rows = messages.numbered(channels, blob, self.topics.decoders)
                within = (rows["t_ns"] >= low) & (rows["t_ns"] < high)
                rows = in_order(np.concatenate([held, rows[within]]))
                end = int(np.searchsorted(rows["t_ns"], following))
                held = rows[end:]
                yield _bare(rows[:end], blob)
        yield _bare(held, blob)

    def events(self) -> list[Event]:
        """Return all events.

        Raises:
            RecordingError: a damaged chunk, or an event of rigd that is damaged.
        """
        if self.others:
            return self._events_in_order()
        channels = self.topics.events
        events: list[Event] = []
        text_bytes = 0
        with opened(self.path) as fd:
            for index in self.within(channels):
                messages = self._unpack(fd, index, check_crc=True)
                try:
                    found = list(messages.payloads(channels))
                    text_bytes += sum(len(payload) for _, payload in found)
                    require_events(text_bytes, self.size)
                    events += [parse_event(t_ns, payload) for t_ns, payload in found]
                except Malformed as error:
                    raise self.damaged(error) from error
        return events

    def _events_in_order(self) -> list[Event]:
        """Return the events without those that cannot be read: the check has named these."""
        found: dict[tuple[int, int, bytes], None] = {}
        channels, text_bytes = self.topics.events, 0
        with opened(self.path) as fd:
            for index in self.within(channels):
                messages = self._unpack(fd, index, check_crc=True)
                for t_ns, number, payload in messages.numbers(channels):
                    text_bytes += len(payload)
                    found[t_ns, number, bytes(payload)] = None
                require_events(text_bytes, self.size)
        events: list[Event] = []
        for t_ns, _, data in sorted(found, key=lambda key: key[:2]):
            with suppress(Malformed):
                events.append(parse_event(t_ns, memoryview(data)))
        return events

    def _blob(self, stream: str) -> np.dtype[np.void]:
        return blob_dtype(self.topics.streams[stream])

    def _unpack(self, fd: int, index: ChunkIndex, *, check_crc: bool) -> Messages:
        try:
            if index.chunk_start_offset in self.contents.loose:
                data = bytes_at(fd, index.chunk_start_offset, index.uncompressed_size)
                return Messages.of(data)
            record = record_in(fd, index.chunk_start_offset, index.chunk_length, Opcode.CHUNK)
            if self.checked:  # then the index is right where the head is not
                head = replace(
                    parse_torn_chunk(record.content),
                    size=index.uncompressed_size,
                    compression=index.compression,
                )
            else:
                require_same(head := parse_chunk(record.content), index)
            key = index.chunk_start_offset, head.size, head.crc or crc32(head.packed)
            if (kept := self.kept.get(key)) is not None:
                return kept
            messages = Messages.of(unpack_chunk(head, check_crc=check_crc))
        except Malformed as error:
            raise self.damaged(error) from error
        if check_crc and messages.places is not None:
            self.kept.keep(key, messages)
        return messages

    def damaged(self, problem: object) -> RecordingError:
        """Return the error for what cannot be read; this index is void if the file has changed."""
        error = damaged(self.path, problem)
        if isinstance(error, RecordingInUse) or self.path.stat().st_size == self.size:
            return error
        return RecordingError(
            f"{self.path} has been written to since it was opened", hint="Open it again."
        )


def _bare(rows: NDArray[np.void], blob: np.dtype[np.void]) -> NDArray[np.void]:
    """Return rows without number and publish time."""
    bare = np.empty(len(rows), blob)
    bare["t_ns"], bare["values"] = rows["t_ns"], rows["values"]
    return bare
