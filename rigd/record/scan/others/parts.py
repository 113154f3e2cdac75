"""Reads the parts of a file of another program: its end, its chunks, its records."""

from __future__ import annotations

from typing import NamedTuple

from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, McapRecord, Metadata, Schema

from rigd.record.mcap.chunks import (
    Chunk,
    ChunkHead,
    parse_message_index,
)
from rigd.record.mcap.contents import Contents, parse_footer, parse_summary
from rigd.record.mcap.crc import crc32
from rigd.record.mcap.wire import (
    FOOTER,
    FRAME,
    MAGIC,
    Malformed,
    Record,
    attachment_at,
    decode,
    encode,
    record_at,
)
from rigd.record.scan.next_record import check_record


class FileEnd(NamedTuple):
    """What the footer names: the summary, if there is one, and where the data end at the latest."""

    summary: Contents | None
    start: int  #: of the summary; 0 if there is none
    limit: int
    problem: str  #: why there is no summary, though there should be one; else empty


def moved_index(record: Record, head: ChunkHead, wrapped: Chunk) -> ChunkIndex:
    """Return the index of a chunk in the file, with the times and message index of its messages."""
    length = record.end - record.start
    moved = record.start + length - wrapped.index.chunk_length
    return ChunkIndex(
        message_start_time=wrapped.index.message_start_time,
        message_end_time=wrapped.index.message_end_time,
        chunk_start_offset=record.start,
        chunk_length=length,
        message_index_offsets={
            channel: moved + at for channel, at in wrapped.index.message_index_offsets.items()
        },
        message_index_length=wrapped.index.message_index_length,
        compression=head.compression,
        compressed_size=len(head.packed),
        uncompressed_size=head.size,
    )


def with_index(chunk: ChunkIndex, buffer: memoryview, start: int, end: int) -> ChunkIndex:
    """Return the index of a chunk with the message indexes that stand in the file."""
    offsets: dict[int, int] = {}
    at = start
    while at < end:
        record = record_at(buffer, at)
        channel, entries = parse_message_index(record.content)
        if len(entries):
            offsets[channel] = at
        at = record.end
    changes = {"message_index_offsets": offsets, "message_index_length": end - start}
    return ChunkIndex(**{**vars(chunk), **changes})


def check_other(record: Record) -> None:
    """Check a record of the data section that another program wrote.

    Raises:
        Malformed: it contradicts itself.
    """
    content = record.content
    if record.opcode == Opcode.ATTACHMENT:
        crc = int.from_bytes(content[-4:], "little")
        if crc and crc32(content[:-4]) != crc:
            raise Malformed("an attachment whose CRC does not match its data")
        attachment_at(record)
    elif record.opcode in (Opcode.METADATA, Opcode.SCHEMA, Opcode.CHANNEL):
        kinds: dict[int, type[McapRecord]] = {
            Opcode.METADATA: Metadata, Opcode.SCHEMA: Schema, Opcode.CHANNEL: Channel,
        }  # fmt: skip
        kind = kinds[record.opcode]
        if len(encode(decode(kind, content))) > FRAME.size + len(content):
            raise Malformed(f"a damaged {kind.__name__} record")
    else:
        check_record(record)


def read_ending(buffer: memoryview) -> FileEnd:
    """Return what the footer of a file names; the problem states why that is not used."""
    try:
        start, crc = parse_footer(buffer)
    except Malformed as error:
        return FileEnd(None, 0, len(buffer), str(error))
    last = len(buffer) - len(MAGIC) - FOOTER.size
    if not start:
        return FileEnd(None, 0, last, "")
    if not len(MAGIC) <= start <= last:
        return FileEnd(None, 0, last, "its footer points outside of the file")
    if crc and crc32(buffer[start : -len(MAGIC) - 4]) != crc:
        return FileEnd(None, 0, last, "the CRC of the summary does not match")
    try:
        return FileEnd(parse_summary(buffer[start:last]), start, start, "")
    except Malformed as error:
        return FileEnd(None, 0, last, str(error))
