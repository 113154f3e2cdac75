"""Walks over the records of a file of another program."""

from __future__ import annotations

import re
import struct
from collections import Counter
from collections.abc import Mapping
from typing import Final

from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, Header, McapRecord, Schema

from rigd.record.events.event import parse_event
from rigd.record.events.gaps import Gap, Span
from rigd.record.mcap.chunks import (
    MESSAGE_HEAD,
    ChunkHead,
    Times,
    index_messages,
    message_places,
    parse_chunk,
    parse_message_index,
    same_entries,
    uniform_messages,
    wrap_messages,
)
from rigd.record.mcap.compression import COMPRESSIONS
from rigd.record.mcap.crc import crc32
from rigd.record.mcap.schema import EVENTS_STREAM, EVENTS_TOPIC, EVENTS_TYPE
from rigd.record.mcap.wire import FRAME, MAGIC, Malformed, Record, decode, record_at
from rigd.record.scan.chunk_head import open_chunk, span_of_index, spans_of
from rigd.record.scan.duplicates import doubles
from rigd.record.scan.findings import Damage, Piece, Scan, collect
from rigd.record.scan.next_record import begin_of_another, ends_data
from rigd.record.scan.others.losses import lost_rows
from rigd.record.scan.others.parts import (
    check_other,
    moved_index,
    read_ending,
    with_index,
)
from rigd.record.scan.walk import take_small

#: Opcodes of the data section, each with a length below 4 GiB behind it.
_BEGINNING: Final = re.compile(rb"[\x03-\x07\x09\x0c\x0f](?=[\s\S]{4}\x00{4})")
#: Records of a summary: one of them ends the data if there is no DataEnd.
_OF_SUMMARY: Final = (
    Opcode.FOOTER, Opcode.CHUNK_INDEX, Opcode.ATTACHMENT_INDEX, Opcode.STATISTICS,
    Opcode.METADATA_INDEX, Opcode.SUMMARY_OFFSET,
)  # fmt: skip
#: Messages outside of chunks are read in parts of this size, in bytes.
_RUN_BYTES: Final = 1 << 20
#: A message has no CRC: it is believed if so many records follow it, one at the end of the other.
_CHAIN: Final = 3
_LEAST_MESSAGE: Final = MESSAGE_HEAD.itemsize - FRAME.size
_KEPT_PAYLOAD: Final = 1 << 16  #: of the first message of a channel, in bytes


