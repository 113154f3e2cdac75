"""Encodes and decodes events, which are the things that happened during a run beside the samples.

Each event is one CDR message on ``/events``.
"""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from mcap.opcode import Opcode

from rigd.record.mcap.wire import FRAME, Malformed

#: Trial number of an event outside of every trial.
NO_TRIAL: Final = -1

CDR_HEADER: Final = b"\x00\x01\x00\x00"  #: plain CDR, little-endian, no options
MESSAGE_FIELDS: Final = struct.Struct("<HIQQ")  #: channel, sequence, log time, publish time
_LENGTH: Final = struct.Struct("<I")
_TRIAL: Final = struct.Struct("<i")


@dataclass(frozen=True)
class Event:
    """An event at ``t_ns`` (ns since the Unix epoch), with its data."""

    t_ns: int
    kind: str
    trial: int = NO_TRIAL
    data: Mapping[str, Any] = field(default_factory=dict)


def event_payload(event: Event, start_ns: int) -> bytes:
    """Return an event as a message, in CDR; its ``time`` counts from ``start_ns``.

    Raises:
        TypeError: the data holds something that JSON has no form for.

    """
    text = data_to_json(event.data)
    body = cdr_string(event.kind)
    body += b"\x00" * (-len(body) % 4) + struct.pack("<i", event.trial)
    # CDR counts alignment from the end of its own header.
    body += b"\x00" * (-len(body) % 8) + struct.pack("<d", (event.t_ns - start_ns) * 1e-9)
    return CDR_HEADER + body + cdr_string(text)


def message_record(t_ns: int, payload: bytes, channel: int, sequence: int) -> bytes:
    """Return a complete Message record, logged and published at ``t_ns``."""
    head = MESSAGE_FIELDS.pack(channel, sequence & 0xFFFFFFFF, t_ns, t_ns)
    return FRAME.pack(Opcode.MESSAGE, len(head) + len(payload)) + head + payload


def cdr_string(text: str) -> bytes:
    """Return a text in CDR: its length, its bytes, a zero; begins at a multiple of 4 bytes."""
    encoded = text.encode() + b"\x00"
    return _LENGTH.pack(len(encoded)) + encoded


def data_to_json(data: Mapping[str, Any]) -> str:
    """Return an event's data as JSON; a NaN or infinity as text that ``float()`` takes.

    Raises:
        TypeError: it holds something that JSON has no form for.

    """
    return json.dumps(_plain(data), ensure_ascii=False, separators=(",", ":"), allow_nan=False)


def parse_event(t_ns: int, payload: memoryview, loads: Callable[[str], Any] = json.loads) -> Event:
    """Return the event in a message's payload; ``loads`` reads the JSON of its data.

    Raises:
        Malformed: the payload is not an event as :func:`event_payload` writes it.

    """
    if bytes(payload[:4]) != CDR_HEADER:
        raise Malformed("an event that is not little-endian CDR")
    body = bytes(payload[4:])
    try:
        kind, at = _read_string(body, 0)
        at += -at % 4
        (trial,) = _TRIAL.unpack_from(body, at)
        at += 4
        at += -at % 8 + 8  # the time repeats t_ns
        text, _ = _read_string(body, at)
        data = loads(text)
    except (struct.error, ValueError, RecursionError) as error:
        raise Malformed(f"a damaged event ({error})") from error
    if not isinstance(data, dict):
        raise Malformed("an event whose data is no JSON object")
    return Event(t_ns, kind, trial, data)


def _read_string(body: bytes, at: int) -> tuple[str, int]:
    (length,) = _LENGTH.unpack_from(body, at)
    end = at + 4 + length
    if length < 1 or end > len(body):
        raise Malformed("a text that is longer than its event")
    return body[at + 4 : end - 1].decode(), end


def _plain(value: object) -> object:
    """Return ``value`` in types of JSON."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if hasattr(value, "tolist"):  # numpy scalars and arrays
        return _plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return repr(value)
    return value
