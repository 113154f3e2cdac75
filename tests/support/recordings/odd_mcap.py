"""Writes recordings again as other programs do: valid MCAP, none of it as rigd writes.

Most files are written with the `mcap` package. What that cannot write, such as a file without an
end of its data, is put together here from the specification (https://mcap.dev/spec) alone.
"""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from io import BytesIO
from pathlib import Path
from typing import Any

import lz4.frame
import numpy as np
import zstandard
from mcap.reader import make_reader
from mcap.records import Attachment, Channel, Message, Metadata, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, IndexType, Writer

MAGIC = b"\x89MCAP0\r\n"


@dataclass(frozen=True)
class Content:
    """What a file holds: messages in the order of the file."""

    schemas: dict[int, Schema]
    channels: dict[int, Channel]
    messages: list[Message]
    attachments: list[Attachment]
    metadata: list[Metadata]

    def changed(self, change: Callable[[Message], Message]) -> Content:
        """Return the same with each message changed."""
        return replace(self, messages=[change(message) for message in self.messages])


def content_of(path: Path) -> Content:
    """Return all of a file as the reader of the `mcap` package gives it."""
    with path.open("rb") as file:
        reader = make_reader(file)
        summary = reader.get_summary()
        assert summary is not None
        messages = [message for _, _, message in reader.iter_messages()]
        attachments, metadata = list(reader.iter_attachments()), list(reader.iter_metadata())
    return Content(summary.schemas, summary.channels, messages, attachments, metadata)


def messages_in(data: bytes) -> dict[str, list[tuple[int, int, int, bytes]]]:
    """Return every message that the `mcap` package finds, by topic, in the order of the file.

    Each as (log time, number, publish time, content). It reads from the start of the data on and
    ends at the first record that it cannot read.
    """
    topics: dict[int, str] = {}
    found: dict[str, list[tuple[int, int, int, bytes]]] = {}
    try:
        for record in StreamReader(BytesIO(data)).records:
            if isinstance(record, Channel):
                topics[record.id] = record.topic
            elif isinstance(record, Message):
                key = record.log_time, record.sequence, record.publish_time, bytes(record.data)
                found.setdefault(topics[record.channel_id], []).append(key)
    except Exception:  # noqa: BLE001  # a damaged file: it has many errors of its own for that
        pass
    return found


def write(content: Content, target: Path, *, library: str = "another", **options: Any) -> None:
    """Write with the `mcap` package."""
    with target.open("wb") as out:
        writer = Writer(out, **options)
        writer.start("", library)
        schemas = {
            number: writer.register_schema(schema.name, schema.encoding, schema.data)
            for number, schema in content.schemas.items()
        }
        numbers = {
            number: writer.register_channel(
                channel.topic,
                channel.message_encoding,
                schemas.get(channel.schema_id, 0),
                dict(channel.metadata),
            )
            for number, channel in content.channels.items()
        }
        for item in content.attachments:
            writer.add_attachment(
                item.create_time, item.log_time, item.name, item.media_type, item.data
            )
        for record in content.metadata:
            writer.add_metadata(record.name, dict(record.metadata))
        for message in content.messages:
            writer.add_message(
                numbers[message.channel_id],
                message.log_time,
                message.data,
                message.publish_time,
                message.sequence,
            )
        writer.finish()  # type: ignore[no-untyped-call]  # the library leaves it untyped


