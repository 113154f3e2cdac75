"""Describes a stream as a ROS 2 message type: text for viewers, JSON for the reader.

Field names and types follow https://docs.ros.org/en/rolling/Concepts/Basic/About-Interfaces.html.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping, Sequence
from typing import Any, Final

from rigd.model import Channel, RecordingError, Stream
from rigd.model.channels import STATUS_FIELD
from rigd.model.rows import TIME_FIELD

#: Key of the channel metadata that holds the exact Stream as JSON.
STREAM_KEY: Final = "rigd.stream"
EVENTS_STREAM: Final = "events"
EVENTS_TOPIC: Final = "/events"
EVENTS_TYPE: Final = "rigd/msg/Event"
EVENTS_SCHEMA: Final = """\
# What happened: trials, steps, prompts, trips. `time` is in s since the recording's start_ns.
string kind
# number of the trial, -1 outside of one
int32 trial
float64 time
# JSON object; numbers that JSON lacks are the strings "nan", "inf", "-inf"
string data
"""

EVENTS_CHANNEL: Final = 1  #: so that streams follow from 2
TRIAL_TOPIC: Final = "/trial"
TRIAL_TYPE: Final = "rigd/msg/TrialMark"
TRIAL_SCHEMA: Final = """\
# Trial and step from this time on, for viewers; /events has all that is known of them.
# number of the trial, -1 outside of one
int32 number
# number of the trial among those of the same point, -1 outside of one
int32 repeat
# steps entered before it, in its trial or since the last one; -1 outside of one
int32 step
string step_name
"""
TRIAL_CHANNEL: Final = 2**16 - 1  #: the last one, behind all streams
#: The topics that are rigd's own: topic, type and definition, by the number of the channel.
OWN_TOPICS: Final = {
    EVENTS_CHANNEL: (EVENTS_TOPIC, EVENTS_TYPE, EVENTS_SCHEMA),
    TRIAL_CHANNEL: (TRIAL_TOPIC, TRIAL_TYPE, TRIAL_SCHEMA),
}

_FIELD: Final = re.compile(r"[A-Za-z][A-Za-z0-9_]*\Z")
_STREAM: Final = re.compile(r"[A-Za-z][A-Za-z0-9_]*(/[A-Za-z0-9_]+)*\Z")
_PLAIN_LINE: Final = re.compile(r"(?P<type>float64|uint32)\s+(?P<name>[A-Za-z][A-Za-z0-9_]*)\Z")
#: The comment of :func:`_describe`.
_DESCRIBED: Final = re.compile(
    r"# \[(?P<unit>[^]]+)\]; range (?P<low>\S+) \.\. (?P<high>[^\s;]+)"
    r"(?:; raw reading of (?P<raw_of>\w+))?(?:; (?P<doc>.*))?"
)


def check_streams(streams: Sequence[Stream]) -> None:
    """Refuse streams that no ROS 2 message can hold.

    Raises:
        RecordingError: a name is taken twice, reserved or no identifier, or a stream is empty.

    """
    seen: set[str] = set()
    for stream in streams:
        if not _STREAM.match(stream.name) or stream.name == EVENTS_STREAM:
            raise RecordingError(
                f"a stream cannot be recorded under the name {stream.name!r}",
                hint="Use letters, digits and _, beginning with a letter; 'events' is taken.",
            )
        if stream.name in seen:
            raise RecordingError(f"two streams are named {stream.name!r}")
        seen.add(stream.name)
        fields = [channel.name for channel in stream.channels]
        if not fields:
            raise RecordingError(f"stream {stream.name!r} has no channels to record")
        reserved = {TIME_FIELD, STATUS_FIELD} if stream.has_status else {TIME_FIELD}
        for field in fields:
            if not _FIELD.match(field) or field in reserved or fields.count(field) > 1:
                raise RecordingError(
                    f"channel {field!r} of stream {stream.name!r} cannot be a field's name",
                    hint=f"Use a name of its own of letters, digits and _, not {sorted(reserved)}.",
                )


def type_names(streams: Sequence[Stream]) -> list[str]:
    """Return a ROS 2 type name for each stream, ``rigd/msg/WheelServo``; no name twice."""
    names: list[str] = []
    for position, stream in enumerate(streams):
        words = re.split(r"[_/]+", stream.name)
        name = "rigd/msg/" + "".join(word[:1].upper() + word[1:] for word in words)
        taken = name in (*names, EVENTS_TYPE, TRIAL_TYPE)
        names.append(f"{name}{position}" if taken else name)
    return names


def schema_text(stream: Stream) -> str:
    """Return the ``ros2msg`` definition of one row, with unit, range and source as comments."""
    lines = [f"# {_one_line(text)}" for text in (stream.doc, _from(stream)) if text]
    for channel in stream.channels:
        lines += [f"# {_one_line(_describe(channel))}", f"float64 {channel.name}"]
    if stream.has_status:
        lines += ["# status word as the device reports it", f"uint32 {STATUS_FIELD}"]
    return "\n".join(lines) + "\n"


def channel_metadata(stream: Stream) -> dict[str, str]:
    """Return the metadata of a stream's MCAP channel: for people, and exact JSON for the reader."""
    metadata = {STREAM_KEY: stream_to_json(stream), "source": stream.source, "doc": stream.doc}
    for channel in stream.channels:
        metadata[f"{channel.name}.unit"] = channel.unit
        if channel.display:
            metadata[f"{channel.name}.display"] = channel.display
        metadata[f"{channel.name}.range"] = _range(channel)
        if channel.doc:
            metadata[f"{channel.name}.doc"] = channel.doc
    return metadata


