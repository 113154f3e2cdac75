"""Builds the records before the samples: schemas, channels, attachments and metadata."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from mcap import records as mcap
from mcap.well_known import MessageEncoding, Profile, SchemaEncoding

from rigd import __version__
from rigd.model import RecordingError, Stream
from rigd.record.mcap import schema
from rigd.record.mcap.contents import Contents
from rigd.record.mcap.wire import MAGIC, encode

#: Metadata record that rigd itself reads back.
FORMAT_METADATA: Final = "rigd"
#: Metadata record of a recording that was repaired; its run counts as interrupted.
RECOVERY_METADATA: Final = "recovery"
GAPS_KEY: Final = "lost_rows"  #: in it: the gaps, as JSON
LIBRARY: Final = "rigd "  #: the beginning of the library name in the header of a file by rigd
START_KEY: Final = "start_ns"


@dataclass(frozen=True)
class Attachment:
    """A file kept whole in the recording, such as the rig file and the procedure."""

    name: str
    media_type: str
    data: bytes


def build_prefix(
    streams: Sequence[Stream],
    metadata: Mapping[str, Mapping[str, str]],
    attachments: Sequence[Attachment],
    start_ns: int,
) -> tuple[bytes, Contents]:
    """Return the beginning of a file up to its first chunk, and the index of it.

    Raises:
        RecordingError: a stream, metadata or attachment cannot be recorded.

    """
    schema.check_streams(streams)
    if FORMAT_METADATA in metadata:
        raise RecordingError(f"metadata named {FORMAT_METADATA!r} is the recording's own")
    contents = Contents()
    data = bytearray(MAGIC)
    data += encode(mcap.Header(Profile.ROS2, f"{LIBRARY}{__version__}"))
    define_own(schema.EVENTS_CHANNEL, contents)
    types = schema.type_names(streams)
    numbered = enumerate(zip(streams, types, strict=True), schema.EVENTS_CHANNEL + 1)
    for number, (stream, name) in numbered:
        text = schema.schema_text(stream)
        contents.schemas[number] = mcap.Schema(number, text.encode(), SchemaEncoding.ROS2, name)
        contents.channels[number] = mcap.Channel(
            number,
            f"/{stream.name}",
            MessageEncoding.CDR,
            schema.channel_metadata(stream),
            number,
        )
    if schema.TRIAL_TOPIC not in {channel.topic for channel in contents.channels.values()}:
        define_own(schema.TRIAL_CHANNEL, contents)
    for kind in (contents.schemas, contents.channels):
        for record in kind.values():
            data += encode(record)
    own = {FORMAT_METADATA: {START_KEY: str(start_ns), "version": __version__}}
    data += build_extras({**own, **metadata}, attachments, start_ns, len(data), contents)
    return bytes(data), contents


def define_own(number: int, contents: Contents) -> mcap.Channel:
    """Define a channel of rigd's own, which is the same in every recording; return it."""
    topic, name, text = schema.OWN_TOPICS[number]
    channel = mcap.Channel(number, topic, MessageEncoding.CDR, {}, number)
    contents.schemas[number] = mcap.Schema(number, text.encode(), SchemaEncoding.ROS2, name)
    contents.channels[number] = channel
    return channel


def build_extras(
    metadata: Mapping[str, Mapping[str, str]],
    attachments: Sequence[Attachment],
    start_ns: int,
    offset: int,
    contents: Contents,
) -> bytes:
    """Return metadata and attachments as records that begin at ``offset``; index them too."""
    data = bytearray()
    for attachment in attachments:
        record = encode(
            mcap.Attachment(
                create_time=start_ns,
                log_time=start_ns,
                name=attachment.name,
                media_type=attachment.media_type,
                data=attachment.data,
            )
        )
        contents.attachments.append(
            mcap.AttachmentIndex(
                offset=offset + len(data),
                length=len(record),
                log_time=start_ns,
                create_time=start_ns,
                data_size=len(attachment.data),
                name=attachment.name,
                media_type=attachment.media_type,
            )
        )
        data += record
    for name, values in metadata.items():
        record = encode(mcap.Metadata(name, dict(values)))
        contents.metadata.append(mcap.MetadataIndex(offset + len(data), len(record), name))
        data += record
    return bytes(data)
