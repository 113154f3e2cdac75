"""Reads what a list of runs shows, from the end of a file: a tenth of the cost of all its index.

A catalogue of thousands of recordings is made from this. What is unusual (damage, rows that a
repair noted as lost, the layout of another program) is left to
:class:`~rigd.record.read.reader.Recording`.
"""

from __future__ import annotations

import json
import os
import struct
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Final, NamedTuple

from mcap.opcode import Opcode

from rigd.model import RecordingError
from rigd.model.machine.system import read_at
from rigd.record.events.event import MESSAGE_FIELDS, Event, parse_event
from rigd.record.events.trials import trials
from rigd.record.mcap.access import require_regular
from rigd.record.mcap.bounds import require_events
from rigd.record.mcap.chunks import parse_chunk, unpack_chunk
from rigd.record.mcap.contents import parse_footer
from rigd.record.mcap.crc import crc32
from rigd.record.mcap.prefix import FORMAT_METADATA, RECOVERY_METADATA, START_KEY
from rigd.record.mcap.schema import EVENTS_TOPIC
from rigd.record.mcap.wire import FOOTER, FRAME, MAGIC, Malformed, record_at
from rigd.record.read.index import bytes_at, record_in
from rigd.record.read.info import RunInfo, info_of
from rigd.record.read.reader import Recording

#: Of a chunk index: first and last time, offset, length, bytes of the map, its first channel.
_CHUNK: Final = struct.Struct("<QQQQIH")
_ENTRY_BYTES: Final = 10  #: of the map of a chunk with one channel
_INDEX_BYTES_AT: Final = 36 + _ENTRY_BYTES
_MESSAGES: Final = struct.Struct("<Q")
_TIMES_AT: Final = 26  #: of the statistics: after the number of messages and the counts
_TIMES: Final = struct.Struct("<QQ")
_LENGTH: Final = struct.Struct("<I")
_PLACE: Final = struct.Struct("<QQ")
#: What begins the kind of an event that :func:`~rigd.record.events.trials.trials` and
#: :func:`~rigd.record.read.info.run_state` read; the kind stands behind the header and its length.
_KINDS: Final = (b"run_", b"trial_", b"answer")
_KIND_END: Final = 14
#: Records that follow one another are read together up to this size, in bytes.
_AT_ONCE: Final = 64 * 1024


#: Longer texts are not kept: an event may have megabytes.
_KEPT_LETTERS: Final = 1000


class _Unusual(Exception):
    """The file is not what rigd writes at the end of an undisturbed run."""


def brief_info(path: Path) -> RunInfo:
    """Return the summary of a recording without its streams and attachments.

    Raises:
        RecordingError: missing, empty, cut short, damaged, or no MCAP file.
    """
    try:
        require_regular(path)
        with path.open("rb", buffering=0) as file:
            return _read(file.fileno(), path)
    except (_Unusual, Malformed, OSError, struct.error, UnicodeDecodeError, RecordingError):
        return Recording.open(path).info


def _read(fd: int, path: Path) -> RunInfo:
    size, ending = os.fstat(fd).st_size, FOOTER.size + len(MAGIC)
    if size < ending or read_at(fd, len(MAGIC), 0) != MAGIC:
        raise _Unusual
    tail_at = max(size - 64 * 1024, 0)  # one read has all of most summaries
    tail = memoryview(read_at(fd, size - tail_at, tail_at))
    start, crc = parse_footer(tail[-ending:])
    if not len(MAGIC) <= start <= size - ending:
        raise _Unusual
    if start >= tail_at:
        summary = tail[start - tail_at :]
    else:
        summary = memoryview(read_at(fd, size - start, start))
    if not crc or crc32(summary[: -len(MAGIC) - 4]) != crc:
        raise _Unusual
    found = _parse(summary[:-ending])
    if sum(length for _, length in found.metadata) > start:
        raise _Unusual
    metadata: dict[str, dict[str, str]] = {}
    for content in _contents(fd, found.metadata, Opcode.METADATA):
        name, values = _metadata(content)
        metadata.setdefault(name, {}).update(values)
    started = metadata.get(FORMAT_METADATA, {}).get(START_KEY, "")
    if not started.isdecimal() or RECOVERY_METADATA in metadata:
        raise _Unusual
    events: list[Event] = []
    text_bytes = 0
    for at, length in found.chunks.get(found.events_channel, ()):
        head = parse_chunk(record_in(fd, at, length, Opcode.CHUNK).content)
        require_events(text_bytes := text_bytes + head.size, size)
        events += _events(memoryview(unpack_chunk(head)), found.events_channel)
    start_ns = int(started)
    end_ns = start_ns if found.last_ns is None else found.last_ns
    return info_of(path, metadata, events, trials(events), start_ns, end_ns, size)


