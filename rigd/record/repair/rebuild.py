"""Writes the intact records of a damaged recording to a new, complete file, byte for byte."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from typing import Final

from mcap import records as mcap
from mcap.opcode import Opcode
from mcap.well_known import Profile

from rigd import __version__
from rigd.model.machine.system import sync_data
from rigd.record.mcap.contents import Contents, SummaryWriter
from rigd.record.mcap.crc import crc32
from rigd.record.mcap.journal import write_all
from rigd.record.mcap.prefix import LIBRARY, RECOVERY_METADATA, build_extras
from rigd.record.mcap.wire import FRAME, MAGIC, attachment_at, decode, encode, record_at
from rigd.record.scan.findings import Piece, Scan

#: Pieces are written together up to this size.
_BATCH_BYTES: Final = 4 << 20


#: Metadata by name that a recovery adds; ``recovery`` among them replaces an older one.
Marks = Mapping[str, Mapping[str, str]]


def rebuild(fd: int, found: Scan, marks: Marks) -> None:
    """Write a whole recording of the intact pieces, and ``marks``, to an empty file.

    Raises:
        OSError: the disk is full or fails.
    """
    contents = Contents(schemas=found.contents.schemas, channels=found.contents.channels)
    _write(fd, _whole(found, marks, contents), contents, 0, 0)
    os.fsync(fd)


def complete(fd: int, found: Scan, cut: int, crc: int, marks: Marks) -> None:
    """Write the missing parts from byte ``cut`` of the file on; the pieces before it stay.

    ``crc`` is the CRC up to there. The pieces after it are moved together.

    Raises:
        OSError: the disk is full or fails.
    """
    contents = Contents(schemas=found.contents.schemas, channels=found.contents.channels)
    # Copied first: they are in the file that is being written.
    parts = [bytes(part) for part in _behind(found, cut, marks, contents)]
    _write(fd, iter(parts), contents, cut, crc)
    sync_data(fd)


def _write(
    fd: int, parts: Iterator[bytes | memoryview], contents: Contents, at: int, crc: int
) -> None:
    """Write the data from byte ``at`` on, and the summary; cut off the bytes after it."""
    batch: list[bytes | memoryview] = []
    waiting = 0
    for part in parts:
        crc = crc32(part, crc)
        batch.append(part)
        waiting += len(part)
        if waiting > _BATCH_BYTES:
            write_all(fd, batch, at)
            at, waiting = at + waiting, 0
            batch.clear()
    end = at + waiting
    tail = SummaryWriter(contents).tail(end, crc, ())
    write_all(fd, [*batch, tail], at)
    os.ftruncate(fd, end + len(tail))


def _whole(found: Scan, marks: Marks, contents: Contents) -> Iterator[bytes | memoryview]:
    """Yield a whole data section, and index it in ``contents``."""
    first, *others = found.pieces
    if first.opcode == Opcode.HEADER:
        begin = bytes(first.data)
    else:
        others = found.pieces
        library = found.library or f"{LIBRARY}{__version__}"
        header = mcap.Header(Profile.ROS2, library)
        if found.others:
            header = mcap.Header(
                "", found.library or f"unknown, recovered by {LIBRARY}{__version__}"
            )
        begin = MAGIC + encode(header)
    # One of each number, all before the first chunk: the damaged file may have several copies.
    definitions = [*found.contents.schemas.values(), *found.contents.channels.values()]
    begin += b"".join(map(encode, definitions))
    yield begin
    at = len(begin)
    for piece in others:
        if piece.opcode not in (Opcode.SCHEMA, Opcode.CHANNEL) and not _is_mark(piece):
            _index(piece, at, found, contents)
            for part in (piece.head, piece.data, piece.index):
                yield part
                at += len(part)
    yield build_extras(marks, (), found.start_ns, at, contents)


def _behind(
    found: Scan, cut: int, marks: Marks, contents: Contents
) -> Iterator[bytes | memoryview]:
    """Yield the data section from byte ``cut`` on, and index all of it in ``contents``."""
    at = cut
    for piece in found.pieces:
        if piece.start < cut:
            _index(piece, piece.start, found, contents)
            missing = piece.index  # of the last before the cut, if there is one
        else:
            _index(piece, at, found, contents)
            yield piece.data
            at += len(piece.data)
            missing = piece.index
        yield missing
        at += len(missing)
    if not any(_is_mark(piece) for piece in found.pieces):
        yield build_extras(marks, (), found.start_ns, at, contents)


def _is_mark(piece: Piece) -> bool:
    return piece.opcode == Opcode.METADATA and _name(piece) == RECOVERY_METADATA


def _name(piece: Piece) -> str:
    return decode(mcap.Metadata, piece.data[FRAME.size :]).name


def _index(piece: Piece, at: int, found: Scan, contents: Contents) -> None:
    """Add a piece at byte ``at`` to the index."""
    if piece.chunk is not None:
        moved = at - piece.chunk.chunk_start_offset
        offsets = piece.chunk.message_index_offsets
        changes = {
            "chunk_start_offset": at,
            "message_index_offsets": {number: start + moved for number, start in offsets.items()},
        }
        contents.chunks.append(mcap.ChunkIndex(**{**vars(piece.chunk), **changes}))
        for channel, span in piece.spans.items():
            contents.add_messages(channel, span.count, span.start_ns, span.end_ns)
    elif piece.opcode == Opcode.ATTACHMENT:
        contents.attachments.append(attachment_at(record_at(piece.data, 0), at))
    elif piece.opcode == Opcode.METADATA:
        contents.metadata.append(mcap.MetadataIndex(at, len(piece.data), _name(piece)))
