"""Builds and parses MCAP chunks (blocks of messages of one channel) with numpy.

Messages of a stream all have the same size. So N messages are one structured array, and each item
is a complete MCAP Message record: frame, channel, sequence, times, CDR header, values.
"""

from __future__ import annotations

import struct
from array import array
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, Final

import numpy as np
from mcap.opcode import Opcode
from mcap.records import ChunkIndex
from numpy.typing import NDArray

from rigd.model import Stream
from rigd.model.rows import row_dtype
from rigd.record.mcap.bounds import permit_records
from rigd.record.mcap.compression import Compression, decompress, decompress_begin
from rigd.record.mcap.crc import crc32
from rigd.record.mcap.wire import FRAME, Malformed

Times = NDArray[np.uint64]

_CHUNK_HEAD: Final = struct.Struct("<QQQII")  #: start, end, size, CRC, length of compression name
MESSAGE_INDEX_HEAD: Final = struct.Struct("<BQHI")
_SIZE: Final = struct.Struct("<Q")
_LENGTH: Final = struct.Struct("<xQ")  #: of a record, behind its opcode
_PREFIX: Final = [("opcode", "u1"), ("length", "<u8"), ("channel", "<u2")]
_TIMES: Final = [("sequence", "<u4"), ("log_time", "<u8"), ("publish_time", "<u8")]
MESSAGE_HEAD: Final = np.dtype([*_PREFIX, *_TIMES])  #: what every Message record begins with
LOG_TIME_AT: Final = 15  #: byte of the log time in a record; the publish time follows
CDR_SIZE: Final = 4


@cache
def message_dtype(value_bytes: int) -> np.dtype[np.void]:
    """Return the dtype of a Message record with ``value_bytes`` after the CDR header."""
    return np.dtype([*_PREFIX, *_TIMES, ("cdr", "<u4"), ("values", f"V{value_bytes}")])


@cache
def blob_dtype(stream: Stream) -> np.dtype[np.void]:
    """Return a row's dtype with all its values as one blob, for copying them at once."""
    return np.dtype([("t_ns", "<u8"), ("values", f"V{row_dtype(stream).itemsize - 8}")])


@dataclass(frozen=True)
class MessageBlock:
    """Message records of one channel, uncompressed, with the time and offset of each.

    Not a copy: good until the owner of the records fills them again.
    """

    channel: int
    records: memoryview  #: of bytes
    times: Times
    offsets: Times


@dataclass(frozen=True)
class Chunk:
    """A chunk as it is in the file: the Chunk record and its MessageIndex record.

    ``parts`` are its bytes in order; not joined, as copying a MiB costs more than its CRC.
    """

    channel: int
    count: int
    parts: tuple[bytes | memoryview, ...]
    index: ChunkIndex  #: with offsets counted from the start of the chunk

    @property
    def size(self) -> int:
        """Number of bytes in the file, with the message index."""
        return self.index.chunk_length + self.index.message_index_length

    def index_at(self, offset: int) -> ChunkIndex:
        """Return the chunk index of this chunk for the ``offset`` in the file."""
        moved = {channel: offset + at for channel, at in self.index.message_index_offsets.items()}
        return ChunkIndex(
            **{
                **vars(self.index),
                "chunk_start_offset": offset,
                "message_index_offsets": moved,
            }
        )


def build_chunk(block: MessageBlock, compression: Compression, packed: bytes | memoryview) -> Chunk:
    """Return the block as a chunk with CRC and message index; ``packed`` are its records."""
    name = b"" if compression == "none" else compression.encode()
    start_ns, end_ns = int(block.times.min()), int(block.times.max())
    size, crc = len(block.records), crc32(block.records)
    head = _CHUNK_HEAD.pack(start_ns, end_ns, size, crc, len(name)) + name
    head += _SIZE.pack(len(packed))
    frame = FRAME.pack(Opcode.CHUNK, len(head) + len(packed))
    index = build_message_index(block.channel, block.times, block.offsets)
    length = len(frame) + len(head) + len(packed)
    return Chunk(
        channel=block.channel,
        count=len(block.times),
        parts=(frame + head, packed, index),
        index=ChunkIndex(
            message_start_time=start_ns,
            message_end_time=end_ns,
            chunk_start_offset=0,
            chunk_length=length,
            message_index_offsets={block.channel: length},
            message_index_length=len(index),
            compression=name.decode(),
            compressed_size=len(packed),
            uncompressed_size=size,
        ),
    )