def stream_to_json(stream: Stream) -> str:
    """Return the stream as JSON; an open end of a range is null."""
    channels = [
        {
            "name": channel.name,
            "unit": channel.unit,
            "doc": channel.doc,
            "low": channel.low if math.isfinite(channel.low) else None,
            "high": channel.high if math.isfinite(channel.high) else None,
            "raw_of": channel.raw_of,
            **({"display": channel.display} if channel.display else {}),
        }
        for channel in stream.channels
    ]
    record = {
        "name": stream.name,
        "doc": stream.doc,
        "source": stream.source,
        "has_status": stream.has_status,
        "channels": channels,
    }
    return json.dumps(record, ensure_ascii=False, separators=(",", ":"))


def stream_from_json(text: str) -> Stream:
    """Return the stream that :func:`stream_to_json` wrote.

    Raises:
        ValueError: the text is not such JSON.

    """
    try:
        record: Mapping[str, Any] = json.loads(text)
        channels = tuple(
            Channel(
                name=str(channel["name"]),
                unit=str(channel["unit"]),
                doc=str(channel["doc"]),
                low=-math.inf if channel["low"] is None else float(channel["low"]),
                high=math.inf if channel["high"] is None else float(channel["high"]),
                raw_of=channel["raw_of"],
                display=str(channel.get("display", "")),
            )
            for channel in record["channels"]
        )
        return Stream(
            name=str(record["name"]),
            channels=channels,
            doc=str(record["doc"]),
            has_status=bool(record["has_status"]),
            source=str(record["source"]),
        )
    except (KeyError, TypeError) as error:
        raise ValueError(f"not the description of a stream: {error!r}") from error


def stream_from_schema(topic: str, text: str) -> Stream | None:
    """Return the stream of a ``ros2msg`` type, or None if it is not plain float64s.

    Descriptions that rigd has written into the comment above a field are used too.
    """
    channels: list[Channel] = []
    has_status = False
    comment = ""
    for line in text.splitlines():
        plain = line.split("#", 1)[0].strip()
        if not plain:
            comment = line
            continue
        match = _PLAIN_LINE.match(plain)
        if match is None or has_status:
            return None
        if match["type"] == "float64":
            channels.append(_described(match["name"], comment))
            comment = ""
        elif match["name"] == STATUS_FIELD:
            has_status = True
        else:
            return None
    names = {channel.name for channel in channels}
    if not channels or len(names) < len(channels) or TIME_FIELD in names:
        return None
    return Stream(topic.removeprefix("/"), tuple(channels), has_status=has_status)


def _from(stream: Stream) -> str:
    return f"from {stream.source}" if stream.source else ""


def _describe(channel: Channel) -> str:
    raw = f"raw reading of {channel.raw_of}" if channel.raw_of else ""
    parts = (f"[{channel.unit}]", f"range {_range(channel)}", raw, channel.doc)
    return "; ".join(part for part in parts if part)


def _described(name: str, comment: str) -> Channel:
    """Return a channel with the description from a comment of :func:`_describe`, if it is one."""
    match = _DESCRIBED.fullmatch(comment)
    if match is None:
        return Channel(name)
    try:
        low, high = float(match["low"]), float(match["high"])
    except ValueError:
        low, high = -math.inf, math.inf
    return Channel(name, match["unit"], match["doc"] or "", low, high, match["raw_of"])


def _range(channel: Channel) -> str:
    return f"{channel.low:.12g} .. {channel.high:.12g}"


def _one_line(text: str) -> str:
    return " ".join(text.split())
