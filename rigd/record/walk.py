"""Iterates over the records of a file and skips damaged ones."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    ChunkIndex,
    Header,
    Metadata,
    MetadataIndex,
    Schema,
)

from rigd.record.chunks import (
    MESSAGE_HEAD,
    ChunkHead,
    Times,
    begin_of_chunk,
    build_message_index,
    first_number,
    index_messages,
    message_places,
    parse_chunk,
    parse_message_index,
    parse_torn_chunk,
    same_entries,
    uniform_messages,
    unpack_chunk,
)
from rigd.record.contents import Contents, add_record
from rigd.record.gaps import Gap, Span, find_gaps, gaps_from_json, silent_end
from rigd.record.plausible import (
    check_index_end,
    check_record,
    ends_data,
    is_sound,
    next_record,
)
from rigd.record.prefix import (
    FORMAT_METADATA,
    GAPS_KEY,
    RECOVERY_METADATA,
    START_KEY,
)
from rigd.record.schema import EVENTS_TOPIC, TRIAL_TOPIC
from rigd.record.wire import FRAME, MAGIC, Malformed, Record, decode, encode, record_at, records


class Damage(NamedTuple):
    """Bytes ``start`` to ``end`` of a file that are not valid, and the reason.

    Of a file that lacks something as a whole, both are 0.
    """

    start: int
    end: int
    problem: str

    def __str__(self) -> str:
        """Return the place and the damage."""
        return f"bytes {self.start} to {self.end}: {self.problem}" if self.end else self.problem


@dataclass(frozen=True)
class Piece:
    """Valid bytes of a data section: one record, and after a chunk its message indexes.

    ``index`` are message indexes that must be written again, ``spans`` the messages by channel.
    ``head`` makes a chunk of messages that are outside of chunks.
    """

    opcode: int
    start: int
    data: memoryview
    index: bytes = b""
    chunk: ChunkIndex | None = None
    spans: Mapping[int, Span] = field(default_factory=dict)
    head: bytes = b""

    @property
    def end(self) -> int:
        """Byte behind it."""
        return self.start + len(self.data)


@dataclass
class Scan:
    """The valid parts and the damaged parts of a file.

    ``data_end`` is the start of the first damage, or else the end of the data, and ``data_crc`` the
    CRC up to there. ``indexed`` are messages that indexes name, by channel. ``trusted`` are bytes
    at the start whose chunks need no unpacking.
    """

    contents: Contents = field(default_factory=Contents)
    data_end: int = 0
    data_crc: int = 0
    damages: list[Damage] = field(default_factory=list)
    library: str = ""  #: what wrote the file; empty if its header is damaged
    trusted: int = 0
    pieces: list[Piece] = field(default_factory=list)
    indexed: dict[int, list[Span]] = field(default_factory=dict)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    summary: bool = False  #: whether the summary is sound
    data_sound: bool = False  #: whether the CRC of the data section holds
    another: int | None = None  #: byte where another recording begins, behind this one
    end_unknown: bool = False  #: whether rows may be lost at the end, in addition to those listed
    others: bool = False  #: whether another program wrote the file
    unlike: bool = False  #: whether it is not laid out as rigd does it, whatever its header says
    lost: tuple[Gap, ...] = ()  #: of a file of others: the rows that are lost
    times: dict[int, list[Times]] = field(default_factory=dict)  #: the same: those of each channel
    firsts: dict[int, bytes] = field(default_factory=dict)  #: the same: first content of a channel
    doubled: dict[str, int] = field(default_factory=dict)  #: messages that stand there again
    lacks: tuple[str, ...] = ()  #: what rigd would have written
    unread: list[str] = field(default_factory=list)  #: what rigd cannot read, in words
    unknown: dict[int, int] = field(default_factory=dict)  #: records of unknown kinds, by opcode

    @property
    def intact(self) -> bool:
        """Whether the file has no damage."""
        return not self.damages

    @property
    def problem(self) -> str:
        """The first problem; empty if there is none."""
        return self.damages[0].problem if self.damages else ""

    @property
    def behind(self) -> list[Piece]:
        """Sound pieces behind the first damage."""
        return [piece for piece in self.pieces if piece.end > self.data_end]

    @property
    def missing_index(self) -> bytes:
        """The bytes that complete the last chunk before ``data_end``, to be written there."""
        before = [piece for piece in self.pieces if piece.end == self.data_end]
        return before[-1].index if before else b""

    @property
    def start_ns(self) -> int:
        """When the recording began; if that is lost, its first message."""
        text = self.metadata.get(FORMAT_METADATA, {}).get(START_KEY, "")
        return int(text) if text.isdecimal() else self.contents.start_ns

    def gaps(self) -> tuple[Gap, ...]:
        """Return the lost rows, including those that an earlier repair noted."""
        if self.others:
            return self.lost  # other programs may number their messages differently
        try:
            known = gaps_from_json(self.metadata.get(RECOVERY_METADATA, {}).get(GAPS_KEY, "[]"))
        except ValueError:
            known = ()
        found: list[Gap] = []
        for number, channel in self.contents.channels.items():
            if channel.topic == TRIAL_TOPIC:  # the events have all of it
                continue
            held = [piece.spans[number] for piece in self.pieces if number in piece.spans]
            indexed = self.indexed.get(number, [])
            found += find_gaps(channel.topic, held, indexed, known, self.start_ns)
            if self.end_unknown and not self.summary and channel.topic != EVENTS_TOPIC:
                found += silent_end(channel.topic, held, self.contents.end_ns)
        return tuple(sorted(found, key=lambda gap: (gap.start_ns, gap.stream)))


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


def collect(found: Scan) -> None:
    """Make the index of the chunks that are held."""
    contents = found.contents
    contents.chunks = [piece.chunk for piece in found.pieces if piece.chunk is not None]
    contents.counts = {}
    contents.start_ns = contents.end_ns = 0
    for piece in found.pieces:
        for channel, span in piece.spans.items():
            contents.add_messages(channel, span.count, span.start_ns, span.end_ns)


def drop_copies(found: Scan) -> None:
    """Remove chunks whose messages a longer chunk also contains.

    An interrupted flush leaves the earlier open chunk after the longer chunk that replaces it.
    """
    longest: dict[tuple[int, int, int], int] = {}
    for piece in found.pieces:
        for key, count in _keys(piece):
            longest[key] = max(count, longest.get(key, 0))
    kept: list[Piece] = []
    for piece in found.pieces:
        keys = _keys(piece)
        if keys and all(longest.get(key, 0) != count for key, count in keys):
            continue
        for key, _ in keys:
            longest.pop(key, None)  # of two that are equal, the first is kept
        kept.append(piece)
    found.pieces = kept
    collect(found)


def _keys(piece: Piece) -> list[tuple[tuple[int, int, int], int]]:
    """Return the identity of the first message of each channel, with the number of messages."""
    return [
        ((channel, span.first, span.start_ns), span.count)
        for channel, span in piece.spans.items()
        if span.first is not None
    ]


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
        attachment = decode(Attachment, record.content)
        found.contents.attachments.append(
            AttachmentIndex(
                offset=start,
                length=length,
                log_time=attachment.log_time,
                create_time=attachment.create_time,
                data_size=len(attachment.data),
                name=attachment.name,
                media_type=attachment.media_type,
            )
        )
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
    channel, entries = parse_message_index(record.content)
    if len(entries):
        times = entries[:, 0]
        span = Span(int(times.min()), int(times.max()), len(entries))
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
    head = parse_chunk(record.content)
    data = unpack_chunk(head)
    messages = index_messages(data)
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
    spans = {
        channel: Span(int(times.min()), int(times.max()), len(times), first_number(data, channel))
        for channel, (times, _) in messages.items()
    }
    _check_times(head, spans)
    end = record.end if sound_end is None else sound_end
    found.pieces.append(
        Piece(
            Opcode.CHUNK,
            base + record.start,
            buffer[record.start : end],
            b"" if sound_end is not None else b"".join(index.values()),
            _chunk_index(record, head, base, offsets, at),
            spans,
        )
    )
    if sound_end is not None:
        return sound_end
    after = _behind_index(buffer, record.end)
    problem = f"the message index of the chunk at byte {base + record.start} is damaged"
    found.damages.append(Damage(base + end, base + after, problem))
    return after


def _check_times(head: ChunkHead, spans: Mapping[int, Span]) -> None:
    """Check the times that a chunk gives itself, which its CRC does not cover.

    Raises:
        Malformed: they are not those of its messages.

    """
    if not spans:
        return
    first = min(span.start_ns for span in spans.values())
    if (head.start_ns, head.end_ns) != (first, max(span.end_ns for span in spans.values())):
        raise Malformed("a chunk whose times are not those of its messages")


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
    buffer: memoryview, start: int, messages: dict[int, tuple[Times, Times]]
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
