"""Opens a recording and reads its index: what stands in the file, and where.

:class:`~rigd.record.read.reader.Recording` reads the rows by it.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from shlex import quote
from typing import Final

from mcap import records as mcap
from mcap.opcode import Opcode
from mcap.records import ChunkIndex

from rigd.model import RecordingError
from rigd.model.machine.system import read_at
from rigd.record.events.gaps import Gap, gaps_from_json
from rigd.record.mcap.access import how_to_recover, require_regular, share
from rigd.record.mcap.bounds import about, require_sum
from rigd.record.mcap.chunks import ChunkHead
from rigd.record.mcap.contents import Contents, parse_footer, parse_summary, rows_of
from rigd.record.mcap.crc import crc32
from rigd.record.mcap.file import RecordingInUse
from rigd.record.mcap.prefix import GAPS_KEY, LIBRARY, RECOVERY_METADATA
from rigd.record.mcap.wire import (
    FOOTER,
    FRAME,
    MAGIC,
    Malformed,
    Record,
    decode,
    map_file,
    record_at,
)
from rigd.record.scan.scan import Scan, library_of, scan


class DamagedRecording(RecordingError):
    """Bytes of the file are wrong or missing."""


def damaged(path: Path, problem: object) -> RecordingError:
    """Return the error for a file that cannot be read; a writer may be changing it."""
    if is_written(path):
        return RecordingInUse(f"{path} is being written", hint="Wait until its run has ended.")
    if not _may_be_mcap(path):
        hint = "It is no MCAP recording; `rigd run` makes those, with names that end in .mcap."
        return RecordingError(f"{path} cannot be read: {problem}", hint=hint)
    return DamagedRecording(
        f"{path} is damaged: {problem}",
        hint=f"`rigd verify {quote(str(path))}` lists the damage. {how_to_recover(path)}",
    )


def is_written(path: Path) -> bool:
    """Return whether a writer has the file open."""
    with path.open("rb", buffering=0) as file:
        return not share(file.fileno())


def _may_be_mcap(path: Path) -> bool:
    """Return whether a file that cannot be read is named, begins or ends like a recording."""
    with path.open("rb") as file:
        begin = file.read(len(MAGIC))
        file.seek(-min(len(MAGIC), os.fstat(file.fileno()).st_size), os.SEEK_END)
        return path.suffix == ".mcap" or MAGIC in (begin, file.read())


@contextmanager
def opened(path: Path) -> Iterator[int]:
    """Open a file that is not empty, for positioned reads.

    It is not mapped: if its writer cut a mapped file shorter, the system would kill the reader.

    Raises:
        RecordingError: missing, not readable, empty, or too large to unpack.

    """
    try:
        require_regular(path)
        with path.open("rb", buffering=0) as file, about(path):
            if os.fstat(file.fileno()).st_size == 0:
                raise RecordingError(
                    f"{path} is empty", hint="Nothing was recorded; the file can be deleted."
                )
            yield file.fileno()
    except OSError as error:
        raise RecordingError(f"cannot read {path}: {error.strerror}") from error


def bytes_at(fd: int, offset: int, length: int) -> memoryview:
    """Return bytes of a file.

    Raises:
        Malformed: it has not so many.
    """
    size = os.fstat(fd).st_size
    if offset + length > size:
        raise Malformed(f"its index points to byte {offset + length}, behind its end at {size}")
    return memoryview(read_at(fd, length, offset))


def record_in(fd: int, offset: int, length: int, opcode: int) -> Record:
    """Return the record that the index names.

    Raises:
        Malformed: another one is there.
    """
    record = record_at(bytes_at(fd, offset, length), 0)
    if record.opcode != opcode:
        raise Malformed(f"the record at byte {offset} does not agree with its index")
    return record


def require_same(head: ChunkHead, index: ChunkIndex) -> None:
    """Raise unless a chunk is the one of the index.

    A writer replaces the open chunks at the end of its file, also by those of other channels.

    Raises:
        Malformed: it is another one.
    """
    found = head.start_ns, head.end_ns, head.size, head.compression, len(head.packed)
    if found != (
        index.message_start_time,
        index.message_end_time,
        index.uncompressed_size,
        index.compression,
        index.compressed_size,
    ):
        raise Malformed(f"the chunk at byte {index.chunk_start_offset} is not that of the index")


#: No header is longer, in bytes.
_MOST_HEADER: Final = 1 << 16


def walked(fd: int) -> Scan | None:
    """Return a scan of the whole file, or None while a writer holds it."""
    return scan(map_file(fd)) if share(fd) else None


def indexed(fd: int) -> tuple[Contents, int]:
    """Return what the index at the end of the file names, and where it begins.

    Raises:
        Malformed: the file has none, or it is damaged.
        TooLarge: its chunks have more bytes than rigd unpacks.
    """
    size, ending = os.fstat(fd).st_size, FOOTER.size + len(MAGIC)
    if read_at(fd, len(MAGIC), 0) != MAGIC:
        raise Malformed("it does not begin like an MCAP file")
    start, crc = parse_footer(memoryview(read_at(fd, ending, max(size - ending, 0))))
    if start == 0:
        raise Malformed("it has no summary")
    if not len(MAGIC) <= start <= size - ending:
        raise Malformed("its footer points outside of the file")
    summary = bytes_at(fd, start, size - start)
    if crc and crc32(summary[: -len(MAGIC) - 4]) != crc:
        raise Malformed("the CRC of its summary does not match")
    contents = parse_summary(summary[:-ending])
    if contents.messages > sum(map(rows_of, contents.chunks)):
        raise Malformed("its messages are not in indexed chunks")
    if sum(chunk.chunk_length for chunk in contents.chunks) + _extras(contents) > start:
        raise Malformed("its index names more bytes than it has")
    require_sum(sum(chunk.uncompressed_size for chunk in contents.chunks), size)
    return contents, start


def _extras(contents: Contents) -> int:
    metadata = sum(index.length for index in contents.metadata)
    return metadata + sum(index.length for index in contents.attachments)


def metadata_in(fd: int, contents: Contents) -> dict[str, dict[str, str]]:
    """Return the metadata by name; for a repeated name, later values replace earlier values.

    Raises:
        Malformed: a record is not where the index names it.
    """
    found: dict[str, dict[str, str]] = {}
    for index in contents.metadata:
        record = record_in(fd, index.offset, index.length, Opcode.METADATA)
        content = decode(mcap.Metadata, record.content)
        found.setdefault(content.name, {}).update(content.metadata)
    return found


def gaps_in(metadata: Mapping[str, Mapping[str, str]]) -> tuple[Gap, ...]:
    """Return the rows that a recovery of the file has stated as lost.

    Raises:
        Malformed: they are not stated as rigd states them.
    """
    try:
        return gaps_from_json(metadata.get(RECOVERY_METADATA, {}).get(GAPS_KEY, "[]"))
    except ValueError as error:
        raise Malformed(str(error)) from error


def by_rigd(fd: int) -> bool:
    """Return whether the header of a file names rigd, or is damaged."""
    begin = memoryview(read_at(fd, len(MAGIC) + FRAME.size, 0))
    if len(begin) < len(MAGIC) + FRAME.size or bytes(begin[: len(MAGIC)]) != MAGIC:
        return True
    opcode, length = FRAME.unpack_from(begin, len(MAGIC))
    if opcode != Opcode.HEADER or length > _MOST_HEADER:
        return True
    library = library_of(memoryview(read_at(fd, len(begin) + length, 0)))
    return library is None or library.startswith(LIBRARY)


def mixes_channels(contents: Contents) -> bool:
    """Return whether a chunk has several channels or none, which rigd never writes."""
    return any(len(chunk.message_index_offsets) != 1 for chunk in contents.chunks)
