"""Defines the parts of a Modbus register map: numbers, conditions, writes and settings."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Mapping, Sequence
from typing import Annotated, Final, Literal, NamedTuple

from annotated_types import Ge, Le

from rigd.sdk import Documented, In
from rigd_drivers.device_file import DeviceFile
from rigd_drivers.modbus import pdu
from rigd_drivers.modbus.pdu import Request, read_registers, write_register, write_registers

Address = Annotated[int, Ge(0), Le(0xFFFF)]
Word = Annotated[int, Ge(0), Le(0xFFFF)]
WordOrder = Literal["high-first", "low-first"]

_FORMATS: Final = {"int16": ">h", "uint16": ">H", "int32": ">i", "uint32": ">I", "float32": ">f"}


class Described(Documented):
    """A part of a register map: frozen, every key known, every field documented."""


class Register(Described):
    """A number in one register or two."""

    address: Address
    """Address on the wire, counted from 0: what a manual calls 40008 is 7."""
    type: Literal["int16", "uint16", "int32", "uint32", "float32"]
    """How the bits make a number."""

    @property
    def count(self) -> int:
        """Number of registers."""
        return struct.calcsize(_FORMATS[self.type]) // 2

    @property
    def addresses(self) -> range:
        """Addresses of its registers."""
        return range(self.address, self.address + self.count)

    def decode(self, words: Mapping[int, int], order: WordOrder) -> float:
        """Return the number, from all words read."""
        return decode(self.type, [words[address] for address in self.addresses], order)

    def encode(self, value: float, order: WordOrder) -> tuple[int, ...]:
        """Return the words to write, rounded if the register is an integer.

        Raises:
            ValueError: the value does not fit.
        """
        number = value if self.type == "float32" else round(value)
        try:
            data = struct.pack(_FORMATS[self.type], number)
        except (struct.error, OverflowError) as error:
            raise ValueError(f"{value:g} does not fit into {self.type}") from error
        words = struct.unpack(f">{self.count}H", data)
        return words if order == "high-first" else words[::-1]


def decode(kind: str, words: Sequence[int], order: WordOrder) -> float:
    """Return the number of type ``kind`` that ``words`` hold; bytes in a word are high first."""
    if order == "low-first":
        words = words[::-1]
    (value,) = struct.unpack(_FORMATS[kind], struct.pack(f">{len(words)}H", *words))
    return float(value)


class Condition(Described):
    """True while the register, under the mask, has the value."""

    address: Address
    """Address on the wire, counted from 0."""
    mask: Word = 0xFFFF
    """Bits that count."""
    value: Word | None = None
    """Value of those bits; by default not zero."""

    def holds(self, words: Mapping[int, int]) -> bool:
        """Return whether it is true of the words read."""
        bits = words[self.address] & self.mask
        return bits != 0 if self.value is None else bits == self.value


class Write(Described):
    """A register and what is written to it."""

    address: Address
    """Address on the wire, counted from 0."""
    value: Word
    """The word to write."""


def all_hold(conditions: Iterable[Condition], words: Mapping[int, int]) -> bool:
    """Return whether every one of ``conditions`` is true of the words read."""
    return all(condition.holds(words) for condition in conditions)


class Expect(Described):
    """A setting that the device must have; rigd reads it and never writes it."""

    address: Address
    """Address on the wire, counted from 0."""
    value: Word
    """The required value."""
    mask: Word = 0xFFFF
    """Bits that count."""
    name: str
    """What it is, for a person."""


class Access(DeviceFile):
    """How rigd accesses a device: functions, sizes, order of words, silence."""

    read_function: Literal[3, 4] = 3
    """Function that reads its registers: 3 (holding) or 4 (input)."""
    write_function: Literal[6, 16] = 6
    """Function that writes one register; two together are always written with 16."""
    max_registers: Annotated[int, Ge(2), Le(pdu.MAX_READ)] = pdu.MAX_READ
    """Most registers in one read."""
    bridge: Annotated[int, Ge(0), Le(pdu.MAX_READ)] = 0
    """Registers of no interest that may be read along, to save a request."""
    word_order: WordOrder = "high-first"
    """The word of a 32-bit number at the lower address."""
    silence: Annotated[float, In("s"), Ge(0)] = 0.0
    """Silence that the device asks for between frames, beyond the standard's."""

    def write(self, address: int, words: Sequence[int]) -> Request:
        """Return the request that writes ``words`` from ``address``."""
        if len(words) == 1 and self.write_function == pdu.WRITE_SINGLE:
            return write_register(address, words[0])
        return write_registers(address, words)

    def writes(self, writes: Iterable[Write]) -> tuple[Request, ...]:
        """Return the requests that make ``writes``, in order."""
        return tuple(self.write(each.address, (each.value,)) for each in writes)

    def reads(self, spans: Iterable[range]) -> tuple[Read, ...]:
        """Return the reads that cover ``spans``; none of them is torn apart."""
        blocks: list[range] = []
        for span in sorted(spans, key=lambda each: (each.start, each.stop)):
            last = blocks[-1] if blocks else range(0)
            joined = range(last.start, max(last.stop, span.stop))
            near = span.start - last.stop <= self.bridge
            if blocks and near and len(joined) <= self.max_registers:
                blocks[-1] = joined
            else:
                blocks.append(span)
        return tuple(
            Read(block.start, read_registers(block.start, len(block), self.read_function))
            for block in blocks
        )


class Read(NamedTuple):
    """A read request, and the address of its first word."""

    first: int
    request: Request

    def words(self, words: Sequence[int]) -> dict[int, int]:
        """Return the words read by their addresses."""
        return dict(enumerate(words, self.first))
