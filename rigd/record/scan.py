"""Walks a recording from its start and checks every byte: what recovery and appending build on.

Unpacking all chunks of a long file takes minutes. Whoever has written the first bytes of it himself
and knows that no crash of the machine came since may call those *trusted*: their chunks are taken
by what their heads and message indexes say, ten times as fast.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    ChunkIndex,
    Header,
    Metadata,
    MetadataIndex,
)

from rigd.record.chunks import (
    ChunkHead,
    Times,
    build_message_index,
    index_messages,
    parse_chunk,
    parse_message_index,
    same_entries,
    uniform_messages,
    unpack_chunk,
)
from rigd.record.contents import Contents, add_record, parse_footer
from rigd.record.crc import crc32
from rigd.record.wire import DATA_END, FOOTER, MAGIC, Malformed, Record, decode, record_at, records


@dataclass
class Scan:
    """What the start of a file holds up to the first damage.

    ``data_end`` is where the sound data ends and ``data_crc`` the CRC up to there;
    ``missing_index`` has to be written at ``data_end`` for the last chunk to be complete.
    ``trusted`` are bytes at the start of the file whose chunks need no unpacking.
    """

    contents: Contents = field(default_factory=Contents)
    data_end: int = 0
    data_crc: int = 0
    missing_index: bytes = b""
    problem: str = ""
    library: str = ""  #: what wrote the file
    trusted: int = 0

    @property
    def intact(self) -> bool:
        """Whether nothing is wrong with the file."""
        return not self.problem


def scan(buffer: memoryview, trusted: int = 0) -> Scan:
    """Walk a whole file, of which the first ``trusted`` bytes are known to be sound.

    Raises:
        Malformed: it does not even begin like an MCAP file.

    """
    if bytes(buffer[: len(MAGIC)]) != MAGIC:
        raise Malformed("the file does not begin like an MCAP file")
    found = Scan(data_end=len(MAGIC), trusted=trusted)
    try:
        header = record_at(buffer, len(MAGIC))
        if header.opcode != Opcode.HEADER:
            raise Malformed("the file has no header")
        found.library = decode(Header, header.content).library
        found.data_end = header.end
        walk(buffer, found)
        found.data_crc = crc32(buffer[: found.data_end])
        _check_end(buffer, found)
    except Malformed as error:
        found.problem = str(error)
        found.data_crc = crc32(buffer[: found.data_end])
    return found


def walk(buffer: memoryview, found: Scan, base: int = 0) -> None:
    """Take records from ``found.data_end`` on into ``found``, up to DataEnd or the buffer's end.

    The buffer begins at byte ``base`` of the file.

    Raises:
        Malformed: at the first record that is damaged; ``found`` has all before it.

    """
    while found.data_end < base + len(buffer):
        record = record_at(buffer, found.data_end - base)
        if record.opcode == Opcode.DATA_END:
            return
        if record.opcode == Opcode.CHUNK:
            if base + record.end < found.trusted:
                _take_trusted_chunk(buffer, record, found, base)
            else:
                _take_chunk(buffer, record, found, base)
            continue
        if record.opcode == Opcode.MESSAGE:
            raise Malformed("a message outside of a chunk, which rigd does not write or index")
        if record.opcode in (0, Opcode.FOOTER):
            raise Malformed(f"no record begins at byte {found.data_end}")
        _take_small(record, found, base)
        found.data_end = base + record.end


def _take_small(record: Record, found: Scan, base: int) -> None:
    start, length = base + record.start, record.end - record.start
    if record.opcode == Opcode.ATTACHMENT:
        if crc32(record.content[:-4]) != int.from_bytes(record.content[-4:], "little"):
            raise Malformed("an attachment whose CRC does not match its data")
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
        name = decode(Metadata, record.content).name
        found.contents.metadata.append(MetadataIndex(start, length, name))
    else:
        add_record(found.contents, record.opcode, record.content)


def _take_chunk(buffer: memoryview, record: Record, found: Scan, base: int) -> None:
    head = parse_chunk(record.content)
    data = unpack_chunk(head)
    if uniform_messages(data) is None:
        # Other writers keep schemas and channels within the chunk that first needs them.
        for inner in records(memoryview(data)):
            add_record(found.contents, inner.opcode, inner.content)
    messages = index_messages(data)
    unknown = messages.keys() - found.contents.channels.keys()
    if unknown:
        raise Malformed(f"a chunk of channel {min(unknown)}, which the file does not define")
    index, sound_end = _message_indexes(buffer, record.end, messages)
    offsets: dict[int, int] = {}
    at = base + record.end
    for channel, encoded in index.items():
        offsets[channel] = at
        at += len(encoded)
    found.contents.chunks.append(_chunk_index(record, head, base, offsets, at))
    for channel, (times, _) in messages.items():
        found.contents.add_messages(channel, len(times), int(times.min()), int(times.max()))
    if sound_end is None:
        found.data_end = base + record.end
        found.missing_index = b"".join(index.values())
        raise Malformed(f"the message index of the chunk at byte {base + record.start} is damaged")
    found.data_end = base + sound_end


def _take_trusted_chunk(buffer: memoryview, record: Record, found: Scan, base: int) -> None:
    head = parse_chunk(record.content)
    offsets: dict[int, int] = {}
    at = record.end
    while base + at < found.trusted:
        index = record_at(buffer, at)
        if index.opcode != Opcode.MESSAGE_INDEX:
            break
        channel, entries = parse_message_index(index.content)
        offsets[channel] = base + at
        found.contents.add_messages(channel, len(entries), head.start_ns, head.end_ns)
        at = index.end
    found.contents.chunks.append(_chunk_index(record, head, base, offsets, base + at))
    found.data_end = base + at


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

    They may stand in any order, of channels and of entries; where one is missing or says
    something else, all are rebuilt.
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


def _check_end(buffer: memoryview, found: Scan) -> None:
    """Check DataEnd, summary and footer, which must be all that follows.

    Raises:
        Malformed: they are missing or damaged.

    """
    if found.data_end + DATA_END.size > len(buffer):
        raise Malformed("the file was cut short: its summary is missing")
    _, _, crc = DATA_END.unpack_from(buffer, found.data_end)
    if crc and crc != found.data_crc:
        raise Malformed("the CRC of the data section does not match")
    summary_start, summary_crc = parse_footer(buffer)
    if summary_start != found.data_end + DATA_END.size:
        raise Malformed("the summary does not follow the data")
    if summary_crc and crc32(buffer[summary_start : -len(MAGIC) - 4]) != summary_crc:
        raise Malformed("the CRC of the summary does not match")
    if summary_start > len(buffer) - len(MAGIC) - FOOTER.size:
        raise Malformed("the summary is cut short")
