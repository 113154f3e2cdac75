"""Holds what a scan has found in a file: its intact pieces, and its damage."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from mcap.records import ChunkIndex

from rigd.record.events.gaps import Gap, Span, find_gaps, gaps_from_json, silent_end
from rigd.record.mcap.chunks import Times
from rigd.record.mcap.contents import Contents
from rigd.record.mcap.prefix import (
    FORMAT_METADATA,
    GAPS_KEY,
    RECOVERY_METADATA,
    START_KEY,
)
from rigd.record.mcap.schema import EVENTS_TOPIC, TRIAL_TOPIC


class Damage(NamedTuple):
    """Bytes ``start`` to ``end`` of a file that are not valid, and the reason.

    Of a file that lacks something as a whole, both are 0.
    """

    start: int
    end: int
    problem: str

    def __str__(self) -> str:
        """Return the place and the damage."""
        return f"bytes {self.start} to {self.end}: {self.problem}" if self.end else self.problem


@dataclass(frozen=True)
class Piece:
    """Valid bytes of a data section: one record, and after a chunk its message indexes.

    ``index`` are message indexes that must be written again, ``spans`` the messages by channel.
    ``head`` makes a chunk of messages that are outside of chunks.
    """

    opcode: int
    start: int
    data: memoryview
    index: bytes = b""
    chunk: ChunkIndex | None = None
    spans: Mapping[int, Span] = field(default_factory=dict)
    head: bytes = b""

    @property
    def end(self) -> int:
        """Byte behind it."""
        return self.start + len(self.data)


@dataclass
class Scan:
    """The valid parts and the damaged parts of a file.

    ``data_end`` is the start of the first damage, or else the end of the data, and ``data_crc`` the
    CRC up to there. ``indexed`` are messages that indexes name, by channel. ``trusted`` are bytes
    at the start whose chunks need no unpacking.
    """

    contents: Contents = field(default_factory=Contents)
    data_end: int = 0
    data_crc: int = 0
    damages: list[Damage] = field(default_factory=list)
    library: str = ""  #: what wrote the file; empty if its header is damaged
    trusted: int = 0
    pieces: list[Piece] = field(default_factory=list)
    indexed: dict[int, list[Span]] = field(default_factory=dict)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    summary: bool = False  #: whether the summary is sound
    data_sound: bool = False  #: whether the CRC of the data section holds
    another: int | None = None  #: byte where another recording begins, behind this one
    end_unknown: bool = False  #: whether rows may be lost at the end, in addition to those listed
    others: bool = False  #: whether another program wrote the file
    unlike: bool = False  #: whether it is not laid out as rigd does it, whatever its header says
    lost: tuple[Gap, ...] = ()  #: of a file of others: the rows that are lost
    times: dict[int, list[Times]] = field(default_factory=dict)  #: the same: those of each channel
    firsts: dict[int, bytes] = field(default_factory=dict)  #: the same: first content of a channel
    doubled: dict[str, int] = field(default_factory=dict)  #: messages that stand there again
    lacks: tuple[str, ...] = ()  #: what rigd would have written
    unread: list[str] = field(default_factory=list)  #: what rigd cannot read, in words
    unknown: dict[int, int] = field(default_factory=dict)  #: records of unknown kinds, by opcode

    @property
    def intact(self) -> bool:
        """Whether the file has no damage."""
        return not self.damages

    @property
    def problem(self) -> str:
        """The first problem; empty if there is none."""
        return self.damages[0].problem if self.damages else ""

    @property
    def behind(self) -> list[Piece]:
        """Sound pieces behind the first damage."""
        return [piece for piece in self.pieces if piece.end > self.data_end]

    @property
    def missing_index(self) -> bytes:
        """The bytes that complete the last chunk before ``data_end``, to be written there."""
        before = [piece for piece in self.pieces if piece.end == self.data_end]
        return before[-1].index if before else b""

    @property
    def start_ns(self) -> int:
        """When the recording began; if that is lost, its first message."""
        text = self.metadata.get(FORMAT_METADATA, {}).get(START_KEY, "")
        return int(text) if text.isdecimal() else self.contents.start_ns

    def gaps(self) -> tuple[Gap, ...]:
        """Return the lost rows, including those that an earlier repair noted."""
        if self.others:
            return self.lost  # other programs may number their messages differently
        try:
            known = gaps_from_json(self.metadata.get(RECOVERY_METADATA, {}).get(GAPS_KEY, "[]"))
        except ValueError:
            known = ()
        found: list[Gap] = []
        for number, channel in self.contents.channels.items():
            if channel.topic == TRIAL_TOPIC:  # the events have all of it
                continue
            held = [piece.spans[number] for piece in self.pieces if number in piece.spans]
            indexed = self.indexed.get(number, [])
            found += find_gaps(channel.topic, held, indexed, known, self.start_ns)
            if self.end_unknown and not self.summary and channel.topic != EVENTS_TOPIC:
                found += silent_end(channel.topic, held, self.contents.end_ns)
        return tuple(sorted(found, key=lambda gap: (gap.start_ns, gap.stream)))


def collect(found: Scan) -> None:
    """Make the index of the chunks that are held."""
    contents = found.contents
    contents.chunks = [piece.chunk for piece in found.pieces if piece.chunk is not None]
    contents.counts = {}
    contents.start_ns = contents.end_ns = 0
    for piece in found.pieces:
        for channel, span in piece.spans.items():
            contents.add_messages(channel, span.count, span.start_ns, span.end_ns)


def drop_copies(found: Scan) -> None:
    """Remove chunks whose messages a longer chunk also contains.

    An interrupted flush leaves the earlier open chunk after the longer chunk that replaces it.
    """
    longest: dict[tuple[int, int, int], int] = {}
    for piece in found.pieces:
        for key, count in _keys(piece):
            longest[key] = max(count, longest.get(key, 0))
    kept: list[Piece] = []
    for piece in found.pieces:
        keys = _keys(piece)
        if keys and all(longest.get(key, 0) != count for key, count in keys):
            continue
        for key, _ in keys:
            longest.pop(key, None)  # of two that are equal, the first is kept
        kept.append(piece)
    found.pieces = kept
    collect(found)


def _keys(piece: Piece) -> list[tuple[tuple[int, int, int], int]]:
    """Return the identity of the first message of each channel, with the number of messages."""
    return [
        ((channel, span.first, span.start_ns), span.count)
        for channel, span in piece.spans.items()
        if span.first is not None
    ]
