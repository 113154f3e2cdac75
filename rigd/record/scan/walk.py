"""Iterates over the records of a file and skips damaged ones."""

from __future__ import annotations

import struct
from collections.abc import Mapping

import numpy as np
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    ChunkIndex,
    Header,
    Metadata,
    MetadataIndex,
    Schema,
)

from rigd.record.events.gaps import Span
from rigd.record.mcap.chunks import (
    MESSAGE_HEAD,
    ChunkHead,
    Times,
    begin_of_chunk,
    build_message_index,
    message_places,
    parse_chunk,
    parse_message_index,
    parse_torn_chunk,
    same_entries,
    uniform_messages,
)
from rigd.record.mcap.contents import Contents, add_record
from rigd.record.mcap.wire import (
    FRAME,
    MAGIC,
    Malformed,
    Record,
    attachment_at,
    decode,
    encode,
    record_at,
    records,
)
from rigd.record.scan.chunk_head import open_chunk, span_of_index
from rigd.record.scan.findings import Damage, Piece, Scan, collect
from rigd.record.scan.next_record import (
    check_index_end,
    check_record,
    ends_data,
    is_sound,
    next_record,
)


def walk(buffer: memoryview, found: Scan, base: int = 0) -> int:
    """Take records from ``found.data_end`` on into ``found``, up to DataEnd or the buffer's end.

    The buffer begins at byte ``base`` of the file. Return the byte of the file that the walk came
    to; damage on the way is in ``found``.
    """
    at = found.data_end - base
    while at < len(buffer):
        try:
            record = record_at(buffer, at)
            if record.opcode == Opcode.DATA_END:
                check_record(record)
                if ends_data(buffer, record):
                    break
                raise Malformed("no summary follows the end of the data")
            at = _take(buffer, record, found, base)
            continue
        except Malformed as error:
            problem = str(error)  # the error itself holds the unpacked bytes of its chunk
        start, at = at, next_record(buffer, at)
        found.damages.append(Damage(base + start, base + at, problem))
        if not _take_torn(buffer[start:at], found) and at == len(buffer):
            found.end_unknown = True
    collect(found)
    return base + at


def take_head(buffer: memoryview, found: Scan) -> None:
    """Read magic and header; if they are damaged, the scan begins with the next record."""
    magic = bytes(buffer[: len(MAGIC)]) == MAGIC
    try:
        header = record_at(buffer, len(MAGIC))
        if header.opcode != Opcode.HEADER:
            raise Malformed("the file has no header")
        decoded = decode(Header, header.content)
        if len(encode(decoded)) != header.end - header.start:
            raise Malformed("a header whose sizes do not agree")
        found.library = decoded.library
    except Malformed as error:
        found.data_end = next_record(buffer, min(len(MAGIC), len(buffer)))
        found.damages.append(Damage(0, found.data_end, str(error)))
        return
    found.data_end = header.end
    if magic:
        found.pieces.append(Piece(Opcode.HEADER, 0, buffer[: header.end]))
    else:
        found.damages.append(Damage(0, len(MAGIC), "the file does not begin like an MCAP file"))


def _take(buffer: memoryview, record: Record, found: Scan, base: int) -> int:
    """Read a record, and the message indexes after a chunk; return the start of the next record.

    Raises:
        Malformed: it is damaged, and no part of it is used.
    """
    if record.opcode == Opcode.CHUNK:
        if base + record.end < found.trusted:
            return _take_trusted_chunk(buffer, record, found, base)
        return _take_chunk(buffer, record, found, base)
    if record.opcode == Opcode.MESSAGE and _is_message(buffer, record, found):
        found.unlike = True
    check_record(record)
    if record.opcode == Opcode.MESSAGE_INDEX:
        check_index_end(buffer, record)
        _take_orphan(record, found)  # read together with its chunk if that is intact
        return record.end
    take_small(record, found, base)
    data = buffer[record.start : record.end]
    found.pieces.append(Piece(record.opcode, base + record.start, data))
    return record.end


def _is_message(buffer: memoryview, record: Record, found: Scan) -> bool:
    """Return whether a message stands outside of chunks, which rigd never writes."""
    if len(record.content) < MESSAGE_HEAD.itemsize - FRAME.size:
        return False
    (channel,) = struct.unpack_from("<H", record.content)
    return channel in found.contents.channels and is_sound(buffer, record.end)


def _mixes(data: bytes | memoryview) -> bool:
    """Return whether a chunk has several channels, or anything beside messages."""
    places = message_places(data)
    return len(places.others) > 0 or len(np.unique(places.channels)) > 1


def take_small(record: Record, found: Scan, base: int) -> None:
    """Take a definition, an attachment or metadata into the index.

    Raises:
        Malformed: it cannot be decoded, or differs from an earlier definition.
    """
    start, length = base + record.start, record.end - record.start
    if record.opcode == Opcode.ATTACHMENT:
        found.contents.attachments.append(attachment_at(record, base))
    elif record.opcode == Opcode.METADATA:
        metadata = decode(Metadata, record.content)
        found.contents.metadata.append(MetadataIndex(start, length, metadata.name))
        found.metadata.setdefault(metadata.name, {}).update(metadata.metadata)
    else:
        _check_same(record, found.contents)
        add_record(found.contents, record.opcode, record.content)


def _check_same(record: Record, known: Contents) -> None:
    """Check a definition against an earlier definition with the same number, which holds.

    Raises:
        Malformed: they differ.
    """
    if record.opcode == Opcode.SCHEMA:
        schema = decode(Schema, record.content)
        same = known.schemas.get(schema.id, schema) == schema
    elif record.opcode == Opcode.CHANNEL:
        channel = decode(Channel, record.content)
        same = known.channels.get(channel.id, channel) == channel
    else:
        return
    if not same:
        raise Malformed("a definition that differs from an earlier one")