def wrap_messages(data: memoryview, index: Mapping[int, tuple[Times, Times]]) -> Chunk:
    """Return messages of any channels as a chunk that is not compressed.

    ``index`` are times and offsets of the messages by channel, as :func:`index_messages` gives
    them; the ``channel`` of the chunk is the first of them.
    """
    start_ns = min((int(times.min()) for times, _ in index.values()), default=0)
    end_ns = max((int(times.max()) for times, _ in index.values()), default=0)
    head = _CHUNK_HEAD.pack(start_ns, end_ns, len(data), crc32(data), 0) + _SIZE.pack(len(data))
    begin = FRAME.pack(Opcode.CHUNK, len(head) + len(data)) + head
    entries = {channel: build_message_index(channel, *entry) for channel, entry in index.items()}
    length = len(begin) + len(data)
    offsets: dict[int, int] = {}
    at = length
    for channel, entry in entries.items():
        offsets[channel] = at
        at += len(entry)
    return Chunk(
        channel=next(iter(index), 0),
        count=sum(len(times) for times, _ in index.values()),
        parts=(begin, data, b"".join(entries.values())),
        index=ChunkIndex(
            message_start_time=start_ns,
            message_end_time=end_ns,
            chunk_start_offset=0,
            chunk_length=length,
            message_index_offsets=offsets,
            message_index_length=at - length,
            compression="",
            compressed_size=len(data),
            uncompressed_size=len(data),
        ),
    )


def build_message_index(channel: int, times: Times, offsets: Times) -> bytes:
    """Return the MessageIndex record of a channel: time and offset of each message."""
    entries = np.empty((len(times), 2), "<u8")
    entries[:, 0] = times
    entries[:, 1] = offsets
    size = entries.nbytes
    head = MESSAGE_INDEX_HEAD.pack(Opcode.MESSAGE_INDEX, 2 + 4 + size, channel, size)
    return b"".join((head, entries.data.cast("B")))


def parse_message_index(content: memoryview) -> tuple[int, Times]:
    """Return the channel and the (n, 2) times and offsets of a MessageIndex record's content.

    Raises:
        Malformed: its length does not agree with the content.

    """
    if len(content) < 6:
        raise Malformed("a message index that is too short")
    channel, size = struct.unpack_from("<HI", content)
    if size != len(content) - 6 or size % 16:
        raise Malformed("a message index whose sizes do not agree")
    return channel, np.frombuffer(content, np.uint64, offset=6).reshape(-1, 2)


def same_entries(entries: Times, messages: tuple[Times, Times]) -> bool:
    """Return whether a message index names exactly these messages, in any order."""
    times, offsets = messages
    if len(entries) != len(times):
        return False
    order = np.argsort(entries[:, 1], kind="stable")
    return bool((entries[order, 0] == times).all() and (entries[order, 1] == offsets).all())


@dataclass(frozen=True)
class ChunkHead:
    """The fields of a Chunk record before its data."""

    start_ns: int
    end_ns: int
    size: int  #: of the records when uncompressed, bytes
    crc: int
    compression: str
    packed: memoryview


def parse_chunk(content: memoryview) -> ChunkHead:
    """Return the head of a Chunk record's content.

    Raises:
        Malformed: the content is shorter than its sizes.
    """
    head, packed_size = _read_head(content)
    if len(head.packed) != packed_size:
        raise Malformed("a chunk whose sizes do not agree")
    return head


def parse_torn_chunk(content: memoryview) -> ChunkHead:
    """Return the head of a chunk of which the end may be missing or wrong.

    Raises:
        Malformed: not even the head is there.

    """
    return _read_head(content)[0]


def _read_head(content: memoryview) -> tuple[ChunkHead, int]:
    """Return the head of a chunk with all that follows it, and how long that should be."""
    try:
        start_ns, end_ns, size, crc, name_length = _CHUNK_HEAD.unpack_from(content)
        at = _CHUNK_HEAD.size
        name = str(content[at : at + name_length], "utf-8")
        at += name_length
        (packed_size,) = _SIZE.unpack_from(content, at)
    except (struct.error, UnicodeDecodeError) as error:
        raise Malformed(f"a damaged chunk ({error})") from error
    return ChunkHead(start_ns, end_ns, size, crc, name, content[at + _SIZE.size :]), packed_size


def encode_head(head: ChunkHead) -> bytes:
    """Return the fields of a Chunk record before its data."""
    name = head.compression.encode()
    begin = _CHUNK_HEAD.pack(head.start_ns, head.end_ns, head.size, head.crc, len(name))
    return begin + name + _SIZE.pack(len(head.packed))


def begin_of_chunk(head: ChunkHead, size: int) -> bytes:
    """Return the first ``size`` bytes of the records of a chunk, even if its rest is damaged.

    Raises:
        Malformed: these bytes cannot be read either.
    """
    return decompress_begin(head.packed, head.compression, size)


