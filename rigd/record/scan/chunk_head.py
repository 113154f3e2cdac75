"""Opens a chunk of a file that may be damaged, and mends its head.

The CRC of a chunk covers its records, not the fields before them. If the records are sound, these
fields follow from them, so that a wrong one costs no message.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from rigd.record.events.gaps import Span
from rigd.record.mcap.bounds import TooLarge
from rigd.record.mcap.chunks import (
    MESSAGE_HEAD,
    ChunkHead,
    Times,
    encode_head,
    index_messages,
    parse_chunk,
    parse_message_index,
    parse_torn_chunk,
    unpack_chunk,
)
from rigd.record.mcap.compression import COMPRESSIONS, stated_size
from rigd.record.mcap.wire import FRAME, Malformed


@dataclass(frozen=True, eq=False)
class OpenedChunk:
    """A chunk whose records are sound. ``head`` is as these say that it must be."""

    head: ChunkHead
    data: bytes | memoryview
    messages: Mapping[int, tuple[Times, Times]]  #: times and offsets by channel
    problem: str  #: what was wrong in its head; else empty
    untimed: bool  #: whether it states no times, as some programs leave them

    @property
    def spans(self) -> dict[int, Span]:
        """The messages of each channel."""
        return spans_of(self.data, self.messages)

    def mended(self, record: memoryview) -> memoryview:
        """Return the bytes of its record, and what is behind it, with the head that is right."""
        if not self.problem and not self.untimed:
            return record
        head = encode_head(self.head)
        return memoryview(b"".join((record[: FRAME.size], head, record[FRAME.size + len(head) :])))


def open_chunk(content: memoryview) -> OpenedChunk:
    """Return what the content of a Chunk record holds.

    Raises:
        Malformed: its records are damaged, or rigd cannot unpack them.
        TooLarge: more bytes than :mod:`~rigd.record.mcap.bounds` permits.
    """
    head, data, problem = unpack_sound(content)
    messages = index_messages(data)
    if not messages:
        return OpenedChunk(head, data, messages, problem, untimed=False)
    stated = head.start_ns, head.end_ns
    found = [extreme(times) for times, _ in messages.values() for extreme in (np.min, np.max)]
    times = int(min(found)), int(max(found))
    untimed = stated != times and not any(stated)
    if stated != times and not untimed:
        problem = problem or "a chunk whose times are not those of its messages"
    head = replace(head, start_ns=times[0], end_ns=times[1])
    return OpenedChunk(head, data, messages, problem, untimed)


def unpack_sound(content: memoryview) -> tuple[ChunkHead, bytes | memoryview, str]:
    """Return head and records of a chunk, and what is wrong in its head; else an empty text.

    If sizes or compression are not those of the data, the CRC decides whether the records are
    sound.

    Raises:
        Malformed: its records are damaged, or rigd cannot unpack them.
        TooLarge: more bytes than :mod:`~rigd.record.mcap.bounds` permits.
    """
    try:
        head = parse_chunk(content)
        return head, unpack_chunk(head), ""
    except Malformed as error:
        likely = _likely(content)
        if likely is None:
            raise
        try:
            return likely, unpack_chunk(likely), str(error)
        except (Malformed, TooLarge):
            pass
        raise


def _likely(content: memoryview) -> ChunkHead | None:
    """Return the head of a chunk as its compressed data state it; None if nothing can prove it."""
    head = parse_torn_chunk(content)
    names = [name for name in COMPRESSIONS if len(name) == len(head.compression)]
    if not head.crc or not names:
        return None
    size = stated_size(head.packed, names[0])
    return replace(head, compression=names[0], size=head.size if size < 0 else size)


def span_of_index(content: memoryview) -> tuple[int, Span | None]:
    """Return the channel of a MessageIndex record's content, and the messages that it names.

    Raises:
        Malformed: its length does not agree with the content.
    """
    channel, entries = parse_message_index(content)
    if not len(entries):
        return channel, None
    times = entries[:, 0]
    return channel, Span(int(times.min()), int(times.max()), len(entries))


def spans_of(
    data: bytes | memoryview, messages: Mapping[int, tuple[Times, Times]]
) -> dict[int, Span]:
    """Return the messages of each channel with the first and the last number."""
    spans = {}
    for channel, (times, offsets) in messages.items():
        numbers = [
            int(np.frombuffer(data, MESSAGE_HEAD, 1, int(offset))[0]["sequence"])
            for offset in (offsets[0], offsets[-1])
        ]
        spans[channel] = Span(int(times.min()), int(times.max()), len(times), *numbers)
    return spans
