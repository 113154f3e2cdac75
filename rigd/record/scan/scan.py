"""Checks every byte of a recording; repair and appending depend on this check.

After a damaged place, the check continues with the next record that is valid by its own CRC or
lengths. So damage costs only the chunk that contains it.

To decompress all chunks of a long file takes minutes. If a process wrote the first bytes of a file
itself and knows that the machine has not crashed since, it may declare these bytes *trusted*. For
trusted chunks the check relies on their heads and message indexes, which is ten times as fast.
"""

from __future__ import annotations

from mcap.opcode import Opcode
from mcap.records import Header

from rigd.record.mcap.bounds import budget
from rigd.record.mcap.chunks import CDR_SIZE, MESSAGE_HEAD
from rigd.record.mcap.contents import Contents
from rigd.record.mcap.crc import crc32
from rigd.record.mcap.prefix import FORMAT_METADATA, LIBRARY, define_own
from rigd.record.mcap.schema import EVENTS_CHANNEL, OWN_TOPICS, STREAM_KEY, TRIAL_CHANNEL
from rigd.record.mcap.wire import DATA_END, MAGIC, Malformed, decode, record_at
from rigd.record.scan.definitions import has_own, replace_channel, replace_schema
from rigd.record.scan.ending import check_ending, read_ending, take_summary
from rigd.record.scan.findings import Damage, Piece, Scan, drop_copies
from rigd.record.scan.next_record import begin_of_another
from rigd.record.scan.others import scan_others
from rigd.record.scan.walk import take_head, walk

__all__ = ["Damage", "Piece", "Scan", "scan"]


def scan(buffer: memoryview, trusted: int = 0) -> Scan:
    """Scan a whole file, of which the first ``trusted`` bytes are known to be intact.

    Another recording after the first counts as damage: the two are never mixed.

    Raises:
        Malformed: it is not an MCAP file: it contains no intact record.
        TooLarge: its chunks have more bytes than rigd unpacks.
    """
    with budget(len(buffer)):
        found = _scan(buffer, trusted)
        if (second := found.another) is not None:
            found = _scan(buffer[:second], trusted)
            found.another = second
            problem = f"another recording begins at byte {second}"
            found.damages.append(Damage(second, len(buffer), problem))
    return found


def library_of(buffer: memoryview) -> str | None:
    """Return what program wrote a file, by its header; None if that is damaged."""
    try:
        header = record_at(buffer, len(MAGIC))
        if bytes(buffer[: len(MAGIC)]) != MAGIC or header.opcode != Opcode.HEADER:
            return None
        return decode(Header, header.content).library
    except Malformed:
        return None


def _scan(buffer: memoryview, trusted: int) -> Scan:
    """Scan a file as one of rigd, or as one of others if it says so or is laid out otherwise."""
    library = library_of(buffer)
    if library is not None and not library.startswith(LIBRARY):
        return scan_others(buffer)
    try:
        found = _scan_own(buffer, trusted)
    except Malformed:
        if library is None:
            return scan_others(buffer)
        raise
    return scan_others(buffer) if found.unlike else found


def _scan_own(buffer: memoryview, trusted: int) -> Scan:
    found = Scan(data_end=len(MAGIC), trusted=trusted)
    take_head(buffer, found)
    ending = read_ending(buffer)
    limit = len(buffer) if ending.summary is None else ending.data_end
    reached = walk(buffer[: max(limit, found.data_end)], found)
    odd = [(damage.start, damage.end) for damage in sorted(found.damages)]
    for start, end in [*odd, (reached + DATA_END.size, len(buffer))]:
        if found.another is None:
            found.another = begin_of_another(buffer, start, end)
    if found.another is not None:
        return found
    if not found.pieces:
        raise Malformed("it does not begin like an MCAP file, and nothing in it is like one")
    drop_copies(found)
    if ending.summary is not None:
        take_summary(found, ending.summary)
    check_ending(buffer, found, ending, reached)
    _define_channels(found)
    found.damages.sort()
    found.data_end = min((damage.start for damage in found.damages), default=reached)
    found.data_crc = crc32(buffer[: found.data_end])
    return found


def _define_channels(found: Scan) -> None:
    """Define the channels of chunks whose definitions are lost, so that their rows are kept."""
    contents = found.contents
    problems: list[str] = []
    for piece in found.pieces:
        for number, span in piece.spans.items():
            if number in contents.channels or piece.chunk is None:
                continue
            size = piece.chunk.uncompressed_size // span.count - MESSAGE_HEAD.itemsize - CDR_SIZE
            if number in OWN_TOPICS:
                channel = define_own(number, contents)
            else:
                channel = replace_channel(number, size, contents)
            problems.append(
                f"the definition of channel {number} is lost: its rows are kept as {channel.topic}"
            )
    if FORMAT_METADATA in found.metadata or found.library.startswith(LIBRARY):
        problems += _define_own(contents)
    found.damages += [Damage(0, 0, problem) for problem in problems]


def _define_own(contents: Contents) -> list[str]:
    """Define again what follows from the rest of a recording by rigd; return the losses."""
    problems: list[str] = []
    own = [EVENTS_CHANNEL]
    if TRIAL_CHANNEL in contents.channels or TRIAL_CHANNEL in contents.schemas:
        own.append(TRIAL_CHANNEL)  # older recordings have none
    for number in own:
        if not has_own(number, contents):
            define_own(number, contents)
            topic = OWN_TOPICS[number][0].removeprefix("/")
            problems.append(f"the definition of {topic} is lost, and written anew")
    for channel in contents.channels.values():
        if channel.schema_id not in contents.schemas and STREAM_KEY in channel.metadata:
            replace_schema(channel, contents)
            problems.append(f"the schema of {channel.topic} is lost, and written anew")
    return problems
