"""Requests for registers and what answers them, as bytes; no I/O.

Source: MODBUS Application Protocol Specification V1.1b3, sections 6.3 (read holding registers),
6.4 (read input registers), 6.6 (write single register), 6.12 (write multiple registers) and 7
(exceptions). pymodbus offers PDU classes too, but its framers drop bad frames without a word,
and here each must be counted.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

READ_HOLDING: Final = 3
READ_INPUT: Final = 4
WRITE_SINGLE: Final = 6
WRITE_MULTIPLE: Final = 16
#: Added to the function code in a reply that refuses (section 4.1).
REFUSAL: Final = 0x80
#: Largest number of registers in one read and in one write (sections 6.3 and 6.12).
MAX_READ: Final = 125
MAX_WRITE: Final = 123

#: Exception codes (section 7): what they mean, for a person.
EXCEPTIONS: Final = {
    1: "illegal function",
    2: "illegal data address",
    3: "illegal data value",
    4: "server device failure",
    5: "acknowledge: it works on it",
    6: "server device busy",
    8: "memory parity error",
    10: "gateway path unavailable",
    11: "gateway target device failed to respond",
}
#: Those that pass by themselves: the request may be made again.
PASSING: Final = frozenset({5, 6, 10, 11})


@dataclass(frozen=True, slots=True)
class Request:
    """One request: its PDU, the size in bytes of the PDU that answers it, and how to say it."""

    pdu: bytes
    reply_size: int
    text: str

    @property
    def function(self) -> int:
        """Function code, the first byte of the PDU."""
        return self.pdu[0]

    def words(self, reply: bytes) -> tuple[int, ...] | None:
        """Return the registers read (none after a write), or None when ``reply`` is no answer."""
        if len(reply) != self.reply_size or reply[0] != self.function:
            return None
        if self.function in (READ_HOLDING, READ_INPUT):
            count = (self.reply_size - 2) // 2
            return struct.unpack_from(f">{count}H", reply, 2) if reply[1] == 2 * count else None
        return () if reply[1:] == self.pdu[1:5] else None


def read_registers(address: int, count: int, function: int = READ_HOLDING) -> Request:
    """Return the request for ``count`` registers from ``address`` (as on the wire, from 0)."""
    if not 1 <= count <= MAX_READ or not 0 <= address <= 0x10000 - count:
        raise ValueError(f"cannot read {count} registers from {address}")
    pdu = struct.pack(">BHH", function, address, count)
    return Request(pdu, 2 + 2 * count, f"read of {count} registers from {address}")


def write_register(address: int, word: int) -> Request:
    """Return the request that sets one register, with function 6."""
    pdu = struct.pack(">BHH", WRITE_SINGLE, address, word)
    return Request(pdu, 5, f"write of {word} to register {address}")


def write_registers(address: int, words: Sequence[int]) -> Request:
    """Return the request that sets adjacent registers together, with function 16."""
    if not 1 <= len(words) <= MAX_WRITE:
        raise ValueError(f"cannot write {len(words)} registers at once")
    head = struct.pack(">BHHB", WRITE_MULTIPLE, address, len(words), 2 * len(words))
    text = f"write of {', '.join(map(str, words))} to registers from {address}"
    return Request(head + struct.pack(f">{len(words)}H", *words), 5, text)