def _take_orphan(record: Record, found: Scan) -> None:
    """Note the content of a message index whose chunk is lost."""
    channel, span = span_of_index(record.content)
    if span is not None:
        found.indexed.setdefault(channel, []).append(span)


def _take_torn(torn: memoryview, found: Scan) -> bool:
    """Note the head of a damaged chunk; return whether any of it is credible.

    Its channel is that of its first message, for which the rest need not be intact.
    """
    try:
        if FRAME.unpack_from(torn)[0] != Opcode.CHUNK:
            return False
        head = parse_torn_chunk(torn[FRAME.size :])
        first = np.frombuffer(begin_of_chunk(head, MESSAGE_HEAD.itemsize), MESSAGE_HEAD, 1)[0]
    except (Malformed, struct.error, ValueError):
        return False
    size = FRAME.size + int(first["length"])
    believed = (
        int(first["opcode"]) == Opcode.MESSAGE
        and head.start_ns <= head.end_ns
        and head.start_ns <= int(first["log_time"]) <= head.end_ns
        and not head.size % size
    )
    if believed:
        span = Span(head.start_ns, head.end_ns, head.size // size)
        found.indexed.setdefault(int(first["channel"]), []).append(span)
    return bool(believed)


def _take_chunk(buffer: memoryview, record: Record, found: Scan, base: int) -> int:
    opened = open_chunk(record.content)
    head, data, messages = opened.head, opened.data, opened.messages
    problem = opened.problem or ("a chunk that states no times" if opened.untimed else "")
    if problem:
        found.damages.append(Damage(base + record.start, base + record.end, problem))
    if uniform_messages(data) is None:
        # Other writers keep schemas and channels within the chunk that first needs them.
        found.unlike = found.unlike or _mixes(data)
        for inner in records(memoryview(data)):
            add_record(found.contents, inner.opcode, inner.content)
    index, sound_end = _message_indexes(buffer, record.end, messages)
    offsets: dict[int, int] = {}
    at = base + record.end
    for channel, encoded in index.items():
        offsets[channel] = at
        at += len(encoded)
    end = record.end if sound_end is None else sound_end
    found.pieces.append(
        Piece(
            Opcode.CHUNK,
            base + record.start,
            opened.mended(buffer[record.start : end]),
            b"" if sound_end is not None else b"".join(index.values()),
            _chunk_index(record, head, base, offsets, at),
            opened.spans,
        )
    )
    if sound_end is not None:
        return sound_end
    after = _behind_index(buffer, record.end)
    problem = f"the message index of the chunk at byte {base + record.start} is damaged"
    found.damages.append(Damage(base + end, base + after, problem))
    return after


def _behind_index(buffer: memoryview, start: int) -> int:
    """Return the offset after the intact message indexes that follow a chunk."""
    at = start
    try:
        while (record := record_at(buffer, at)).opcode == Opcode.MESSAGE_INDEX:
            check_record(record)
            check_index_end(buffer, record)
            at = record.end
    except Malformed:
        return next_record(buffer, at)
    return at


def _take_trusted_chunk(buffer: memoryview, record: Record, found: Scan, base: int) -> int:
    head = parse_chunk(record.content)
    offsets: dict[int, int] = {}
    spans: dict[int, Span] = {}
    at = record.end
    while at < len(buffer) and base + at < found.trusted:
        index = record_at(buffer, at)
        if index.opcode != Opcode.MESSAGE_INDEX:
            break
        channel, entries = parse_message_index(index.content)
        offsets[channel] = base + at
        spans[channel] = Span(head.start_ns, head.end_ns, len(entries))
        at = index.end
    chunk = _chunk_index(record, head, base, offsets, base + at)
    start = base + record.start
    found.pieces.append(Piece(Opcode.CHUNK, start, buffer[record.start : at], b"", chunk, spans))
    return at


def _chunk_index(
    record: Record, head: ChunkHead, base: int, offsets: dict[int, int], end: int
) -> ChunkIndex:
    """Return the index of a chunk whose message indexes end at byte ``end`` of the file."""
    return ChunkIndex(
        message_start_time=head.start_ns,
        message_end_time=head.end_ns,
        chunk_start_offset=base + record.start,
        chunk_length=record.end - record.start,
        message_index_offsets=offsets,
        message_index_length=end - (base + record.end),
        compression=head.compression,
        compressed_size=len(head.packed),
        uncompressed_size=head.size,
    )


def _message_indexes(
    buffer: memoryview, start: int, messages: Mapping[int, tuple[Times, Times]]
) -> tuple[dict[int, bytes], int | None]:
    """Return the message indexes of a chunk by channel, and their end if the file has them all.

    They may have any order, of channels and of entries; if one is missing or differs, all are
    rebuilt.
    """
    in_file: dict[int, bytes] = {}
    at = start
    try:
        while (record := record_at(buffer, at)).opcode == Opcode.MESSAGE_INDEX:
            channel, entries = parse_message_index(record.content)
            if channel in messages and same_entries(entries, messages[channel]):
                in_file[channel] = bytes(buffer[record.start : record.end])
            elif len(entries):
                break
            at = record.end
    except Malformed:
        at = len(buffer)
    if in_file.keys() == messages.keys():
        return in_file, start + sum(map(len, in_file.values()))
    rebuilt = {channel: build_message_index(channel, *entry) for channel, entry in messages.items()}
    return rebuilt, None