class Walk:
    """A walk over all records of a file."""

    def __init__(self, buffer: memoryview) -> None:
        self.whole = buffer
        self.found = Scan(data_end=len(MAGIC), others=True)
        self.ending = read_ending(buffer)
        self.buffer = buffer[: self.ending.limit]
        self.known = dict(self.ending.summary.channels) if self.ending.summary else {}
        self.torn: list[tuple[int, int]] = []  #: ranges whose records are lost
        self.orphans: dict[int, list[tuple[int, Span]]] = {}  #: offset and span, by channel
        self.last_loose = -1  #: start of the last message outside of chunks, if nothing follows it
        self.lacking: Counter[str] = Counter()
        self.spoilt: list[Gap] = []  #: events that cannot be read

    def run(self) -> None:
        """Take all of the file into ``found``.

        Raises:
            Malformed: it contains no intact record.
        """
        found = self.found
        self._head()
        at = self._data(found.data_end)
        after = self._end(at)
        for start, end in [*self.torn, (after, len(self.whole))]:
            if found.another is None:
                found.another = begin_of_another(self.whole, start, end)
        if found.another is not None:
            return
        if not found.pieces:
            raise Malformed("it does not begin like an MCAP file, and nothing in it is like one")
        collect(found)
        self._summary(after)
        self._define()
        found.lost = tuple(
            lost_rows(found, self.ending.summary, self.torn, self.orphans, self.spoilt)
        )
        found.doubled = doubles(found)
        found.lacks = self._lacks()
        found.damages.sort()
        found.data_end = min((damage.start for damage in found.damages), default=at)
        found.data_crc = crc32(self.whole[: found.data_end])

    def _head(self) -> None:
        found, buffer = self.found, self.buffer
        try:
            if bytes(buffer[: len(MAGIC)]) != MAGIC:
                raise Malformed("the file does not begin like an MCAP file")
            header = record_at(buffer, len(MAGIC))
            if header.opcode != Opcode.HEADER:
                raise Malformed("the file has no header")
            found.library = decode(Header, header.content).library
        except Malformed as error:
            found.data_end = self._next_sound(0)
            self._damaged(0, found.data_end, str(error))
            return
        found.data_end = header.end
        found.pieces.append(Piece(Opcode.HEADER, 0, buffer[: header.end]))

    def _data(self, at: int) -> int:
        """Take all records of the data section from ``at`` on; return where it ends."""
        while at < len(self.buffer):
            try:
                if at + FRAME.size > len(self.buffer):
                    raise Malformed(f"the file ends within a record at byte {at}")
                opcode = self.buffer[at]
                if opcode == Opcode.DATA_END or opcode in _OF_SUMMARY:
                    if self._ends(at):
                        return at
                    raise Malformed("the end of the data is not followed by the end of the file")
                at = self._messages(at) if opcode == Opcode.MESSAGE else self._record(at)
                continue
            except Malformed as error:
                problem = str(error)  # the error itself holds the unpacked bytes of its chunk
            at = self._pass_over(at, problem)
        return at

    def _ends(self, at: int) -> bool:
        """Return whether the record at ``at`` is the first behind the data."""
        record = record_at(self.whole, at)
        if record.opcode != Opcode.DATA_END:
            return self.ending.start == 0 or bool(self.ending.problem)
        return len(record.content) >= 4 and ends_data(self.whole, record)

    def _end(self, at: int) -> int:
        """Check DataEnd at byte ``at``; return the byte behind it."""
        try:
            record = record_at(self.whole, at)
        except Malformed:
            return at
        if record.opcode != Opcode.DATA_END:
            self.lacking["the end of the data (DataEnd)"] = 1
            return at
        crc = int.from_bytes(record.content[:4], "little")
        if not crc:
            self.lacking["the CRC of the data section"] = 1
        elif crc != crc32(self.whole[:at]) and not self.found.damages:
            problem = "the CRC of the data section does not match, though that of every chunk does"
            self._damaged(at, record.end, problem)
        return record.end

    def _record(self, at: int) -> int:
        """Take the record at ``at``, which is no message; return where the next begins."""
        record, found = record_at(self.buffer, at), self.found
        self.last_loose = -1
        if record.opcode == Opcode.CHUNK:
            return self._chunk(record)
        if record.opcode == Opcode.MESSAGE_INDEX:  # of a chunk that is lost
            channel, span = span_of_index(record.content)
            if span is not None:
                self.orphans.setdefault(channel, []).append((at, span))
            return record.end
        if record.opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            self._definition(record.opcode, record.content, at, record.end)
        elif record.opcode in (Opcode.ATTACHMENT, Opcode.METADATA):
            check_other(record)
            take_small(record, found, 0)
        elif record.opcode in (0, Opcode.HEADER):
            raise Malformed(f"no record begins at byte {at}")
        else:
            if not self._chained(record.end, 1):
                raise Malformed(f"a record of the unknown kind {record.opcode:#04x}")
            found.unknown[record.opcode] = found.unknown.get(record.opcode, 0) + 1
        found.pieces.append(Piece(record.opcode, at, self.buffer[at : record.end]))
        return record.end

    def _definition(self, opcode: int, content: memoryview, at: int, end: int) -> None:
        """Take a schema or channel; the first of a number holds, another one is damage."""
        kind: type[Schema] | type[Channel] = Schema if opcode == Opcode.SCHEMA else Channel
        record, contents = decode(kind, content), self.found.contents
        held: Mapping[int, McapRecord] = (
            contents.schemas if isinstance(record, Schema) else contents.channels
        )
        if held.get(record.id, record) != record:
            problem = f"{kind.__name__.lower()} {record.id} differs from its earlier definition"
            self._damaged(at, end, problem)
            return
        if isinstance(record, Channel):
            contents.channels[record.id] = record
            self.known.setdefault(record.id, record)
        elif isinstance(record, Schema):
            contents.schemas[record.id] = record

    def _messages(self, start: int) -> int:
        """Take the messages outside of chunks that begin at ``start``."""
        buffer, at, last = self.buffer, start, start
        while at + FRAME.size <= len(buffer) and at - start < _RUN_BYTES:
            opcode, length = FRAME.unpack_from(buffer, at)
            if (
                opcode != Opcode.MESSAGE
                or not _LEAST_MESSAGE <= length <= len(buffer) - at - FRAME.size
            ):
                break
            last, at = at, at + FRAME.size + length
        if at == start:
            raise Malformed("a message that is too short, or longer than the file")
        self._add_run(start, at)
        self.last_loose = last
        return at

    def _add_run(self, start: int, end: int) -> None:
        data = self.buffer[start:end]
        messages = index_messages(data)
        wrapped = wrap_messages(data, messages)
        self._note(data, messages)
        self.found.contents.loose.add(start)
        self.lacking["chunks, with CRC and index"] += wrapped.count
        self.found.pieces.append(
            Piece(
                Opcode.MESSAGE,
                start,
                data,
                bytes(wrapped.parts[2]),
                wrapped.index_at(start),
                spans_of(data, messages),
                head=bytes(wrapped.parts[0]),
            )
        )

    def _chunk(self, record: Record) -> int:
        """Take a chunk and the message indexes behind it."""
        try:
            opened = open_chunk(record.content)
        except Malformed:
            if (stated := parse_chunk(record.content)).compression in COMPRESSIONS:
                raise
            return self._unread_chunk(record, stated)
        head, data, messages = opened.head, opened.data, opened.messages
        wrapped = wrap_messages(memoryview(data), messages)
        if opened.problem:
            self._damaged(record.start, record.end, opened.problem)
        self.lacking["the times of chunks"] += opened.untimed
        self.lacking["the CRC of chunks"] += not head.crc and len(data) > 0
        self._inner(record, memoryview(data))
        end, complete = self._index(record.end, messages)
        chunk, index = moved_index(record, head, wrapped), bytes(wrapped.parts[2])
        if complete:
            index, chunk = b"", with_index(chunk, self.buffer, record.end, end)
        piece = opened.mended(self.buffer[record.start : end if complete else record.end])
        spans = opened.spans
        self.found.pieces.append(Piece(Opcode.CHUNK, record.start, piece, index, chunk, spans))
        self._note(data, messages)
        return end

    def _inner(self, record: Record, data: memoryview) -> None:
        """Take the records of a chunk that are no messages: schemas, channels, unknown ones."""
        if uniform_messages(data) is not None:
            return
        for at in message_places(data).others.tolist():
            inner = record_at(data, at)
            if inner.opcode not in (Opcode.SCHEMA, Opcode.CHANNEL):
                self.found.unknown[inner.opcode] = self.found.unknown.get(inner.opcode, 0) + 1
                continue
            try:
                self._definition(inner.opcode, inner.content, record.start, record.end)
            except Malformed as error:
                self._damaged(record.start, record.end, str(error))

    def _unread_chunk(self, record: Record, head: ChunkHead) -> int:
        """Keep a chunk whose compression rigd does not know, with the indexes behind it."""
        at, rows = record.end, 0
        try:
            while (index := record_at(self.buffer, at)).opcode == Opcode.MESSAGE_INDEX:
                rows += len(parse_message_index(index.content)[1])
                at = index.end
        except Malformed:
            pass
        counted = f" with {rows} messages" if rows else ""
        self.found.unread.append(
            f"a chunk at byte {record.start}{counted}, compressed with {head.compression!r}"
        )
        self.found.pieces.append(Piece(Opcode.CHUNK, record.start, self.buffer[record.start : at]))
        return at

    def _index(self, start: int, messages: Mapping[int, tuple[Times, Times]]) -> tuple[int, bool]:
        """Return the end of the message indexes behind a chunk, and whether they name all of it."""
        at, named = start, set()
        try:
            while (record := record_at(self.buffer, at)).opcode == Opcode.MESSAGE_INDEX:
                channel, entries = parse_message_index(record.content)
                if len(entries):
                    if channel not in messages or not same_entries(entries, messages[channel]):
                        raise Malformed("a message index that is not that of its chunk")
                    named.add(channel)
                at = record.end
        except Malformed as error:
            if at < len(self.buffer) and self.buffer[at] == Opcode.MESSAGE_INDEX:
                after = self._next_sound(at)
                self._damaged(at, after, str(error))
                return after, False
        if named != messages.keys():
            self.lacking["the message index of chunks"] += 1
            return at, False
        return at, True

    def _note(self, data: bytes | memoryview, messages: Mapping[int, tuple[Times, Times]]) -> None:
        """Note the times of messages, and the first message of each channel."""
        for channel, (times, offsets) in messages.items():
            self.found.times.setdefault(channel, []).append(times)
            if channel not in self.found.firsts and len(offsets):
                message = record_at(memoryview(data), int(offsets[0])).content
                payload = message[_LEAST_MESSAGE : _LEAST_MESSAGE + _KEPT_PAYLOAD]
                self.found.firsts[channel] = bytes(payload)
            if self._has_events(channel):
                self._check_events(memoryview(data), times, offsets)

    def _has_events(self, channel: int) -> bool:
        """Return whether a channel has the events of rigd."""
        known, contents = self.known.get(channel), self.found.contents
        if known is None or (known.topic, known.message_encoding) != (EVENTS_TOPIC, "cdr"):
            return False
        schema = contents.schemas.get(known.schema_id)
        return schema is not None and schema.name == EVENTS_TYPE

    def _check_events(self, data: memoryview, times: Times, offsets: Times) -> None:
        """Note the events that cannot be read: no CRC covers those outside of chunks."""
        for t_ns, offset in zip(times.tolist(), offsets.tolist(), strict=True):
            try:
                parse_event(t_ns, record_at(data, offset).content[_LEAST_MESSAGE:])
            except Malformed as error:
                self._damaged(0, 0, f"an event that cannot be read: {error}")
                self.spoilt.append(Gap(EVENTS_STREAM, t_ns, t_ns, 1))

    def _damaged(self, start: int, end: int, problem: str) -> None:
        self.found.damages.append(Damage(start, end, problem))

    def _pass_over(self, at: int, problem: str) -> int:
        """Note the damage at ``at``; return where the next sound record begins.

        A message has no CRC. If the one before ``at`` has a wrong length, records begin within it.
        """
        start, found = at, self.found
        if self.last_loose >= 0:
            inside = self._next_sound(self.last_loose + 1, at)
            if inside < at:
                start, piece = self.last_loose, found.pieces.pop()
                found.contents.loose.discard(piece.start)
                self.lacking["chunks, with CRC and index"] -= sum(
                    span.count for span in piece.spans.values()
                )
                for channel in piece.spans:
                    found.times[channel].pop()
                if start > piece.start:
                    self._add_run(piece.start, start)
                self.last_loose = -1
                self._damaged(start, inside, "a message whose length is wrong")
                self.torn.append((start, inside))
                return inside
        try:
            end = record_at(self.buffer, at).end
        except Malformed:
            end = len(self.buffer) + 1
        after = end if self._sound(end) else self._next_sound(at + 1)
        self.last_loose = -1
        self._damaged(start, after, problem)
        self.torn.append((start, after))
        return after

    def _next_sound(self, start: int, limit: int | None = None) -> int:
        """Return the first place from ``start`` on where a sound record begins, or the end."""
        end = len(self.buffer) if limit is None else limit
        for match in _BEGINNING.finditer(self.buffer, start, min(end + 8, len(self.buffer))):
            if match.start() < end and self._sound(match.start()):
                return match.start()
        return end

    def _sound(self, at: int) -> bool:
        """Return whether a record that can be believed begins at ``at``."""
        if at == len(self.buffer):
            return True
        try:
            record = record_at(self.buffer, at)
            if record.opcode == Opcode.MESSAGE:
                (channel,) = struct.unpack_from("<H", record.content)
                believed = len(record.content) >= _LEAST_MESSAGE and channel in self.known
                return believed and self._chained(record.end, _CHAIN)
            if record.opcode == Opcode.DATA_END:
                return self._ends(at)
            check_other(record)
        except (Malformed, struct.error):
            return False
        return record.opcode != Opcode.MESSAGE_INDEX or self._chained(record.end, 1)

    def _chained(self, at: int, most: int) -> bool:
        """Return whether records follow one another from ``at``, ``most`` or up to the end."""
        for _ in range(most):
            if at == len(self.buffer):
                return True
            try:
                record = record_at(self.buffer, at)
            except Malformed:
                return False
            if not (0 < record.opcode <= Opcode.DATA_END or record.opcode >= 0x80):
                return False
            at = record.end
        return True

    def _summary(self, after: int) -> None:
        """Take what the summary defines, and check the rest of it, which begins at ``after``."""
        found, ending = self.found, self.ending
        if ending.problem:
            self._damaged(min(after, len(self.whole)), len(self.whole), ending.problem)
        if ending.summary is None:
            if not ending.problem:
                self.lacking["the summary"] = 1
            return
        found.summary = True
        summary, contents = ending.summary, found.contents
        differ = [
            f"schema {number}"
            for number, schema in summary.schemas.items()
            if contents.schemas.setdefault(number, schema) != schema
        ]
        differ += [
            f"channel {number}"
            for number, channel in summary.channels.items()
            if contents.channels.setdefault(number, channel) != channel
        ]
        for what in differ:
            problem = f"{what} in the summary differs from that in the data"
            self._damaged(ending.start, len(self.whole), problem)
        if after < ending.start:
            problem = "bytes between the data and the summary"
            self._damaged(after, ending.start, problem)
        held = {piece.start: piece for piece in found.pieces if piece.opcode == Opcode.CHUNK}
        for index in summary.chunks:
            if not self._agrees(index, held.get(index.chunk_start_offset)):
                problem = (
                    f"its index names a chunk at byte {index.chunk_start_offset}, which is another"
                )
                self._damaged(ending.start, len(self.whole), problem)
        if len(summary.chunks) < len(held):
            self.lacking["the index of chunks"] = len(held) - len(summary.chunks)
        if not summary.counts:
            self.lacking["statistics"] = 1
        elif summary.messages != contents.messages and not (self.torn or found.unread):
            problem = (
                f"its statistics state {summary.messages} messages, it has {contents.messages}"
            )
            self._damaged(ending.start, len(self.whole), problem)

    def _agrees(self, index: ChunkIndex, piece: Piece | None) -> bool:
        if piece is None:
            at = index.chunk_start_offset
            return any(start <= at < end for start, end in self.torn)
        chunk = piece.chunk
        return chunk is None or (chunk.chunk_length, chunk.uncompressed_size) == (
            index.chunk_length,
            index.uncompressed_size,
        )

    def _define(self) -> None:
        """Give a channel to messages that have none, so that they are kept."""
        contents = self.found.contents
        for number in sorted(contents.counts.keys() - contents.channels.keys()):
            contents.channels[number] = Channel(number, f"/unnamed_{number}", "", {}, 0)
            problem = f"channel {number} is not defined: its messages are kept as /unnamed_{number}"
            self._damaged(0, 0, problem)

    def _lacks(self) -> tuple[str, ...]:
        counted = {"the CRC of chunks", "the message index of chunks", "the index of chunks"}
        return tuple(
            f"{what} ({count})" if what in counted else what
            for what, count in self.lacking.items()
            if count > 0
        )