def _events(data: memoryview, channel: int) -> Iterator[Event]:
    """Yield the events that begin and end a run and its trials: most others are steps."""
    at = 0
    while at < len(data):
        opcode, length = FRAME.unpack_from(data, at)
        at += FRAME.size
        if opcode == Opcode.MESSAGE:
            number, _, t_ns, _ = MESSAGE_FIELDS.unpack_from(data, at)
            payload = data[at + MESSAGE_FIELDS.size : at + length]
            if number == channel and bytes(payload[8:_KIND_END]).startswith(_KINDS):
                yield parse_event(t_ns, payload, _loads)
        at += length


class _Ending(NamedTuple):
    """What the summary names: chunks and metadata by offset and length in the file, in bytes."""

    events_channel: int
    chunks: Mapping[int, Sequence[tuple[int, int]]]  #: by channel
    metadata: Sequence[tuple[int, int]]
    last_ns: int | None  #: time of the last message


def _parse(summary: memoryview) -> _Ending:
    events_channel = messages = indexed = 0
    chunks: dict[int, list[tuple[int, int]]] = {}
    metadata: list[tuple[int, int]] = []
    last_ns: int | None = None
    for opcode, at in _records(summary):
        if opcode == Opcode.CHUNK_INDEX:
            _, _, offset, length, entries, channel = _CHUNK.unpack_from(summary, at)
            if entries != _ENTRY_BYTES:
                raise _Unusual
            chunks.setdefault(channel, []).append((offset, length))
            (index_bytes,) = _MESSAGES.unpack_from(summary, at + _INDEX_BYTES_AT)
            indexed += index_bytes // 16
        elif opcode == Opcode.STATISTICS:
            (messages,) = _MESSAGES.unpack_from(summary, at)
            last_ns = _TIMES.unpack_from(summary, at + _TIMES_AT)[1] if messages else None
        elif opcode == Opcode.CHANNEL:
            (channel,) = struct.unpack_from("<H", summary, at)
            if _text(summary, at + 4)[0] == EVENTS_TOPIC:
                events_channel = channel
        elif opcode == Opcode.METADATA_INDEX:
            metadata.append(_PLACE.unpack_from(summary, at))
    if messages > indexed or not events_channel:
        raise _Unusual
    return _Ending(events_channel, chunks, metadata, last_ns)


def _records(buffer: memoryview) -> Iterator[tuple[int, int]]:
    """Yield opcode and start of the content of each record."""
    at = 0
    while at < len(buffer):
        opcode, length = FRAME.unpack_from(buffer, at)
        at += FRAME.size
        yield opcode, at
        at += length


@lru_cache(maxsize=4096)
def _kept(text: str) -> object:
    """Return what a JSON text means; trials of one procedure have the same data again and again."""
    return json.loads(text)


def _loads(text: str) -> object:
    return _kept(text) if len(text) <= _KEPT_LETTERS else json.loads(text)


def _contents(fd: int, places: Sequence[tuple[int, int]], opcode: int) -> Iterator[memoryview]:
    """Yield the contents of records; those that follow one another are read at once."""
    held, begin = memoryview(b""), 0
    for number, (at, length) in enumerate(places):
        if not begin <= at <= at + length <= begin + len(held):
            end = at + length
            for following, size in places[number + 1 :]:
                if following != end or following + size - at > _AT_ONCE:
                    break
                end = following + size
            held, begin = bytes_at(fd, at, end - at), at
        record = record_at(held[: at - begin + length], at - begin)
        if record.opcode != opcode:
            raise _Unusual
        yield record.content


def _metadata(content: memoryview) -> tuple[str, dict[str, str]]:
    name, at = _text(content, 0)
    (size,) = _LENGTH.unpack_from(content, at)
    at += _LENGTH.size
    end, values = at + size, {}
    while at < end:
        key, at = _text(content, at)
        values[key], at = _text(content, at)
    return name, values


def _text(buffer: memoryview, at: int) -> tuple[str, int]:
    """Return the text that begins with its length at ``at``, and where it ends."""
    (length,) = _LENGTH.unpack_from(buffer, at)
    start = at + _LENGTH.size
    if start + length > len(buffer):
        raise _Unusual
    return str(buffer[start : start + length], "utf-8"), start + length
