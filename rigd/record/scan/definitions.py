"""Checks the channel definitions of a recording, and replaces definitions that are lost.

No CRC of its own protects a schema or channel record. But rigd writes the name and the number of a
channel twice, and both copies must agree. If a channel record is lost, rigd takes its content from
the schema, which also names the fields and units.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

from mcap.records import Channel, Schema
from mcap.well_known import MessageEncoding, SchemaEncoding

from rigd.model import Channel as Column
from rigd.model import RecordingError, Stream
from rigd.model.rows import row_dtype
from rigd.record.mcap.contents import Contents
from rigd.record.mcap.schema import (
    OWN_TOPICS,
    STREAM_KEY,
    channel_metadata,
    check_streams,
    schema_text,
    stream_from_json,
    stream_from_schema,
    type_names,
)
from rigd.record.mcap.wire import Malformed


def check_channel(channel: Channel) -> None:
    """Check that the two copies of rigd's data in a channel agree; other writers have one.

    Raises:
        Malformed: they differ.
    """
    if STREAM_KEY not in channel.metadata:
        return
    try:
        stream = stream_from_json(channel.metadata[STREAM_KEY])
        check_streams([stream])
    except (ValueError, RecordingError) as error:
        raise Malformed(f"a damaged definition of {channel.topic}: {error}") from error
    if (channel.topic, channel.schema_id) != (f"/{stream.name}", channel.id):
        raise Malformed(f"a definition of {channel.topic} that contradicts itself")


def replace_channel(number: int, value_bytes: int, known: Contents) -> Channel:
    """Define a channel whose definition is lost, in ``known``; return it.

    Its messages have ``value_bytes`` after the CDR header. Its stream is named after the type of
    its schema. Without a schema, values are float64s, then a status word if four bytes are left
    over; their names and units are not known.
    """
    stream = _stream_of_type(known.schemas.get(number))
    taken = {channel.topic for channel in known.channels.values()}
    if stream and row_dtype(stream).itemsize == 8 + value_bytes and f"/{stream.name}" not in taken:
        metadata: Mapping[str, str] = channel_metadata(stream)
    else:
        columns = tuple(Column(f"c{position}") for position in range(value_bytes // 8))
        stream = Stream(f"unnamed_{number}", columns, has_status=value_bytes % 8 == 4)
        known.schemas[number] = _schema(number, f"rigd/msg/Unnamed{number}", schema_text(stream))
        metadata = {}
    topic = f"/{stream.name}"
    channel = Channel(number, topic, MessageEncoding.CDR, dict(metadata), number)
    known.channels[number] = channel
    return channel


def has_own(number: int, known: Contents) -> bool:
    """Return whether a channel of rigd's own is defined as rigd defines it."""
    channel = known.channels.get(number)
    return (
        channel is not None
        and (channel.topic, channel.schema_id) == (OWN_TOPICS[number][0], number)
        and number in known.schemas
    )


def replace_schema(channel: Channel, known: Contents) -> None:
    """Define the schema of a stream's channel again, from the stream in the channel."""
    stream = stream_from_json(channel.metadata[STREAM_KEY])
    (name,) = type_names([stream])
    known.schemas[channel.schema_id] = _schema(channel.schema_id, name, schema_text(stream))


def _stream_of_type(schema: Schema | None) -> Stream | None:
    """Return the stream that rigd made a schema for; None if it is no such schema."""
    if schema is None:
        return None
    words = re.sub(r"(?<=.)(?=[A-Z])", "_", schema.name.rpartition("/")[2])
    stream = stream_from_schema(f"/{words.lower()}", schema.data.decode(errors="replace"))
    if stream is None or type_names([stream]) != [schema.name]:
        return None
    try:
        check_streams([stream])
    except RecordingError:
        return None
    return stream


def _schema(number: int, name: str, text: str) -> Schema:
    return Schema(number, text.encode(), SchemaEncoding.ROS2, name)