@dataclass
class Raw:
    """A file that is put together record by record."""

    data: bytearray = field(default_factory=lambda: bytearray(MAGIC))

    def add(self, opcode: int, content: bytes) -> None:
        """Add a record."""
        self.data += record(opcode, content)

    def define(self, content: Content, behind: bytes = b"") -> None:
        """Add the header and all definitions, each with bytes of a later version behind it."""
        self.add(0x01, text("") + text("put together") + behind)
        self.data += definitions(content, behind)

    def keep(self, content: Content) -> None:
        """Add the attachments and the metadata."""
        for item in content.attachments:
            body = struct.pack("<QQ", item.log_time, item.create_time)
            body += text(item.name) + text(item.media_type)
            body += struct.pack("<Q", len(item.data)) + item.data
            self.add(0x09, body + struct.pack("<I", 0))
        for entry in content.metadata:
            self.add(0x0C, text(entry.name) + texts(entry.metadata))

    def chunk(
        self, records: bytes, times: Sequence[int] = (), compression: str = "", *, crc: bool = False
    ) -> None:
        """Add a chunk without message index."""
        packed = {
            "": bytes,
            "lz4": lz4.frame.compress,
            "zstd": zstandard.ZstdCompressor().compress,
        }.get(compression, bytes)(records)
        head = struct.pack(
            "<QQQI",
            min(times, default=0),
            max(times, default=0),
            len(records),
            zlib.crc32(records) if crc else 0,
        )
        self.add(0x06, head + text(compression) + struct.pack("<Q", len(packed)) + packed)

    def end(self, *, data_end: bool = True) -> bytes:
        """Return the file, with a footer and without a summary."""
        if data_end:
            self.add(0x0F, bytes(4))
        self.add(0x02, bytes(20))
        return bytes(self.data + MAGIC)


def record(opcode: int, content: bytes) -> bytes:
    """Return a record with its frame."""
    return struct.pack("<BQ", opcode, len(content)) + content


def text(value: str) -> bytes:
    """Return a text as MCAP has it."""
    return struct.pack("<I", len(value.encode())) + value.encode()


def texts(values: dict[str, str]) -> bytes:
    """Return texts by name as MCAP has them."""
    body = b"".join(text(key) + text(value) for key, value in values.items())
    return struct.pack("<I", len(body)) + body


def definitions(content: Content, behind: bytes = b"") -> bytes:
    """Return the records of all schemas and channels."""
    found = b""
    for schema in content.schemas.values():
        body = struct.pack("<H", schema.id) + text(schema.name) + text(schema.encoding)
        found += record(0x03, body + struct.pack("<I", len(schema.data)) + schema.data + behind)
    for channel in content.channels.values():
        body = struct.pack("<HH", channel.id, channel.schema_id) + text(channel.topic)
        body += text(channel.message_encoding) + texts(dict(channel.metadata))
        found += record(0x04, body + behind)
    return found


def message_record(message: Message) -> bytes:
    """Return the record of a message."""
    head = struct.pack(
        "<HIQQ", message.channel_id, message.sequence, message.log_time, message.publish_time
    )
    return record(0x05, head + message.data)


def parts(messages: Sequence[Message], size: int) -> Iterator[Sequence[Message]]:
    """Yield messages in parts."""
    for at in range(0, len(messages), size):
        yield messages[at : at + size]


def _joined(messages: Iterable[Message]) -> bytes:
    return b"".join(map(message_record, messages))


def _times(messages: Iterable[Message]) -> list[int]:
    return [message.log_time for message in messages]


def _swapped(content: Content) -> Content:
    messages = list(content.messages)
    for at in range(0, len(messages) - 40, 40):
        messages[at], messages[at + 20] = messages[at + 20], messages[at]
    return replace(content, messages=messages)


def _renumbered(content: Content) -> Content:
    """Give all schemas and channels other numbers, those of the channels backwards."""
    numbers = {number: at for at, number in enumerate(sorted(content.channels, reverse=True), 1)}
    numbers |= {number: 300 + at for number, at in numbers.items() if at > 1}
    schemas = {number: 7 * at + 9 for at, number in enumerate(content.schemas)}
    return Content(
        {schemas[old]: replace(schema, id=schemas[old]) for old, schema in content.schemas.items()},
        {
            numbers[old]: replace(channel, id=numbers[old], schema_id=schemas[channel.schema_id])
            for old, channel in content.channels.items()
        },
        [replace(item, channel_id=numbers[item.channel_id]) for item in content.messages],
        content.attachments,
        content.metadata,
    )


