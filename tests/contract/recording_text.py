"""A recording as text: what stands in the file, a line for each part, with digests of the bytes.

Two recordings with the same text hold the same bytes, but for what names the revision of rigd and
for the offsets in the file, which depend on the length of that name. It is read by the library
`mcap`, not by rigd.
"""

from __future__ import annotations

import hashlib
import json
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from mcap.records import Attachment, Channel, Chunk, Header, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import StreamReader, breakup_chunk

#: What a commit or an installation changes, and no behaviour.
OF_THE_INSTALLATION: Final = ("git_revision", "numpy", "python")


@dataclass
class Topic:
    """The messages of a topic."""

    count: int = 0
    first_ns: int = 0
    last_ns: int = 0
    digest: Any = field(default_factory=hashlib.sha256)

    def add(self, message: Message) -> None:
        """Count a message, with its times and its bytes."""
        if not self.count:
            self.first_ns = message.log_time
        self.count += 1
        self.last_ns = message.log_time
        times = (message.sequence, message.log_time, message.publish_time)
        self.digest.update(repr(times).encode() + message.data)


def text_of(path: Path) -> str:
    """Return the text of a recording."""
    return "\n".join(_lines(path)) + "\n"


def short(data: bytes) -> str:
    """Return the first digits of a digest."""
    return hashlib.sha256(data).hexdigest()[:16]


def _lines(path: Path) -> Iterator[str]:
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    topics: dict[int, Topic] = defaultdict(Topic)
    chunks = hashlib.sha256()
    others: list[str] = []
    for record in _records(path):
        match record:
            case Chunk():
                chunks.update(record.compression.encode() + record.data)
                for inner in breakup_chunk(record):
                    _sort(inner, schemas, channels, topics)
            case Header():
                others.append(f"header: {record.profile}, {record.library}")
            case Attachment():
                data = short(record.data)
                others.append(f"attachment {record.name} at {record.log_time}: {data}")
            case Metadata():
                others.append(f"metadata {record.name}: {json.dumps(_kept(record.metadata))}")
            case _:
                _sort(record, schemas, channels, topics)
    yield from others
    yield f"chunks: {chunks.hexdigest()[:16]}"
    for number, channel in sorted(channels.items()):
        schema, topic = schemas[channel.schema_id], topics[number]
        yield (
            f"{channel.topic} ({channel.message_encoding}, {schema.encoding} "
            f"{short(schema.data)}, {short(json.dumps(channel.metadata).encode())}): "
            f"{topic.count} from {topic.first_ns} to {topic.last_ns} ns, "
            f"{topic.digest.hexdigest()[:16]}"
        )


def _records(path: Path) -> Iterator[McapRecord]:
    with path.open("rb") as file:
        yield from StreamReader(file, emit_chunks=True).records


def _sort(
    record: McapRecord,
    schemas: dict[int, Schema],
    channels: dict[int, Channel],
    topics: dict[int, Topic],
) -> None:
    match record:
        case Schema():
            schemas[record.id] = record
        case Channel():
            channels[record.id] = record
        case Message():
            topics[record.channel_id].add(record)
        case _:
            return  # indexes and statistics: offsets


def _kept(metadata: Mapping[str, str]) -> dict[str, str]:
    return {key: value for key, value in metadata.items() if key not in OF_THE_INSTALLATION}
