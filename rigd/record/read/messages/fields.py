"""Decodes the messages of other programs to columns of numbers: JSON, and ROS 2 of any type."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from typing import Any

from mcap.records import Channel, Schema

from rigd.model import Channel as Column
from rigd.model import Stream
from rigd.model.rows import TIME_FIELD
from rigd.record.read.messages.ros2msg import numbers_of

#: Returns the values of the columns of a message, NaN where it has none.
Decode = Callable[[memoryview], tuple[float, ...]]

_NAN = float("nan")


def columns_of(
    channel: Channel, schema: Schema | None, first: bytes
) -> tuple[Stream, Decode] | None:
    """Return the columns of a channel and what decodes its messages; None if nothing does.

    ``first`` is the content of its first message.
    """
    if channel.message_encoding == "json":
        return _of_json(channel.topic, schema, first)
    if channel.message_encoding == "cdr" and schema is not None and schema.encoding == "ros2msg":
        found = numbers_of(schema.data.decode(errors="replace"))
        if found is not None:
            names, decode = found
            columns = tuple(Column(_free(name)) for name in names)
            return Stream(channel.topic.removeprefix("/"), columns), decode
    return None


def _free(name: str) -> str:
    """Return the name of a column, which must not be that of the times."""
    return f"message_{name}" if name == TIME_FIELD else name


def _of_json(topic: str, schema: Schema | None, first: bytes) -> tuple[Stream, Decode] | None:
    """Return the numbers and truth values of JSON objects, nested ones as ``a.b``."""
    described: dict[str, str] = {}
    if schema is not None and schema.encoding == "jsonschema":
        described = dict(_described(_loaded(schema.data)))
    paths = dict.fromkeys((*described, *(path for path, _ in _leaves(_loaded(first)))))
    if not paths:
        return None
    columns = tuple(Column(_free(path), doc=described.get(path, "")) for path in paths)

    def decode(payload: memoryview) -> tuple[float, ...]:
        values = dict(_leaves(_loaded(bytes(payload))))
        return tuple(values.get(path, _NAN) for path in paths)

    return Stream(topic.removeprefix("/"), columns), decode


def _loaded(data: bytes) -> Any:
    """Return what a JSON text means, None if it is none."""
    try:
        return json.loads(data)
    except (ValueError, RecursionError):
        return None


def _leaves(value: Any, path: str = "") -> Iterator[tuple[str, float]]:
    """Yield the name and value of each number in a JSON object, or of a number alone."""
    if isinstance(value, bool | int | float):
        with suppress(OverflowError):  # an integer beyond 1e308
            yield path or "value", float(value)
    elif isinstance(value, Mapping):
        for key, item in value.items():
            yield from _leaves(item, f"{path}.{key}" if path else str(key))


def _described(schema: Any, path: str = "") -> Iterator[tuple[str, str]]:
    """Yield the name and description of each number that a JSON Schema states."""
    if not isinstance(schema, Mapping):
        return
    properties = schema.get("properties")
    if isinstance(properties, Mapping):
        for key, item in properties.items():
            yield from _described(item, f"{path}.{key}" if path else str(key))
    elif path and schema.get("type") in ("number", "integer", "boolean"):
        yield path, str(schema.get("description", ""))
