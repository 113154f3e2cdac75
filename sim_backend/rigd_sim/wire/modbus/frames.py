"""Decodes Modbus requests from a byte stream and encodes replies (server side).

Sources: MODBUS Messaging on TCP/IP Implementation Guide V1.0b, section 3.1.3; MODBUS over Serial
Line V1.02, sections 2.5.1 and 6.2.2; MODBUS Application Protocol V1.1b3, section 6.
"""

from __future__ import annotations

from dataclasses import dataclass

#: Size of the PDU of a request by function; 16 contains its own (section 6.12).
_REQUEST_SIZES = {1: 5, 2: 5, 3: 5, 4: 5, 5: 5, 6: 5}
_WRITE_MULTIPLE = 16


@dataclass(frozen=True)
class Ask:
    """A request: to which unit, what, and the transaction it belongs to (TCP)."""

    unit: int
    pdu: bytes
    transaction: int = 0


class NotModbus(Exception):
    """The received bytes can no longer be decoded as Modbus."""


def take_tcp(buffer: bytearray) -> Ask | None:
    """Take one request off ``buffer``, or None while it is not whole.

    Raises:
        NotModbus: the protocol field is not 0.

    """
    if len(buffer) < 8:
        return None
    length = int.from_bytes(buffer[4:6], "big")
    if buffer[2:4] != b"\0\0" or length < 2:
        raise NotModbus(bytes(buffer[:8]).hex(" "))
    if len(buffer) < 6 + length:
        return None
    ask = Ask(buffer[6], bytes(buffer[7 : 6 + length]), int.from_bytes(buffer[0:2], "big"))
    del buffer[: 6 + length]
    return ask


def build_tcp(unit: int, pdu: bytes, transaction: int) -> bytes:
    """Return the frame of a reply."""
    head = transaction.to_bytes(2, "big") + b"\0\0" + (len(pdu) + 1).to_bytes(2, "big")
    return head + bytes([unit]) + pdu


def take_rtu(buffer: bytearray) -> Ask | None:
    """Take the request that is the whole of ``buffer``, or None while it is not (yet) one."""
    if len(buffer) < 4:
        return None
    size = _REQUEST_SIZES.get(buffer[1])
    if buffer[1] == _WRITE_MULTIPLE and len(buffer) >= 7:
        size = 6 + buffer[6]
    if size is None or len(buffer) != size + 3 or check_sum(buffer):
        return None
    ask = Ask(buffer[0], bytes(buffer[1:-2]))
    buffer.clear()
    return ask


def build_rtu(unit: int, pdu: bytes) -> bytes:
    """Return the frame of a reply."""
    body = bytes([unit]) + pdu
    return body + check_sum(body).to_bytes(2, "little")


def check_sum(data: bytes | bytearray) -> int:
    """Return the CRC-16 of ``data``; over a frame with its own CRC it is zero."""
    register = 0xFFFF
    for byte in data:
        register ^= byte
        for _ in range(8):
            register = register >> 1 ^ (0xA001 if register & 1 else 0)
    return register
