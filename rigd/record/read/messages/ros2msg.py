"""Decodes ROS 2 messages of any type to the numbers in them, by the definition in their schema.

Types: https://docs.ros.org/en/rolling/Concepts/Basic/About-Interfaces.html. The layout is plain CDR
(OMG CDR, version 1): each number at a multiple of its size, counted from behind the header of
four bytes.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Final, NamedTuple

from rigd.record.mcap.wire import Malformed

_NUMBERS: Final = {
    "bool": "?", "byte": "B", "char": "B", "int8": "b", "uint8": "B", "int16": "h", "uint16": "H",
    "int32": "i", "uint32": "I", "int64": "q", "uint64": "Q", "float32": "f", "float64": "d",
}  # fmt: skip
_FIELD: Final = re.compile(
    r"(?P<type>[A-Za-z][\w/]*)(?:<=\d+)?(?:\[(?P<size>(?:<=)?\d*)\])?\s+[A-Za-z]\w*(?:\s+\S.*)?\Z"
)
_CONSTANT: Final = re.compile(r"[\w/<=]+\s+[A-Z]\w*\s*=")
_TEXT: Final = "string"
#: Elements of an array of fixed length that are columns; longer ones are passed over.
_MOST_ELEMENTS: Final = 64
_MOST_DEPTH: Final = 32


class Field(NamedTuple):
    """A field of a type; ``size`` is 1, that of an array, or None if each message has its own."""

    name: str
    type: str
    size: int | None
    array: bool


Types = Mapping[str, tuple[Field, ...]]


@dataclass
class _Cursor:
    """A place in a message."""

    data: memoryview
    order: str  #: of bytes, as ``struct`` has it
    at: int = 0

    def number(self, letter: str) -> float:
        """Return the next number, of the type ``letter`` of ``struct``, as a float."""
        size = struct.calcsize(letter)
        self.at += -self.at % size
        (value,) = struct.unpack_from(self.order + letter, self.data, self.at)
        self.at += size
        return float(value)

    def length(self, least: int) -> int:
        """Return a number of elements of ``least`` bytes each, which must be there."""
        count = int(self.number("I"))
        if count * least > len(self.data) - self.at:
            raise Malformed("a message that is shorter than its type")
        return count


def numbers_of(text: str) -> tuple[list[str], Callable[[memoryview], tuple[float, ...]]] | None:
    """Return the names of the numbers in a message of a type, and what decodes them.

    Numbers of nested types are named ``pose.x``, elements of arrays of fixed length ``force.0``.
    Texts, and arrays whose length each message states, are passed over. None if the definition
    has no number, or something else than the format states.
    """
    try:
        types = _types(text)
        names = list(_number_names(types, "", ""))
    except Malformed:
        return None
    if not names or len(set(names)) < len(names):
        return None

    def decode(payload: memoryview) -> tuple[float, ...]:
        if len(payload) < 4 or payload[0] or payload[1] > 1:
            raise Malformed("a message that is not plain CDR")
        cursor = _Cursor(payload[4:], "<" if payload[1] else ">")
        values: list[float] = []
        try:
            _read(types, "", cursor, values)
        except struct.error as error:
            raise Malformed("a message that is shorter than its type") from error
        return tuple(values)

    return names, decode


def _types(text: str) -> Types:
    """Return the fields of the type, under "", and of those that it refers to."""
    parts = re.split(r"^={3,}\s*$", text, flags=re.MULTILINE)
    types: dict[str, tuple[Field, ...]] = {}
    for number, part in enumerate(parts):
        lines = [plain for line in part.splitlines() if (plain := line.split("#", 1)[0].strip())]
        name = ""
        if number and lines and lines[0].startswith("MSG:"):
            name = _short(lines.pop(0).removeprefix("MSG:").strip())
        types.setdefault(name, tuple(_field(line) for line in lines if not _CONSTANT.match(line)))
    return types


def _field(line: str) -> Field:
    """Return the field that a line of a definition states."""
    match = _FIELD.match(line)
    if match is None:
        raise Malformed(f"a field that no message type has: {line}")
    name, size = line.split()[1], match["size"]
    count = 1 if size is None else int(size) if size.isdecimal() else None
    return Field(name, match["type"], count, size is not None)


def _short(name: str) -> str:
    return name.replace("/msg/", "/")


def _fields(types: Types, name: str) -> tuple[Field, ...]:
    """Return the fields of a type; one without a package is of the only type of that name."""
    short = _short(name)
    if short in types:
        return types[short]
    found = [fields for known, fields in types.items() if known.rpartition("/")[2] == short]
    if len(found) != 1:
        raise Malformed(f"the type {name} is not defined")
    return found[0]


def _number_names(types: Types, type_name: str, path: str, depth: int = 0) -> Iterator[str]:
    """Yield the names of the numbers in a type, with ``path`` before each.

    Raises:
        Malformed: a type is not defined, or contains itself.
    """
    if depth > _MOST_DEPTH:
        raise Malformed("types within types without an end")
    for field in _fields(types, type_name) if type_name else types[""]:
        if field.type != _TEXT and field.type not in _NUMBERS:
            _fields(types, field.type)  # raises if the type is not defined
        if field.type == _TEXT or not _is_kept(field):
            continue
        for number in range(field.size or 0):
            name = f"{path}{field.name}" + (f".{number}" if field.array else "")
            if field.type in _NUMBERS:
                yield name
            else:
                yield from _number_names(types, field.type, f"{name}.", depth + 1)


def _is_kept(field: Field) -> bool:
    return field.size is not None and field.size <= _MOST_ELEMENTS


def _read(types: Types, type_name: str, cursor: _Cursor, values: list[float] | None) -> None:
    """Read a type from the cursor on; add its numbers to ``values``, None to pass over them."""
    fields = _fields(types, type_name) if type_name else types[""]
    if not fields:
        cursor.at += 1  # of a type without fields
    for field in fields:
        letter = _NUMBERS.get(field.type)
        count = cursor.length(1) if field.size is None else field.size
        kept = values if _is_kept(field) else None
        for _ in range(count):
            if letter is not None:
                value = cursor.number(letter)
                if kept is not None:
                    kept.append(value)
            elif field.type == _TEXT:
                length = cursor.length(1)
                cursor.at += length
            else:
                _read(types, field.type, cursor, kept)
