"""Finds which topics of a file have columns, and how the messages of each are decoded.

rigd writes every stream as CDR messages of float64s, and describes it in the metadata of the
channel. Of other programs, those of the encodings in :mod:`~rigd.record.read.messages.fields` are
decoded too.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from mcap import records as mcap

from rigd.model import Stream
from rigd.record.mcap.contents import Contents
from rigd.record.mcap.schema import (
    EVENTS_STREAM,
    EVENTS_TOPIC,
    EVENTS_TYPE,
    STREAM_KEY,
    TRIAL_TOPIC,
    TRIAL_TYPE,
    stream_from_json,
    stream_from_schema,
)
from rigd.record.mcap.wire import Malformed
from rigd.record.read.messages.chunk_rows import Channels
from rigd.record.read.messages.fields import Decode, columns_of

_OWN = {EVENTS_TOPIC: EVENTS_TYPE, TRIAL_TOPIC: TRIAL_TYPE}


@dataclass(frozen=True)
class Topic:
    """A topic that rigd does not read as columns: its encodings, and how many messages it has."""

    topic: str
    encoding: str  #: of the messages
    schema: str  #: name of their type; empty if they have none
    schema_encoding: str
    messages: int

    def __str__(self) -> str:
        """Return all of it in words."""
        kind = f" {self.schema}" if self.schema else ""
        messages = f"{self.messages} message{'' if self.messages == 1 else 's'}"
        return f"{self.topic} ({self.encoding or 'unknown encoding'}{kind}, {messages})"


@dataclass
class Topics:
    """The streams by name with their channels, rigd's events, and the topics that are neither.

    ``decoders`` are those of the channels whose messages are no plain float64s.
    """

    streams: dict[str, Stream] = field(default_factory=dict)
    channels: dict[str, Channels] = field(default_factory=dict)
    events: Channels = ()
    decoders: dict[int, Decode] = field(default_factory=dict)
    others: list[Topic] = field(default_factory=list)


def topics_in(contents: Contents, firsts: Mapping[int, bytes], *, others: bool) -> Topics:
    """Return the topics of a file; ``firsts`` has the first content of channels by number.

    ``others``: another program wrote it.

    Raises:
        Malformed: a channel of rigd states a stream that is none.
    """
    found = Topics()
    for number, channel in contents.channels.items():
        schema = contents.schemas.get(channel.schema_id)
        if _is_own(channel, schema, others=others):
            if channel.topic == EVENTS_TOPIC:
                found.events = (*found.events, number)
            continue
        stream, decode = _stream(channel, schema, others=others), None
        if stream is None and others:
            read = columns_of(channel, schema, firsts.get(number, b""))
            stream, decode = (None, None) if read is None else read
        name = channel.topic.removeprefix("/")
        if name == EVENTS_STREAM:  # the name of the table of rigd's events
            name = f"other_{name}"
        if stream is not None and name:
            stream = stream if stream.name == name else replace(stream, name=name)
            if found.streams.setdefault(name, stream) == stream:
                found.channels[name] = (*found.channels.get(name, ()), number)
                if decode is not None:
                    found.decoders[number] = decode
                continue
        found.others.append(
            Topic(
                channel.topic,
                channel.message_encoding,
                "" if schema is None else schema.name,
                "" if schema is None else schema.encoding,
                contents.counts.get(number, 0),
            )
        )
    return found


def _is_own(channel: mcap.Channel, schema: mcap.Schema | None, *, others: bool) -> bool:
    """Return whether a channel has the events of rigd, or its marks of trials."""
    kind = _OWN.get(channel.topic)
    if kind is None or not others:
        # One of rigd's whose stream is named so has a description, see `check_streams`.
        return kind is not None and STREAM_KEY not in channel.metadata
    return schema is not None and schema.name == kind and channel.message_encoding == "cdr"


def _stream(channel: mcap.Channel, schema: mcap.Schema | None, *, others: bool) -> Stream | None:
    """Return the stream of a channel whose messages are plain float64s, else None."""
    plain = None
    if others or STREAM_KEY not in channel.metadata:
        if channel.message_encoding != "cdr":
            return None
        if schema is not None:
            if schema.encoding != "ros2msg":
                return None
            plain = stream_from_schema(channel.topic, schema.data.decode(errors="replace"))
    if STREAM_KEY not in channel.metadata:
        return plain
    try:
        stream = stream_from_json(channel.metadata[STREAM_KEY])
    except ValueError as error:
        if others:
            return plain
        raise Malformed(f"channel {channel.topic}: {error}") from error
    same = plain is None or _fields(plain) == _fields(stream)
    return stream if same else plain


def _fields(stream: Stream) -> tuple[object, ...]:
    return (*(channel.name for channel in stream.channels), stream.has_status)
