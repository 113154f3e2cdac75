"""Lists the rows that a damaged file of another program has lost.

Its messages may have any numbers, so that these tell nothing of rows that are missing. What does is
the index of the chunks that are damaged, or else the messages around the damage.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from mcap.records import ChunkIndex

from rigd.record.events.gaps import Gap, Span, gaps_from_json, silent_end
from rigd.record.mcap.contents import Contents
from rigd.record.mcap.prefix import GAPS_KEY, RECOVERY_METADATA
from rigd.record.mcap.schema import TRIAL_TOPIC
from rigd.record.scan.findings import Scan

#: Message indexes whose chunk is lost, by channel: the byte of each, and the messages it names.
Orphans = Mapping[int, Sequence[tuple[int, Span]]]


def lost_rows(
    found: Scan,
    summary: Contents | None,
    torn: Sequence[tuple[int, int]],
    orphans: Orphans,
    spoilt: Sequence[Gap],
) -> list[Gap]:
    """Return the rows that are lost by damage, and those that an earlier repair noted.

    ``torn`` are the ranges of bytes whose records are lost, ``spoilt`` what is lost beside them.
    """
    try:
        noted = found.metadata.get(RECOVERY_METADATA, {}).get(GAPS_KEY, "[]")
        gaps = list(gaps_from_json(noted))
    except ValueError:
        gaps = []
    gaps += spoilt
    for start, end in torn:
        lost = [
            chunk
            for chunk in (() if summary is None else summary.chunks)
            if start <= chunk.chunk_start_offset < end
        ]
        for chunk in lost:
            for number in chunk.message_index_offsets:
                gaps += _of_chunk(found, chunk, number, orphans)
        if not lost:
            gaps += _around(found, start, end)
    kept = [gap for gap in gaps if f"/{gap.stream}" != TRIAL_TOPIC]
    return sorted(set(kept), key=lambda gap: (gap.start_ns, gap.stream))


def _of_chunk(found: Scan, chunk: ChunkIndex, number: int, orphans: Orphans) -> list[Gap]:
    """Return the rows of a channel that were in a chunk, by its index if that is there."""
    stream = _stream(found, number)
    first = chunk.chunk_start_offset + chunk.chunk_length
    last = first + chunk.message_index_length
    for at, span in orphans.get(number, ()):
        if first <= at < last:
            return [Gap(stream, span.start_ns, span.end_ns, span.count)]
    return [Gap(stream, chunk.message_start_time, chunk.message_end_time, None)]


def _around(found: Scan, start: int, end: int) -> list[Gap]:
    """Return what each channel may have lost between two bytes, by the messages around them."""
    gaps: list[Gap] = []
    for number in found.contents.counts:
        held = [
            (piece.start, piece.spans[number]) for piece in found.pieces if number in piece.spans
        ]
        before = [span for at, span in held if at < start]
        behind = [span for at, span in held if at >= end]
        if not behind:
            topic = found.contents.channels[number].topic
            gaps += silent_end(topic, before, found.contents.end_ns)
            continue
        number_before = before[-1].last if before else None
        if number_before is not None and behind[0].first == number_before + 1:
            continue
        first_ns = before[-1].end_ns if before else found.start_ns
        times = sorted((first_ns, behind[0].start_ns))
        gaps.append(Gap(_stream(found, number), times[0], times[1], None))
    return gaps


def _stream(found: Scan, number: int) -> str:
    channel = found.contents.channels.get(number)
    return f"unnamed_{number}" if channel is None else channel.topic.removeprefix("/")
