"""Builds the summary (index) of an MCAP file during writing, and parses it when opening a file."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass, field

from mcap.opcode import Opcode
from mcap.records import (
    AttachmentIndex,
    Channel,
    ChunkIndex,
    McapRecord,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from rigd.record.mcap.chunks import MESSAGE_INDEX_HEAD, Chunk
from rigd.record.mcap.crc import crc32
from rigd.record.mcap.wire import (
    FOOTER,
    FRAME,
    MAGIC,
    Malformed,
    decode,
    decode_chunk_index,
    encode,
    encode_chunk_index,
    encode_data_end,
    records,
)


@dataclass
class Contents:
    """Index of one MCAP file; ``counts`` are messages by channel id.

    ``loose`` are the offsets of those ``chunks`` that are none in the file, but messages outside of
    chunks that follow one another: their index is that of the chunk that they would make.
    """

    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    chunks: list[ChunkIndex] = field(default_factory=list)
    attachments: list[AttachmentIndex] = field(default_factory=list)
    metadata: list[MetadataIndex] = field(default_factory=list)
    counts: dict[int, int] = field(default_factory=dict)
    start_ns: int = 0  #: of the first message; 0 if there is none
    end_ns: int = 0
    loose: set[int] = field(default_factory=set)

    @property
    def messages(self) -> int:
        """Number of messages in the file."""
        return sum(self.counts.values())

    def add_messages(self, channel: int, count: int, start_ns: int, end_ns: int) -> None:
        """Count ``count`` messages of a channel between two times."""
        empty = not any(self.counts.values())
        self.counts[channel] = self.counts.get(channel, 0) + count
        self.start_ns = start_ns if empty else min(start_ns, self.start_ns)
        self.end_ns = end_ns if empty else max(end_ns, self.end_ns)

    def statistics(self) -> Statistics:
        """Return the Statistics record."""
        return Statistics(
            message_count=self.messages,
            schema_count=len(self.schemas),
            channel_count=len(self.channels),
            attachment_count=len(self.attachments),
            metadata_count=len(self.metadata),
            chunk_count=len(self.chunks),
            message_start_time=self.start_ns,
            message_end_time=self.end_ns,
            channel_message_counts=dict(sorted(self.counts.items())),
        )


class SummaryWriter:
    """Builds the records after the data: DataEnd, summary, footer.

    The indexes of finished chunks come first in the summary and are kept as bytes with their CRC,
    so that a flush late in a long run costs no more Python than one at its start. So are the
    definitions and the indexes of what is not a chunk, which a run adds to but never changes.
    """

    def __init__(self, contents: Contents) -> None:
        self.contents = contents
        self._encoded: dict[Opcode, tuple[int, bytes]] = {}  #: records of a kind: number, bytes
        self._index = bytearray(b"".join(map(encode_chunk_index, contents.chunks)))
        self._index_crc = crc32(self._index)

    def add_chunk(self, chunk: Chunk, offset: int) -> None:
        """Add a finished chunk to the index; its ``offset`` is final."""
        index = chunk.index_at(offset)
        encoded = encode_chunk_index(index)
        self.contents.chunks.append(index)
        self._index += encoded
        self._index_crc = crc32(encoded, self._index_crc)
        _count(self.contents, chunk)

    @property
    def index_size(self) -> int:
        """Bytes of the index of finished chunks, which grows with the length of a run."""
        return len(self._index)

    def tail(self, data_end: int, data_crc: int, open_chunks: Iterable[tuple[int, Chunk]]) -> bytes:
        """Return the records that follow the data, which ends at byte ``data_end`` of the file.

        ``open_chunks`` (offset, chunk) are in the file but may still change.
        """
        now = Contents(**{**vars(self.contents), "counts": dict(self.contents.counts)})
        now.chunks = list(self.contents.chunks)
        open_index = bytearray()
        for offset, chunk in open_chunks:
            index = chunk.index_at(offset)
            now.chunks.append(index)
            open_index += encode_chunk_index(index)
            _count(now, chunk)
        closing = encode_data_end(data_crc)
        start = data_end + len(closing)
        return closing + self._summary(now, start, bytes(open_index)) + MAGIC

    def _summary(self, now: Contents, start: int, open_index: bytes) -> bytes:
        groups: list[tuple[Opcode, bytes]] = [
            (Opcode.SCHEMA, self._kept(Opcode.SCHEMA, now.schemas.values())),
            (Opcode.CHANNEL, self._kept(Opcode.CHANNEL, now.channels.values())),
            (Opcode.STATISTICS, encode(now.statistics())),
            (Opcode.ATTACHMENT_INDEX, self._kept(Opcode.ATTACHMENT_INDEX, now.attachments)),
            (Opcode.METADATA_INDEX, self._kept(Opcode.METADATA_INDEX, now.metadata)),
        ]
        offsets = bytearray()
        at = start + len(self._index) + len(open_index)
        if at > start:
            offsets += encode(SummaryOffset(Opcode.CHUNK_INDEX, start, at - start))
        for opcode, group in groups:
            if group:
                offsets += encode(SummaryOffset(opcode, at, len(group)))
                at += len(group)
        rest = b"".join((open_index, *(group for _, group in groups), offsets))
        # The CRC covers the footer up to itself (https://mcap.dev/spec#footer-op0x02).
        footer = FOOTER.pack(Opcode.FOOTER, FOOTER.size - FRAME.size, start, at, 0)[:-4]
        crc = crc32(footer, crc32(rest, self._index_crc))
        return b"".join((self._index, rest, footer, crc.to_bytes(4, "little")))

    def _kept(self, opcode: Opcode, items: Collection[McapRecord]) -> bytes:
        """Return the records as bytes, encoded anew only if there are more than last time."""
        count, encoded = self._encoded.get(opcode, (0, b""))
        if count != len(items):
            encoded = b"".join(map(encode, items))
            self._encoded[opcode] = len(items), encoded
        return encoded


def parse_summary(buffer: memoryview) -> Contents:
    """Return the content of the summary section in ``buffer`` (without footer).

    Raises:
        Malformed: a record is damaged, or messages are outside of every chunk.
    """
    contents = Contents()
    statistics: Statistics | None = None
    for record in records(buffer):
        if record.opcode == Opcode.CHUNK_INDEX:
            contents.chunks.append(decode_chunk_index(record.content))
        elif record.opcode == Opcode.STATISTICS:
            statistics = decode(Statistics, record.content)
        else:
            add_record(contents, record.opcode, record.content)
    if statistics is not None:
        contents.counts = dict(statistics.channel_message_counts)
        contents.start_ns = statistics.message_start_time
        contents.end_ns = statistics.message_end_time
    return contents


def add_record(contents: Contents, opcode: int, content: memoryview) -> None:
    """Take a schema, channel, attachment index or metadata index into ``contents``."""
    if opcode == Opcode.SCHEMA:
        schema = decode(Schema, content)
        contents.schemas[schema.id] = schema
    elif opcode == Opcode.CHANNEL:
        channel = decode(Channel, content)
        contents.channels[channel.id] = channel
    elif opcode == Opcode.ATTACHMENT_INDEX:
        contents.attachments.append(decode(AttachmentIndex, content))
    elif opcode == Opcode.METADATA_INDEX:
        contents.metadata.append(decode(MetadataIndex, content))


def rows_of(index: ChunkIndex) -> int:
    """Return the number of messages of a chunk from the size of its index.

    Exact for a chunk of one channel; for several channels an upper bound.
    """
    return max(index.message_index_length - MESSAGE_INDEX_HEAD.size, 0) // 16


def rows_by_topic(contents: Contents) -> dict[str, int]:
    """Return the number of messages of each topic, which may have several channels."""
    rows: dict[str, int] = {}
    for number, count in contents.counts.items():
        topic = contents.channels[number].topic
        rows[topic] = rows.get(topic, 0) + count
    return rows


def parse_footer(tail: memoryview) -> tuple[int, int]:
    """Return (summary start, summary CRC) from the last bytes of a file.

    Raises:
        Malformed: the file does not end in a footer.

    """
    if len(tail) < FOOTER.size + len(MAGIC) or bytes(tail[-len(MAGIC) :]) != MAGIC:
        raise Malformed("the file has no end: it was cut short, or is still being written")
    at = len(tail) - len(MAGIC) - FOOTER.size
    opcode, length, start, _, crc = FOOTER.unpack_from(tail, at)
    if opcode != Opcode.FOOTER or length != FOOTER.size - FRAME.size:
        raise Malformed("the file does not end in a footer")
    return int(start), int(crc)


def _count(contents: Contents, chunk: Chunk) -> None:
    start_ns, end_ns = chunk.index.message_start_time, chunk.index.message_end_time
    contents.add_messages(chunk.channel, chunk.count, start_ns, end_ns)