def _raw(content: Content, write_messages: Callable[[Raw], None], **end: bool) -> bytes:
    raw = Raw()
    raw.define(content)
    raw.keep(content)
    write_messages(raw)
    return raw.end(**end)


def _private(content: Content, opcode: int) -> bytes:
    """Put records of another kind between chunks, and within them."""

    def write_messages(raw: Raw) -> None:
        for messages in parts(content.messages, 100):
            raw.add(opcode, b"of another program" * 3)
            inner = record(opcode, b"inside").join(map(message_record, messages))
            raw.chunk(inner, _times(messages), "zstd", crc=True)

    return _raw(content, write_messages)


def _mixed(content: Content) -> bytes:
    """Every other part of the messages stands outside of chunks."""

    def write_messages(raw: Raw) -> None:
        for number, messages in enumerate(parts(content.messages, 66)):
            if number % 2:
                raw.data += _joined(messages)
            else:
                raw.chunk(_joined(messages), _times(messages), "lz4", crc=True)

    return _raw(content, write_messages)


def _between(content: Content) -> bytes:
    """Attachments and metadata stand between messages outside of chunks."""

    def write_messages(raw: Raw) -> None:
        for number, messages in enumerate(parts(content.messages, 140)):
            raw.data += _joined(messages)
            raw.add(0x0C, text(f"between {number}") + texts({"at": str(number)}))
            item = Attachment(number, number, f"{number}.txt", "text/plain", b"between")
            raw.keep(Content({}, {}, [], [item], []))

    return _raw(content, write_messages)


def _empty_chunks(content: Content) -> bytes:
    def write_messages(raw: Raw) -> None:
        for messages in parts(content.messages, 180):
            raw.chunk(b"")
            raw.chunk(_joined(messages), _times(messages), "zstd")
            raw.chunk(b"", compression="zstd")

    return _raw(content, write_messages)


def _defined_again(content: Content) -> bytes:
    """Each chunk holds all definitions, the data section none."""
    raw = Raw()
    raw.add(0x01, text("") + text("put together"))
    raw.keep(content)
    for number, messages in enumerate(parts(content.messages, 160)):
        packing = ("", "lz4", "zstd")[number % 3]
        inner = definitions(content) + _joined(messages)
        raw.chunk(inner, _times(messages), packing, crc=number % 2 > 0)
    return raw.end()


def _extended(content: Content) -> bytes:
    """Records have fields of a later version of the format behind their own."""
    raw = Raw()
    raw.define(content, b"later")
    raw.keep(content)
    for messages in parts(content.messages, 160):
        raw.chunk(_joined(messages), _times(messages), "zstd")
    return raw.end()


def _no_data_end(content: Content) -> bytes:
    return _raw(content, lambda raw: raw.data.extend(_joined(content.messages)), data_end=False)


def _big_endian(message: Message, sizes: dict[int, int]) -> Message:
    """Return a message of float64s in the other byte order."""
    if message.channel_id not in sizes:
        return message
    values = np.frombuffer(message.data, "<f8", sizes[message.channel_id], 4)
    behind = np.frombuffer(message.data[4 + values.nbytes :], "<u4").astype(">u4").tobytes()
    return replace(message, data=bytes(4) + values.astype(">f8").tobytes() + behind)


def _floats(content: Content) -> dict[int, int]:
    """Return the number of float64s of each channel that has nothing before them."""
    return {
        number: len(json.loads(channel.metadata["rigd.stream"])["channels"])
        for number, channel in content.channels.items()
        if "rigd.stream" in channel.metadata
    }


def _without_slash(content: Content) -> Content:
    channels = {
        number: replace(channel, topic=channel.topic.removeprefix("/"))
        if "rigd.stream" in channel.metadata
        else channel
        for number, channel in content.channels.items()
    }
    return replace(content, channels=channels)


