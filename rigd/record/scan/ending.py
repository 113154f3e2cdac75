"""Reads the end of a recording and checks its index against the data before it."""

from __future__ import annotations

from typing import NamedTuple

from mcap.opcode import Opcode
from mcap.records import Channel, Schema

from rigd.record.events.gaps import Span
from rigd.record.mcap.contents import Contents, parse_footer, parse_summary, rows_of
from rigd.record.mcap.crc import crc32
from rigd.record.mcap.wire import DATA_END, FOOTER, FRAME, MAGIC, Malformed, decode
from rigd.record.scan.findings import Damage, Piece, Scan


class Ending(NamedTuple):
    """The part of a file after the data; ``summary`` is None if ``problem`` makes it invalid."""

    summary: Contents | None
    data_end: int  #: where the data ends
    problem: str


def read_ending(buffer: memoryview) -> Ending:
    """Return the records after the data of a file."""
    try:
        start, crc = parse_footer(buffer)
        last = len(buffer) - len(MAGIC) - FOOTER.size
        if not len(MAGIC) + FRAME.size + DATA_END.size <= start <= last:
            raise Malformed("its footer points outside of the file")
        if crc and crc32(buffer[start : -len(MAGIC) - 4]) != crc:
            raise Malformed("the CRC of the summary does not match")
        return Ending(parse_summary(buffer[start:last]), start - DATA_END.size, "")
    except Malformed as error:
        return Ending(None, len(buffer), str(error))


def take_summary(found: Scan, summary: Contents) -> None:
    """Read schemas, channels and the list of chunks from an intact summary.

    Those of the data section have no CRC of their own.
    """
    found.summary = True
    contents = found.contents
    kept: list[Piece] = []
    for piece in found.pieces:
        if _is_defined(piece, summary):
            kept.append(piece)
        else:
            problem = f"the definition at byte {piece.start} is not the one that the summary has"
            found.damages.append(Damage(piece.start, piece.end, problem))
    found.pieces = kept
    contents.schemas = {**contents.schemas, **summary.schemas}
    contents.channels = {**contents.channels, **summary.channels}
    for chunk in summary.chunks:
        if len(chunk.message_index_offsets) == 1:
            span = Span(chunk.message_start_time, chunk.message_end_time, rows_of(chunk))
            found.indexed.setdefault(next(iter(chunk.message_index_offsets)), []).append(span)


def check_ending(buffer: memoryview, found: Scan, ending: Ending, reached: int) -> None:
    """Check DataEnd, summary and footer, which must be all that follows the data.

    The walk came to byte ``reached``.
    """
    problems = found.damages
    behind = reached + DATA_END.size
    if behind > len(buffer):
        problems.append(
            Damage(reached, len(buffer), "the file was cut short: its summary is missing")
        )
        return
    opcode, length, crc = DATA_END.unpack_from(buffer, reached)
    if opcode != Opcode.DATA_END or length != DATA_END.size - FRAME.size:
        problems.append(Damage(reached, behind, "the end of the data is damaged"))
    elif crc:
        found.data_sound = crc == crc32(buffer[:reached])
        if not found.data_sound and not problems:
            problem = (
                "the CRC of the data section does not match, though that of every chunk does: "
                "its header or its metadata may have been changed"
            )
            problems.append(Damage(reached, behind, problem))
    if ending.summary is None:
        problems.append(Damage(reached, len(buffer), ending.problem))
    elif ending.data_end != reached:
        problem = "the summary does not follow the data"
        problems.append(Damage(reached, ending.data_end, problem))


def _is_defined(piece: Piece, summary: Contents) -> bool:
    """Return whether a schema or channel is as the summary has it; True of other records."""
    content = piece.data[FRAME.size :]
    if piece.opcode == Opcode.SCHEMA:
        schema = decode(Schema, content)
        return summary.schemas.get(schema.id) == schema
    if piece.opcode == Opcode.CHANNEL:
        channel = decode(Channel, content)
        return summary.channels.get(channel.id) == channel
    return True
