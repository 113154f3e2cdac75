"""Encodes and decodes MCAP records, the units of which an MCAP file consists.

Format: https://mcap.dev/spec (version 0). A record is an opcode, a length and that many bytes. rigd
encodes this framing itself; the ``mcap`` library encodes the rare kinds of record.
"""

from __future__ import annotations

import mmap
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from itertools import starmap
from typing import Final, TypeVar

from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import AttachmentIndex, ChunkIndex, McapRecord

MAGIC: Final = b"\x89MCAP0\r\n"
FRAME: Final = struct.Struct("<BQ")  #: opcode, length of the content behind it
FOOTER: Final = struct.Struct("<BQQQI")  #: frame, summary start, summary offset start, CRC
DATA_END: Final = struct.Struct("<BQI")  #: frame, CRC of the data section

_ATTACHMENT_TIMES: Final = struct.Struct("<QQ")
_TEXT_LENGTH: Final = struct.Struct("<I")
_DATA_SIZE: Final = struct.Struct("<Q")
_CRC: Final = struct.Struct("<I")
_CHUNK_INDEX_HEAD: Final = struct.Struct("<QQQQI")
_CHUNK_INDEX_ENTRY: Final = struct.Struct("<HQ")
_CHUNK_INDEX_MIDDLE: Final = struct.Struct("<QI")
_CHUNK_INDEX_SIZES: Final = struct.Struct("<QQ")

R = TypeVar("R", bound=McapRecord)


class Malformed(ValueError):
    """Bytes that do not follow the MCAP specification; callers turn it into a RecordingError."""


@dataclass(frozen=True)
class Record:
    """A record in a buffer: ``start`` of its frame, ``end`` of its content, both in bytes."""

    opcode: int
    start: int
    end: int
    content: memoryview


def record_at(buffer: memoryview, start: int) -> Record:
    """Return the record that begins at ``start``.

    Raises:
        Malformed: the buffer ends within the record.

    """
    if start + FRAME.size > len(buffer):
        raise Malformed(f"the file ends within a record at byte {start}")
    opcode, length = FRAME.unpack_from(buffer, start)
    end = start + FRAME.size + length
    if end > len(buffer):
        raise Malformed(f"the file ends within a record of {length} bytes at byte {start}")
    return Record(opcode, start, end, buffer[start + FRAME.size : end])


def records(buffer: memoryview, start: int = 0) -> Iterator[Record]:
    """Yield the records from ``start`` to the end of the buffer.

    Raises:
        Malformed: the buffer ends within a record.

    """
    while start < len(buffer):
        record = record_at(buffer, start)
        yield record
        start = record.end


def map_file(fd: int) -> memoryview:
    """Return the bytes of a file that is not empty, to read only.

    Only for a locked file: if another process cuts the file shorter, a read kills this process.
    """
    return memoryview(mmap.mmap(fd, 0, access=mmap.ACCESS_READ))


def encode(record: McapRecord) -> bytes:
    """Return the record with its frame."""
    builder = RecordBuilder()
    record.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call]  # the library leaves it untyped


def decode(kind: type[R], content: memoryview) -> R:
    """Return the ``kind`` of record that ``content`` (without frame) holds.

    Raises:
        Malformed: the content is too short for its own lengths, or a text is not UTF-8.

    """
    stream = ReadDataStream(BytesIO(content))
    try:
        record: R = kind.read(stream)  # type: ignore[attr-defined]  # not declared on the base
    except (struct.error, McapError, UnicodeDecodeError) as error:
        raise Malformed(f"a damaged {kind.__name__} record ({error})") from error
    return record


def attachment_at(record: Record, base: int = 0) -> AttachmentIndex:
    """Return the index of an attachment in a file from byte ``base`` on; its data are not copied.

    Raises:
        Malformed: it is shorter than its own lengths, or a text is not UTF-8.
    """
    found, begin = decode_attachment_head(record.content)
    if begin + found.data_size + _CRC.size > len(record.content):
        raise Malformed("a damaged Attachment record (it is shorter than its lengths)")
    found.offset, found.length = base + record.start, record.end - record.start
    return found


def decode_attachment_head(content: memoryview) -> tuple[AttachmentIndex, int]:
    """Return what stands before the data of an attachment, and where these begin.

    Offset and length in the file are 0.

    Raises:
        Malformed: the content is too short, or a text is not UTF-8.
    """
    texts: list[str] = []
    try:
        log_time, create_time = _ATTACHMENT_TIMES.unpack_from(content)
        at = _ATTACHMENT_TIMES.size
        for _ in range(2):
            (length,) = _TEXT_LENGTH.unpack_from(content, at)
            at += _TEXT_LENGTH.size
            texts.append(str(content[at : at + length], "utf-8"))
            at += length
        (size,) = _DATA_SIZE.unpack_from(content, at)
    except (struct.error, UnicodeDecodeError) as error:
        raise Malformed(f"a damaged Attachment record ({error})") from error
    index = AttachmentIndex(
        offset=0, length=0, log_time=log_time, create_time=create_time,
        data_size=size, name=texts[0], media_type=texts[1],
    )  # fmt: skip
    return index, at + _DATA_SIZE.size


def decode_chunk_index(content: memoryview) -> ChunkIndex:
    """Return a chunk index; ten times as fast as the library, for files of several hours.

    Raises:
        Malformed: the content is too short.

    """
    try:
        start_ns, end_ns, offset, length, size = _CHUNK_INDEX_HEAD.unpack_from(content)
        at = _CHUNK_INDEX_HEAD.size
        entries = content[at : at + size]
        at += size
        index_length, name_length = _CHUNK_INDEX_MIDDLE.unpack_from(content, at)
        at += _CHUNK_INDEX_MIDDLE.size
        name = str(content[at : at + name_length], "utf-8")
        compressed, uncompressed = _CHUNK_INDEX_SIZES.unpack_from(content, at + name_length)
        offsets = dict(_CHUNK_INDEX_ENTRY.iter_unpack(entries))
    except (struct.error, UnicodeDecodeError) as error:
        raise Malformed(f"a damaged ChunkIndex record ({error})") from error
    return ChunkIndex(
        message_start_time=start_ns,
        message_end_time=end_ns,
        chunk_start_offset=offset,
        chunk_length=length,
        message_index_offsets=offsets,
        message_index_length=index_length,
        compression=name,
        compressed_size=compressed,
        uncompressed_size=uncompressed,
    )


def encode_chunk_index(index: ChunkIndex) -> bytes:
    """Return a chunk index with its frame, as :func:`encode`, which takes ten times as long."""
    name = index.compression.encode()
    entries = b"".join(starmap(_CHUNK_INDEX_ENTRY.pack, index.message_index_offsets.items()))
    content = b"".join(
        (
            _CHUNK_INDEX_HEAD.pack(
                index.message_start_time, index.message_end_time, index.chunk_start_offset,
                index.chunk_length, len(entries),
            ),
            entries,
            _CHUNK_INDEX_MIDDLE.pack(index.message_index_length, len(name)),
            name,
            _CHUNK_INDEX_SIZES.pack(index.compressed_size, index.uncompressed_size),
        )
    )  # fmt: skip
    return FRAME.pack(Opcode.CHUNK_INDEX, len(content)) + content


def encode_data_end(crc: int) -> bytes:
    """Return the record that ends the data section."""
    return DATA_END.pack(Opcode.DATA_END, DATA_END.size - FRAME.size, crc)
