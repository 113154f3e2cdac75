"""Holds the registers of a simulated Modbus device and makes its replies."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass, field

#: Exceptions (MODBUS Application Protocol V1.1b3, section 7).
ILLEGAL_FUNCTION = 1
ILLEGAL_ADDRESS = 2
ILLEGAL_VALUE = 3

_FORMATS = {"int16": ">h", "uint16": ">H", "int32": ">i", "uint32": ">I", "float32": ">f"}


class Refused(Exception):
    """The device answers with an exception."""

    def __init__(self, code: int) -> None:
        super().__init__(code)
        self.code = code


@dataclass(frozen=True, eq=False)
class _Number:
    kind: str
    read: Callable[[], float]

    def words(self) -> tuple[int, ...]:
        value = self.read()
        if self.kind != "float32":
            size = struct.calcsize(_FORMATS[self.kind]) * 8
            signed = not self.kind.startswith("u")
            low, high = (-(1 << size - 1), (1 << size - 1) - 1) if signed else (0, (1 << size) - 1)
            value = min(max(round(value), low), high)
        data = struct.pack(_FORMATS[self.kind], value)
        return struct.unpack(f">{len(data) // 2}H", data)


@dataclass
class Bank:
    """Registers by address; what is not described here does not exist.

    Both words of a number come from one reading of it, as in a device.
    """

    max_registers: int = 125
    functions: frozenset[int] = frozenset({3, 4, 6, 16})
    swapped: bool = False  #: words of 32-bit numbers low first
    _cells: dict[int, tuple[_Number, int]] = field(default_factory=dict)
    _writers: dict[int, Callable[[int], None]] = field(default_factory=dict)

    def number(self, address: int, kind: str, read: Callable[[], float]) -> None:
        """Show a number at ``address`` (and the next, if it takes two registers)."""
        number = _Number(kind, read)
        for index in range(struct.calcsize(_FORMATS[kind]) // 2):
            self._cells[address + index] = (number, index)

    def constant(self, address: int, word: int) -> None:
        """Show the same word for ever."""
        self.number(address, "uint16", lambda: word)

    def writable(self, address: int, write: Callable[[int], None]) -> None:
        """Let the register be written; ``write`` may raise :class:`Refused`."""
        self._writers[address] = write

    def answer(self, pdu: bytes) -> bytes:
        """Return the PDU that answers ``pdu``: data, an echo, or an exception."""
        try:
            return self._answer(pdu)
        except Refused as refused:
            return bytes([pdu[0] | 0x80, refused.code])

    def _answer(self, pdu: bytes) -> bytes:
        function = pdu[0]
        if function not in self.functions:
            raise Refused(ILLEGAL_FUNCTION)
        if len(pdu) < (5 if function != 16 else 8):
            raise Refused(ILLEGAL_VALUE)
        address, value = struct.unpack_from(">HH", pdu, 1)
        if function in (3, 4):
            words = self._read(address, value)
            return struct.pack(f">BB{len(words)}H", function, 2 * len(words), *words)
        if function == 6:
            self._write(address, [value])
            return pdu
        if pdu[5] != 2 * value or len(pdu) != 6 + pdu[5]:
            raise Refused(ILLEGAL_VALUE)
        self._write(address, list(struct.unpack_from(f">{value}H", pdu, 6)))
        return pdu[:5]

    def _read(self, address: int, count: int) -> list[int]:
        if not 1 <= count <= self.max_registers:
            raise Refused(ILLEGAL_VALUE)
        readings: dict[_Number, tuple[int, ...]] = {}
        words = []
        for each in range(address, address + count):
            if each not in self._cells:
                raise Refused(ILLEGAL_ADDRESS)
            number, index = self._cells[each]
            if number not in readings:
                read = number.words()
                readings[number] = read[::-1] if self.swapped else read
            words.append(readings[number][index])
        return words

    def _write(self, address: int, values: list[int]) -> None:
        if any(address + index not in self._writers for index in range(len(values))):
            raise Refused(ILLEGAL_ADDRESS)
        for index, value in enumerate(values):
            self._writers[address + index](value)
