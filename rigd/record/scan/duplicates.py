"""Finds messages that stand in a file several times, as after a merge of files that overlap."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

from rigd.record.mcap.chunks import (
    LOG_TIME_AT,
    Times,
    by_channel,
    message_places,
    numbers_at,
    parse_chunk,
    unpack_chunk,
)
from rigd.record.mcap.crc import crc32
from rigd.record.mcap.wire import FRAME, record_at
from rigd.record.scan.findings import Piece, Scan

#: What makes a message begins here in its record: behind the number of the channel.
_CONTENT_AT = FRAME.size + 2


def doubles(found: Scan) -> dict[str, int]:
    """Return how many messages of each topic stand in the file before; without those of none.

    A message is the same if topic, number, both times and content are.
    """
    topics: dict[str, list[int]] = {}
    for number in found.times:
        topics.setdefault(found.contents.channels[number].topic, []).append(number)
    counts: dict[str, int] = {}
    tied = {
        topic: times for topic, numbers in topics.items() if len(times := _tied(found, numbers))
    }
    if not tied:
        return counts
    of_channel = {number: topic for topic in tied for number in topics[topic]}
    seen: dict[str, list[NDArray[np.uint64]]] = {topic: [] for topic in tied}
    for topic, keys in _keys(found.pieces, of_channel, tied):
        seen[topic].append(keys)
    for topic, parts in seen.items():
        keys = np.concatenate(parts)
        if count := len(keys) - len(np.unique(keys, axis=0)):
            counts[topic] = count
    return counts


def _tied(found: Scan, numbers: Collection[int]) -> Times:
    """Return the times at which some channels together have several messages."""
    times = np.sort(np.concatenate([part for number in numbers for part in found.times[number]]))
    return np.unique(times[1:][times[1:] == times[:-1]])


def _are_among(times: Times, tied: Times) -> NDArray[np.bool_]:
    """Return which times are among others, which are sorted: `isin` sorts those for each chunk."""
    nearest = np.minimum(np.searchsorted(tied, times), len(tied) - 1)
    return np.asarray(tied[nearest] == times)


def _keys(
    pieces: Sequence[Piece], of_channel: Mapping[int, str], tied: Mapping[str, Times]
) -> Iterator[tuple[str, NDArray[np.uint64]]]:
    """Yield the topic, and time and CRC of the messages (n, 2) whose time another one has too."""
    for piece in pieces:
        channels = [number for number in piece.spans if number in of_channel]
        if not channels:
            continue
        data: bytes | memoryview = piece.data
        if piece.opcode == Opcode.CHUNK:
            data = unpack_chunk(parse_chunk(record_at(piece.data, 0).content), check_crc=False)
        view, octets, places = memoryview(data), np.frombuffer(data, np.uint8), message_places(data)
        times = numbers_at(octets, places.offsets + LOG_TIME_AT, np.dtype("<u8"))
        places_of = by_channel(places)
        for number in channels:
            topic, mine = of_channel[number], places_of[number]
            mine = mine[_are_among(times[mine], tied[topic])]
            spans = zip(places.offsets[mine].tolist(), places.sizes[mine].tolist(), strict=True)
            crcs = [crc32(view[at + _CONTENT_AT : at + size]) for at, size in spans]
            yield topic, np.stack([times[mine], np.array(crcs, np.uint64)], axis=1)