def unpack_chunk(head: ChunkHead, *, check_crc: bool = True) -> bytes | memoryview:
    """Return the uncompressed records of a chunk.

    Raises:
        Malformed: unknown compression, data that does not decompress, or a CRC that differs.
        TooLarge: more bytes than :mod:`~rigd.record.mcap.bounds` permits.

    """
    data = decompress(head.packed, head.compression, head.size)
    if check_crc and head.crc and crc32(data) != head.crc:
        raise Malformed("a chunk whose CRC does not match its data")
    return data


def uniform_messages(data: bytes | memoryview) -> NDArray[np.void] | None:
    """Return all records of a chunk as one array of :func:`message_dtype`.

    None if they are not all messages of one channel and one size.
    """
    if len(data) < MESSAGE_HEAD.itemsize + CDR_SIZE:
        return None
    _, length = FRAME.unpack_from(data)
    size = FRAME.size + length
    value_bytes = size - MESSAGE_HEAD.itemsize - CDR_SIZE
    if value_bytes <= 0 or len(data) % size:
        return None
    array = np.frombuffer(data, message_dtype(value_bytes))
    same = (
        (array["opcode"] == Opcode.MESSAGE).all()
        and (array["length"] == length).all()
        and (array["channel"] == array["channel"][0]).all()
    )
    return array if same else None


@dataclass(frozen=True, eq=False)
class Places:
    """The messages of a chunk: channel, first byte and size in bytes of each record, (n,).

    ``others`` are the first bytes of the records that are no messages.
    """

    channels: NDArray[np.uint16]
    offsets: NDArray[np.int64]
    sizes: NDArray[np.int64]
    others: NDArray[np.int64]


def message_places(data: bytes | memoryview) -> Places:
    """Return the places of the messages of a chunk, of any channels and sizes.

    Raises:
        Malformed: the data ends within a record, or a message is too short.

    """
    begins = array("q")  # a list takes five times as much
    at, end, length_at = 0, len(data), _LENGTH.unpack_from
    while at + FRAME.size <= end:  # once for each message: nothing but this
        begins.append(at)
        if not (length := length_at(data, at)[0]) and not data[at]:  # zeros are millions of them
            raise Malformed(f"no record begins at byte {at} of a chunk")
        at += FRAME.size + length
    if at != end:
        raise Malformed(f"the file ends within a record at byte {begins[-1] if begins else 0}")
    octets = np.frombuffer(data, np.uint8)
    offsets = np.array(begins, np.int64)
    sizes = np.diff(offsets, append=end)
    is_message = octets[offsets] == Opcode.MESSAGE
    others = offsets[~is_message]
    offsets, sizes = offsets[is_message], sizes[is_message]
    if (sizes < MESSAGE_HEAD.itemsize).any():
        raise Malformed("a message that is too short")
    channels = numbers_at(octets, offsets + FRAME.size, np.dtype("<u2"))
    return Places(channels, offsets, sizes, others)


def numbers_at(
    octets: NDArray[np.uint8], offsets: NDArray[np.int64], kind: np.dtype[Any]
) -> NDArray[Any]:
    """Return the numbers of a ``kind`` that begin at ``offsets`` (n,) of the bytes, (n,)."""
    if not len(offsets):
        return np.empty(0, kind)
    taken = np.lib.stride_tricks.sliding_window_view(octets, kind.itemsize)[offsets]
    return np.asarray(taken.view(kind)[:, 0])


def index_messages(data: bytes | memoryview) -> dict[int, tuple[Times, Times]]:
    """Return the times and offsets of every message of a chunk, by channel.

    Raises:
        Malformed: the data ends within a record.

    """
    array = uniform_messages(data)
    if array is not None:
        permit_records(len(array))
        offsets = np.arange(len(array), dtype=np.uint64) * np.uint64(array.dtype.itemsize)
        return {int(array["channel"][0]): (array["log_time"].copy(), offsets)}
    places, octets = message_places(data), np.frombuffer(data, np.uint8)
    permit_records(len(places.offsets) + len(places.others))
    times = numbers_at(octets, places.offsets + LOG_TIME_AT, np.dtype("<u8"))
    return {
        channel: (times[mine], places.offsets[mine].astype(np.uint64))
        for channel, mine in by_channel(places).items()
    }


def by_channel(places: Places) -> dict[int, NDArray[np.intp]]:
    """Return which of the messages are those of each channel, in order of their first ones."""
    order = np.argsort(places.channels, kind="stable")
    numbers, begins = np.unique(places.channels[order], return_index=True)
    parts = zip(numbers.tolist(), np.split(order, begins[1:]), strict=False)
    return dict(sorted(parts, key=lambda part: int(part[1][0])))
