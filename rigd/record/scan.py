"""Checks every byte of a recording: what all repair and appending builds on.

Behind a damaged place the walk goes on with the next record that proves itself, so that damage
costs the chunk it is in and no other.

Unpacking all chunks of a long file takes minutes. A process that wrote the first bytes of it and
knows that no crash of the machine came since may call those *trusted*: their chunks are taken
by what their heads and message indexes say, ten times as fast.
"""

from __future__ import annotations

from rigd.record.crc import crc32
from rigd.record.ending import check_ending, read_ending, take_summary
from rigd.record.walk import Damage, Piece, Scan, drop_copies, name_channels, take_head, walk
from rigd.record.wire import MAGIC, Malformed

__all__ = ["Damage", "Piece", "Scan", "scan"]


def scan(buffer: memoryview, trusted: int = 0) -> Scan:
    """Walk a whole file, of which the first ``trusted`` bytes are known to be sound.

    Raises:
        Malformed: it is no MCAP file: nothing in it proves itself.

    """
    found = Scan(data_end=len(MAGIC), trusted=trusted)
    take_head(buffer, found)
    ending = read_ending(buffer)
    limit = len(buffer) if ending.summary is None else ending.data_end
    reached = walk(buffer[: max(limit, found.data_end)], found)
    if not found.pieces:
        raise Malformed("it does not begin like an MCAP file, and nothing in it is like one")
    drop_copies(found)
    if ending.summary is not None:
        take_summary(found, ending.summary)
    check_ending(buffer, found, ending, reached)
    found.damages.sort()
    found.data_end = min((one.start for one in found.damages), default=reached)
    found.data_crc = crc32(buffer[: found.data_end])
    name_channels(found)
    return found
