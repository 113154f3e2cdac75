"""Finds the next valid MCAP record after a damaged place in a file."""

from __future__ import annotations

import re
from typing import Final

from mcap.opcode import Opcode
from mcap.records import Channel, Header, Metadata, Schema

from rigd.record.mcap.chunks import parse_message_index
from rigd.record.mcap.crc import crc32
from rigd.record.mcap.wire import (
    DATA_END,
    FRAME,
    MAGIC,
    Malformed,
    Record,
    attachment_at,
    decode,
    encode,
    record_at,
)
from rigd.record.scan.chunk_head import unpack_sound
from rigd.record.scan.definitions import check_channel

#: Opcodes of the data section, each with a length below 4 GiB behind it.
_BEGINNING: Final = re.compile(rb"[\x03\x04\x06\x07\x09\x0c\x0f](?=[\s\S]{4}\x00{4})")
_CHUNK: Final = re.compile(rb"\x06(?=[\s\S]{4}\x00{4})")
_FILE: Final = re.compile(re.escape(MAGIC) + b"\x01")
#: The records that may follow DataEnd: those of the summary, or the footer.
_SUMMARY: Final = (
    Opcode.FOOTER,
    Opcode.SCHEMA,
    Opcode.CHANNEL,
    Opcode.CHUNK_INDEX,
    Opcode.STATISTICS,
    Opcode.SUMMARY_OFFSET,
)


def next_record(buffer: memoryview, damaged: int) -> int:
    """Return the start of the next intact record after the damaged record at ``damaged``.

    That is the end of the damaged record according to its size, if an intact record is there; so
    the content of a damaged record is never taken for a record. Else it is the first place with an
    intact record, or the end of the buffer.
    """
    try:
        end = record_at(buffer, damaged).end
    except Malformed:
        end = len(buffer)
    if end < len(buffer) and is_sound(buffer, end):
        return end
    for match in _BEGINNING.finditer(buffer, damaged + 1):
        if is_sound(buffer, match.start()):
            return match.start()
    return len(buffer)


def begin_of_another(buffer: memoryview, start: int, end: int) -> int | None:
    """Return where another recording begins between two bytes, or None.

    A recording within a damaged record of valid length belongs to that record, such as an
    attachment.
    """
    try:
        if record_at(buffer, start).end == end:
            return None
    except Malformed:
        pass
    for match in _FILE.finditer(buffer, max(start, 1), end):
        try:
            decode(Header, record_at(buffer, match.end() - 1).content)
        except Malformed:
            continue
        return match.start()
    return None


def is_sound(buffer: memoryview, start: int) -> bool:
    """Return whether a valid record of the data section begins at ``start``.

    It is valid by its CRC or, if it has none, by lengths that agree to the byte.
    """
    try:
        record = record_at(buffer, start)
        check_record(record)
        return record.opcode != Opcode.DATA_END or ends_data(buffer, record)
    except Malformed:
        return False


def check_record(record: Record) -> None:
    """Check that the sizes and fields of a record of the data section are consistent.

    Raises:
        Malformed: something does not agree, or it does not belong there.

    """
    content, opcode = record.content, record.opcode
    if opcode == Opcode.CHUNK:
        unpack_sound(content)
    elif opcode == Opcode.MESSAGE_INDEX:
        parse_message_index(content)
    elif opcode == Opcode.ATTACHMENT:
        if crc32(content[:-4]) != int.from_bytes(content[-4:], "little"):
            raise Malformed("an attachment whose CRC does not match its data")
        attachment_at(record)
    elif opcode == Opcode.METADATA:
        _check_exact(decode(Metadata, content), content)
    elif opcode == Opcode.SCHEMA:
        _check_exact(decode(Schema, content), content)
    elif opcode == Opcode.CHANNEL:
        channel = decode(Channel, content)
        _check_exact(channel, content)
        check_channel(channel)
    elif opcode == Opcode.DATA_END:
        if len(content) != DATA_END.size - FRAME.size:
            raise Malformed("the end of the data has another length")
    elif opcode == Opcode.MESSAGE:
        raise Malformed("a message outside of a chunk, which rigd does not write or index")
    else:
        raise Malformed(f"no record begins at byte {record.start}")


def check_index_end(buffer: memoryview, index: Record) -> None:
    """Check the length of a message index, which no CRC covers, by the records around it.

    Raises:
        Malformed: no sound record follows it, and a sound chunk begins inside of it.

    """
    if index.end >= len(buffer) or is_sound(buffer, index.end):
        return
    for match in _CHUNK.finditer(buffer, index.start + 1, index.end + FRAME.size):
        if match.start() < index.end and is_sound(buffer, match.start()):
            raise Malformed("a message index that claims more bytes than it has")


def ends_data(buffer: memoryview, record: Record) -> bool:
    """Return whether the bytes after a DataEnd record are a summary or a footer."""
    try:
        return record_at(buffer, record.end).opcode in _SUMMARY
    except Malformed:
        return False


def _check_exact(record: Metadata | Schema | Channel, content: memoryview) -> None:
    """Check that writing the parsed content gives the bytes of the record again."""
    if encode(record)[FRAME.size :] != bytes(content):
        raise Malformed(f"a damaged {type(record).__name__} record")
