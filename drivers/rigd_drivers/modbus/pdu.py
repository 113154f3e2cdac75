"""Encodes Modbus requests for registers and decodes the replies, with pymodbus; it does no I/O.

Source of the numbers: MODBUS Application Protocol Specification V1.1b3, sections 6.3 (read holding
registers), 6.4 (read input registers), 6.6 (write single register), 6.12 (write multiple
registers) and 7 (exceptions).

pymodbus is not strict with replies: it ignores surplus bytes at the end of a reply, and accepts a
byte count that is too small. This module accepts a reply only if the reply has the expected size
and the requested number of registers.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from pymodbus.pdu import DecodePDU, ExceptionResponse, ModbusPDU
from pymodbus.pdu import register_message as messages

READ_HOLDING: Final = 3
READ_INPUT: Final = 4
WRITE_SINGLE: Final = 6
WRITE_MULTIPLE: Final = 16
#: Added to the function code in a reply that refuses (section 4.1).
REFUSAL: Final = 0x80
#: Largest number of registers in one read and in one write (sections 6.3 and 6.12).
MAX_READ: Final = messages.ReadHoldingRegistersRequest.MAX_COUNT
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
#: The request was accepted and takes long: an action is not to be made again.
ACKNOWLEDGED: Final = 5
#: Those that pass by themselves: the request may be made again.
PASSING: Final = frozenset({ACKNOWLEDGED, 6, 10, 11})


# What pymodbus cannot read it logs as a warning, which Python prints if logging is not set up:
# in the middle of a run. Here it is counted instead.
logging.getLogger("pymodbus").addHandler(logging.NullHandler())


#: pymodbus's decoder of replies, which keeps nothing between two; for the functions that rigd uses,
#: as those of other functions are no reply to it.
DECODER: Final = DecodePDU(is_server=False)
DECODER.pdu_table = {
    function: DecodePDU.pdu_table[function]
    for function in (READ_HOLDING, READ_INPUT, WRITE_SINGLE, WRITE_MULTIPLE)
}


@dataclass(frozen=True, slots=True)
class Request:
    """One request: its PDU, the size in bytes of the PDU that answers it, and its name in words.

    ``echo`` is the whole answer to a write; None of a read.
    """

    pdu: bytes
    reply_size: int
    text: str
    echo: bytes | None = None

    @property
    def function(self) -> int:
        """Function code, the first byte of the PDU."""
        return self.pdu[0]

    def words(self, reply: bytes) -> tuple[int, ...] | None:
        """Return the registers read (none after a write), or None when ``reply`` is no answer."""
        if self.echo is not None:
            return () if reply == self.echo else None
        if len(reply) != self.reply_size or reply[0] != self.function:
            return None
        answer = DECODER.decode(reply)
        if answer is None or 2 * len(answer.registers) != self.reply_size - 2:
            return None
        return tuple(answer.registers)

    def refusal(self, reply: bytes) -> int | None:
        """Return the code of the exception that ``reply`` is, None when it is none to this."""
        if len(reply) != 2 or reply[0] != self.function | REFUSAL:
            return None
        answer = DECODER.decode(reply)
        return answer.exception_code if isinstance(answer, ExceptionResponse) else None


def read_registers(address: int, count: int, function: int = READ_HOLDING) -> Request:
    """Return the request for ``count`` registers from ``address`` (as on the wire, from 0)."""
    if not 1 <= count <= MAX_READ or not 0 <= address <= 0x10000 - count:
        raise ValueError(f"cannot read {count} registers from {address}")
    kind, _ = DECODER.pdu_table[function]
    made = _bytes(kind(address=address, count=count))
    return Request(made, 2 + 2 * count, f"read of {count} registers from {address}")


def write_register(address: int, word: int) -> Request:
    """Return the request that sets one register, with function 6."""
    made = _bytes(messages.WriteSingleRegisterRequest(address=address, registers=[word]))
    return Request(made, len(made), f"write of {word} to register {address}", echo=made)


def write_registers(address: int, words: Sequence[int]) -> Request:
    """Return the request that sets adjacent registers together, with function 16."""
    if not 1 <= len(words) <= MAX_WRITE:
        raise ValueError(f"cannot write {len(words)} registers at once")
    made = messages.WriteMultipleRegistersRequest(address=address, registers=words)
    echo = _bytes(messages.WriteMultipleRegistersResponse(address=address, count=len(words)))
    text = f"write of {', '.join(map(str, words))} to registers from {address}"
    return Request(_bytes(made), len(echo), text, echo)


def _bytes(message: ModbusPDU) -> bytes:
    return bytes([message.function_code]) + message.encode()
