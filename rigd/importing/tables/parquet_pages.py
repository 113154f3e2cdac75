"""Reads how large the pages of a Parquet file become, before a library unpacks them as a whole.

A page begins with the struct PageHeader of the format (parquet.thrift): field 2 is its size after
unpacking, field 3 before it. It is in Thrift's compact protocol (thrift-compact-protocol.md).
"""

from __future__ import annotations

from collections.abc import Iterator
from enum import IntEnum
from typing import Final

_UNPACKED: Final = 2
_PACKED: Final = 3
_DEEPEST: Final = 8  #: structs in structs; a page has 3


class _Kind(IntEnum):
    """The types of a field."""

    TRUE = 1
    FALSE = 2
    BYTE = 3
    I16 = 4
    I32 = 5
    I64 = 6
    DOUBLE = 7
    BINARY = 8
    LIST = 9
    SET = 10
    STRUCT = 12


class _Header:
    """Takes fields of a struct from ``data`` at ``at``, which it moves on."""

    def __init__(self, data: memoryview, at: int) -> None:
        self._data = data
        self.at = at

    def fields(self, depth: int = 0) -> dict[int, int]:
        """Return the whole numbers of a struct by number of their field.

        Raises:
            ValueError, IndexError: there is no struct.
        """
        if depth > _DEEPEST:
            raise ValueError("structs in structs")
        found, number = {}, 0
        while head := self._byte():
            delta, kind = head >> 4, _Kind(head & 15)
            number = number + delta if delta else self._whole()
            if kind in (_Kind.I16, _Kind.I32, _Kind.I64):
                found[number] = self._whole()
            elif kind not in (_Kind.TRUE, _Kind.FALSE):
                self._skip(kind, depth)
        return found

    def _skip(self, kind: _Kind, depth: int) -> None:
        if kind in (_Kind.TRUE, _Kind.FALSE, _Kind.BYTE):
            self.at += 1
        elif kind in (_Kind.I16, _Kind.I32, _Kind.I64):
            self._varint()
        elif kind is _Kind.DOUBLE:
            self.at += 8
        elif kind is _Kind.BINARY:
            length = self._varint()
            self.at += length
        elif kind is _Kind.STRUCT:
            self.fields(depth + 1)
        else:
            head = self._byte()
            count = head >> 4 if head >> 4 < 15 else self._varint()
            for _ in range(min(count, len(self._data))):
                self._skip(_Kind(head & 15), depth + 1)

    def _byte(self) -> int:
        self.at += 1
        return self._data[self.at - 1]

    def _varint(self) -> int:
        value = shift = 0
        while True:
            byte = self._byte()
            value |= (byte & 127) << shift
            if byte < 128:
                return value
            shift += 7
            if shift > 63:
                raise ValueError("a number of more than 64 bits")

    def _whole(self) -> int:
        value = self._varint()
        return (value >> 1) ^ -(value & 1)


def page_sizes(data: memoryview, begin: int, end: int) -> Iterator[tuple[int, int]]:
    """Yield where each page of ``data`` from ``begin`` to ``end`` is, and its size after unpacking.

    Raises:
        ValueError: there is no page where one must be; the place is its only argument.
    """
    at = begin
    while at < end:
        header = _Header(data, at)
        try:
            fields = header.fields()
            unpacked, packed = fields[_UNPACKED], fields[_PACKED]
        except (ValueError, IndexError, KeyError):
            raise ValueError(at) from None
        if packed < 0:
            raise ValueError(at)
        yield at, unpacked
        at = header.at + packed
