"""Passes events of any length between two processes in a ring: one writer, one reader.

Any number of viewers (:class:`EventView`) may read too; they do not slow down the writer or the
reader.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final, Self

from rigd.engine.shared.mapping import SharedFile
from rigd.engine.shared.ring import CAPACITY, CLAIM, HEAD, OVERRUNS, TAIL, Ring
from rigd.model.errors import RecordingError
from rigd.record.events.event import Event, data_to_json

_MAGIC: Final = b"rigdevt1"
_RELEASED: Final = 17  #: events released since the beginning; written before the tail
_TAKEN: Final = 18  #: events taken since the beginning

#: Bytes of the record, bytes of the kind, number of the event, its time and trial; then the kind
#: and the data as JSON, both UTF-8.
_RECORD: Final = struct.Struct("<IIQqi")


class EventRing(Ring):
    """Stores events in a mapped file; an event that does not fit is lost and counted."""

    def __init__(self, file: SharedFile) -> None:
        """Use :meth:`create` or :meth:`attach`."""
        super().__init__(file)
        self._pushed = self.released + len(self.peek())

    @classmethod
    def create(cls, path: Path, capacity: int) -> Self:
        """Make an empty ring of ``capacity`` bytes; an event takes about 100 to 500.

        Raises:
            RecordingError: it exists already, or there is no room for it.
        """
        file = SharedFile.create(path, _MAGIC, 0, capacity)
        file.words[CAPACITY] = capacity
        return cls(file)

    @classmethod
    def attach(cls, path: Path) -> Self:
        """Open a ring that another process made.

        Raises:
            RecordingError: it is missing, or is not a ring of events.
        """
        return cls(SharedFile.attach(path, _MAGIC, 0))

    @property
    def claimed(self) -> int:
        """Bytes pushed since the beginning, with those of the record that is being written."""
        return self._words[CLAIM]

    @property
    def released(self) -> int:
        """Events released since the beginning."""
        tail = self._words[TAIL]
        if tail == self._words[HEAD]:
            return self._words[_RELEASED]
        # The reader may have been killed between the two words: the event at the tail has the
        # number.
        return int(_RECORD.unpack(self.bytes_at(tail, _RECORD.size))[2])

    @property
    def taken(self) -> int:
        """Events that the reader took since the beginning, released or not."""
        return self._words[_TAKEN]

    def push(self, t_ns: int, kind: str, trial: int, data: Mapping[str, Any]) -> None:
        """Append an event; see :meth:`rigd.record.RecordingWriter.event`.

        Raises:
            RecordingError: the data cannot be written as JSON.
        """
        try:
            text = data_to_json(data).encode()
        except (TypeError, ValueError) as error:
            raise RecordingError(f"event {kind!r} cannot be recorded: {error}") from error
        name = kind.encode()
        size = _RECORD.size + len(name) + len(text)
        head = self._words[HEAD]
        if head + size - self._words[TAIL] > self.capacity:
            self._words[OVERRUNS] = self._words[OVERRUNS] + 1
            return
        record = _RECORD.pack(size, len(name), self._pushed, t_ns, trial) + name + text
        self._words[CLAIM] = head + size
        start = head % self.capacity
        first = min(size, self.capacity - start)
        self._payload[start : start + first] = record[:first]
        self._payload[: size - first] = record[first:]
        self._pushed += 1
        self._words[HEAD] = head + size

    def peek(self) -> list[Event]:
        """Return all events that are pushed and not released."""
        tail = self.tail
        return [event for _, event in _parsed(self.bytes_at(tail, self.head - tail))]

    def take(self) -> list[Event]:
        """Peek, and note the number of events, for the process that reads them after a kill."""
        events = self.peek()
        self._words[_TAKEN] = self.released + len(events)
        return events

    def release(self, count: int) -> None:
        """Return the room of the ``count`` oldest events to the writer."""
        released, at = self.released + count, self._words[TAIL]
        for _ in range(count):
            at += _RECORD.unpack(self.bytes_at(at, _RECORD.size))[0]
        self._words[_RELEASED] = released
        self._words[TAIL] = at

    def drain(self) -> list[Event]:
        """Peek, and release at once."""
        events = self.peek()
        self.release(len(events))
        return events

    def bytes_at(self, at: int, size: int) -> bytes:
        """Return a copy of ``size`` bytes from ``at``, counted since the beginning.

        The caller makes sure that they still exist.
        """
        start = at % self.capacity
        first = min(size, self.capacity - start)
        return bytes(self._payload[start : start + first]) + bytes(self._payload[: size - first])


class EventView:
    """Reads events for display: releases none, and skips events that were overwritten."""

    def __init__(self, ring: EventRing) -> None:
        """Begin with the oldest complete event of the ring."""
        self._ring = ring
        self._position = 0 if ring.claimed <= ring.capacity else ring.tail
        self._next = 0  #: number of the next event
        self.skipped = 0  #: events overwritten before they were read

    def read(self) -> list[Event]:
        """Return the events pushed since the last call, without those overwritten."""
        ring = self._ring
        while True:
            head = ring.head
            raw = ring.bytes_at(self._position, head - self._position)
            # The writer has continued meanwhile: if it may have overwritten the copied bytes, begin
            # again with the oldest event that the ring must still keep.
            if ring.claimed <= self._position + ring.capacity:
                break
            self._position = ring.tail
        self._position = head
        events: list[Event] = []
        for number, event in _parsed(raw):
            self.skipped += number - self._next
            self._next = number + 1
            events.append(event)
        return events


def _parsed(raw: bytes) -> Iterator[tuple[int, Event]]:
    """Yield number and event of the records in ``raw``."""
    at = 0
    while at < len(raw):
        size, name_size, number, t_ns, trial = _RECORD.unpack_from(raw, at)
        body = raw[at + _RECORD.size : at + size]
        yield number, Event(t_ns, body[:name_size].decode(), trial, json.loads(body[name_size:]))
        at += size
