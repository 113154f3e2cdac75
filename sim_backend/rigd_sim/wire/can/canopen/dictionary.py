"""Holds the object dictionary of a simulated CANopen node: typed entries and their rules.

Source: CiA 301, 7.4.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import Enum, IntEnum


class AbortCode(IntEnum):
    """SDO abort codes (CiA 301, table 22)."""

    TOGGLE = 0x05030000
    UNKNOWN_COMMAND = 0x05040001
    WRITE_ONLY = 0x06010001
    READ_ONLY = 0x06010002
    NO_OBJECT = 0x06020000
    NOT_MAPPABLE = 0x06040041
    PDO_TOO_LONG = 0x06040042
    WRONG_LENGTH = 0x06070010
    TOO_LONG = 0x06070012
    TOO_SHORT = 0x06070013
    NO_SUBINDEX = 0x06090011
    VALUE_RANGE = 0x06090030
    VALUE_HIGH = 0x06090031
    VALUE_LOW = 0x06090032
    GENERAL = 0x08000000
    DEVICE_STATE = 0x08000022


class Abort(Exception):
    """The transfer is refused with this code."""

    def __init__(self, code: int) -> None:
        super().__init__(f"SDO abort 0x{code:08X}")
        self.code = code


class Kind(Enum):
    """Integers of CiA 301, 7.1.6: ``struct`` letter, length in bits."""

    I8 = ("b", 8)
    U8 = ("B", 8)
    I16 = ("h", 16)
    U16 = ("H", 16)
    I32 = ("i", 32)
    U32 = ("I", 32)

    def __init__(self, letter: str, bits: int) -> None:
        self.letter = letter
        self.bits = bits


#: ``check(value)`` may refuse with :class:`Abort`, before the value is stored.
Check = Callable[[int], None]
#: ``changed(value)`` is called after the value was stored by SDO.
Changed = Callable[[int], None]


@dataclass(slots=True)
class Entry:
    """One object or sub-object that holds an integer."""

    index: int
    sub: int
    kind: Kind
    value: int
    writable: bool = False
    mappable: bool = False
    low: int | None = None
    high: int | None = None
    check: Check | None = None
    changed: Changed | None = None
    default: int = 0

    def __post_init__(self) -> None:
        self.default = self.value

    def pack(self) -> bytes:
        """Return the value as it goes over the wire, little-endian."""
        return struct.pack(f"<{self.kind.letter}", self.value)

    def write(self, data: bytes) -> None:
        """Store what an SDO client sent.

        Raises:
            Abort: not writable, of the wrong length, or a value that is not allowed.

        """
        if not self.writable:
            raise Abort(AbortCode.READ_ONLY)
        length = self.kind.bits // 8
        if len(data) != length:
            raise Abort(AbortCode.TOO_LONG if len(data) > length else AbortCode.TOO_SHORT)
        (value,) = struct.unpack(f"<{self.kind.letter}", data)
        if (self.low is not None and value < self.low) or (
            self.high is not None and value > self.high
        ):
            raise Abort(AbortCode.VALUE_RANGE)
        if self.check is not None:
            self.check(value)
        self.value = value
        if self.changed is not None:
            self.changed(value)


@dataclass(slots=True)
class Text(Entry):
    """An object that holds a constant text."""

    text: bytes = b""

    def pack(self) -> bytes:
        """Return the text."""
        return self.text


class Dictionary:
    """All entries of one node."""

    def __init__(self) -> None:
        self._entries: dict[tuple[int, int], Entry] = {}
        self._indices: set[int] = set()

    def add(self, entry: Entry) -> Entry:
        """Add ``entry`` and return it."""
        self._entries[entry.index, entry.sub] = entry
        self._indices.add(entry.index)
        return entry

    def remove(self, index: int, sub: int) -> None:
        """Take an entry away, if there is one."""
        self._entries.pop((index, sub), None)
        self._indices = {known for known, _ in self._entries}

    def array(self, index: int, entries: Iterable[Entry]) -> list[Entry]:
        """Add the sub-objects of ``index`` with the count of them at sub-index 0."""
        added = [self.add(entry) for entry in entries]
        self.add(Entry(index, 0, Kind.U8, max(entry.sub for entry in added)))
        return added

    def find(self, index: int, sub: int) -> Entry:
        """Return an entry.

        Raises:
            Abort: there is none.

        """
        entry = self._entries.get((index, sub))
        if entry is None:
            known = index in self._indices
            raise Abort(AbortCode.NO_SUBINDEX if known else AbortCode.NO_OBJECT)
        return entry

    def restore(self, low: int = 0x0000, high: int = 0xFFFF) -> None:
        """Give entries with an index from ``low`` to ``high`` the values of power-on."""
        for entry in self._entries.values():
            if low <= entry.index <= high:
                entry.value = entry.default