def with_package(change: Callable[[Content], Content] = lambda same: same, **options: Any) -> Make:
    """Return what writes a changed content with the `mcap` package."""

    def make(content: Content, target: Path) -> None:
        write(change(content), target, **{"chunk_size": 12_000, **options})

    return make


def put_together(build: Callable[[Content], bytes]) -> Make:
    """Return what writes the bytes of a file."""

    def make(content: Content, target: Path) -> None:
        target.write_bytes(build(content))

    return make


Make = Callable[[Content, Path], None]
_NO_SUMMARY: dict[str, Any] = {
    "index_types": IndexType.NONE, "repeat_channels": False, "use_statistics": False,
    "use_summary_offsets": False,
}  # fmt: skip

#: Valid files by name; each holds all messages of the recording that it is made of.
VALID: dict[str, Make] = {
    "mixed channels": with_package(),
    "no chunks": with_package(use_chunking=False),
    "no chunks, no summary": with_package(use_chunking=False, **_NO_SUMMARY),
    "chunks of lz4": with_package(compression=CompressionType.LZ4),
    "chunks of plain bytes": with_package(compression=CompressionType.NONE),
    "no CRC": with_package(enable_crcs=False),
    "CRC of the data": with_package(enable_data_crcs=True),
    "no summary": with_package(**_NO_SUMMARY),
    "no message index": with_package(index_types=IndexType.ALL & ~IndexType.MESSAGE),
    "no chunk index": with_package(index_types=IndexType.ALL & ~IndexType.CHUNK),
    "no index of attachments": with_package(index_types=IndexType.CHUNK | IndexType.MESSAGE),
    "no statistics": with_package(use_statistics=False),
    "definitions in the data alone": with_package(repeat_channels=False, repeat_schemas=False),
    "no summary offsets": with_package(use_summary_offsets=False),
    "swapped": with_package(_swapped),
    "reversed": with_package(
        lambda content: replace(content, messages=content.messages[::-1])
    ),
    "every message twice": with_package(
        lambda content: replace(content, messages=[m for m in content.messages for _ in "ab"])
    ),
    "merged copies": with_package(
        lambda content: replace(content, messages=content.messages * 2)
    ),
    "numbers from 1": with_package(
        lambda content: content.changed(lambda m: replace(m, sequence=m.sequence + 1))
    ),
    "no numbers": with_package(
        lambda content: content.changed(lambda m: replace(m, sequence=0))
    ),
    "published later": with_package(
        lambda content: content.changed(lambda m: replace(m, publish_time=m.log_time + 1_000))
    ),
    "options of CDR": with_package(
        lambda content: content.changed(
            lambda m: replace(m, data=m.data[:2] + b"\x00\x03" + m.data[4:])
            if m.channel_id in _floats(content)
            else m
        )
    ),
    "padded": with_package(
        lambda content: content.changed(
            lambda m: replace(m, data=m.data + bytes(3)) if m.channel_id in _floats(content) else m
        )
    ),
    "big-endian": with_package(
        lambda content: content.changed(lambda m: _big_endian(m, _floats(content)))
    ),
    "topics without slash": with_package(_without_slash),
    "rigd's name": with_package(library="rigd 0.1"),
    "no name": with_package(library=""),
    "other numbers": put_together(
        lambda content: _raw(
            (found := _renumbered(content)),
            lambda raw: raw.chunk(_joined(found.messages), _times(found.messages), "zstd"),
        )
    ),
    "private records": put_together(lambda content: _private(content, 0x80)),
    "records of a later version": put_together(lambda content: _private(content, 0x20)),
    "longer records": put_together(_extended),
    "half in chunks": put_together(_mixed),
    "attachments between": put_together(_between),
    "empty chunks": put_together(_empty_chunks),
    "defined in each chunk": put_together(_defined_again),
    "no end of the data": put_together(_no_data_end),
}  # fmt: skip
