"""Frames around requests and replies, on TCP and on a serial line; no I/O.

Sources: MODBUS Messaging on TCP/IP Implementation Guide V1.0b, section 3.1.3 (MBAP header);
MODBUS over Serial Line V1.02, sections 2.5.1 (RTU frame) and 6.2.2 (CRC).
"""

from __future__ import annotations

import struct
from enum import IntEnum
from typing import Final, Protocol

from rigd.sdk import ProtocolError
from rigd_drivers.modbus.pdu import REFUSAL, Request


class Trouble(IntEnum):
    """Why something received, or nothing received, was not the answer; bits of a status word."""

    TIMEOUT = 0  #: nothing came in time
    LATE = 1  #: something came when nothing was asked, or for a request given up
    WRONG_UNIT = 2  #: a whole frame, from another unit
    WRONG_TRANSACTION = 3  #: a whole frame, with a number never sent (TCP)
    WRONG_REPLY = 4  #: a whole frame, that answers something else
    CRC = 5  #: as long as a whole frame, with a wrong check sum (RTU)
    GARBLED = 6  #: cut short, or with bytes that belong to no frame
    REFUSED = 7  #: an exception: the device understood and declined


class Framing(Protocol):
    """How a request becomes a frame, and received bytes become the PDU of its reply."""

    def wrap(self, unit: int, request: Request) -> bytes:
        """Return the frame of ``request`` to ``unit``."""

    def unwrap(self, buffer: bytearray, unit: int, request: Request) -> bytes | Trouble | None:
        """Take one frame off ``buffer``: the PDU from ``unit``, what is wrong with it, or None.

        None: not whole yet. ``request`` is the one that was wrapped last.

        Raises:
            ProtocolError: what comes is not Modbus, and there is no way back.

        """

    def leftover(self, buffer: bytearray, unit: int, request: Request) -> Trouble:
        """Name what stands in ``buffer`` once the time for an answer is over."""


class TcpFraming:
    """Frames with an MBAP header: transaction, protocol 0, length, unit."""

    _HEADER: Final = struct.Struct(">HHHB")
    #: Length field of the shortest and the longest frame: unit and a PDU of 2 to 253 bytes.
    _LENGTHS: Final = range(3, 255)

    def __init__(self) -> None:
        self._transaction = 0
        self._sent = 0

    def wrap(self, unit: int, request: Request) -> bytes:
        """See :class:`Framing`; each frame has the next transaction number."""
        self._transaction = (self._transaction + 1) & 0xFFFF
        self._sent += 1
        return self._HEADER.pack(self._transaction, 0, len(request.pdu) + 1, unit) + request.pdu

    def unwrap(self, buffer: bytearray, unit: int, request: Request) -> bytes | Trouble | None:
        """See :class:`Framing`."""
        if len(buffer) < self._HEADER.size:
            return None
        transaction, protocol, length, got_unit = self._HEADER.unpack_from(buffer)
        if protocol != 0 or length not in self._LENGTHS:
            raise ProtocolError(
                f"received {bytes(buffer[:8]).hex(' ')}: protocol {protocol}, length {length}; "
                "expected protocol 0 and a length of 3 to 254",
                hint="the server at this address and port does not speak Modbus TCP, or lost bytes",
            )
        if len(buffer) < 6 + length:
            return None
        pdu = bytes(buffer[7 : 6 + length])
        del buffer[: 6 + length]
        if transaction != self._transaction:
            age = (self._transaction - transaction) & 0xFFFF
            return Trouble.LATE if age < self._sent else Trouble.WRONG_TRANSACTION
        return pdu if got_unit == unit else Trouble.WRONG_UNIT

    def leftover(self, buffer: bytearray, unit: int, request: Request) -> Trouble:
        """See :class:`Framing`; what has begun to come is kept, to stay in step with the stream."""
        return Trouble.GARBLED if buffer else Trouble.TIMEOUT


class RtuFraming:
    """Frames on a serial line: unit, PDU, CRC; where one ends, only silence or its length tells.

    A reply is taken only when everything since the request is exactly one whole frame, from the
    unit, of the function and length asked for, with a right check sum.
    """

    _MIN_SIZE: Final = 4
    _REFUSAL_SIZE: Final = 5

    def wrap(self, unit: int, request: Request) -> bytes:
        """See :class:`Framing`."""
        body = bytes([unit]) + request.pdu
        return body + crc16(body).to_bytes(2, "little")

    def unwrap(self, buffer: bytearray, unit: int, request: Request) -> bytes | Trouble | None:
        """See :class:`Framing`; what is wrong is named by :meth:`leftover`, once it has ended."""
        if len(buffer) < self._MIN_SIZE or buffer[0] != unit:
            return None
        refused = buffer[1] == request.function | REFUSAL
        if not refused and buffer[1] != request.function:
            return None
        size = self._REFUSAL_SIZE if refused else request.reply_size + 3
        if len(buffer) != size or not _checks(buffer):
            return None
        pdu = bytes(buffer[1:-2])
        buffer.clear()
        return pdu

    def leftover(self, buffer: bytearray, unit: int, request: Request) -> Trouble:
        """See :class:`Framing`."""
        if not buffer:
            return Trouble.TIMEOUT
        if len(buffer) >= self._MIN_SIZE and _checks(buffer):
            return Trouble.WRONG_REPLY if buffer[0] == unit else Trouble.WRONG_UNIT
        return Trouble.CRC if len(buffer) == request.reply_size + 3 else Trouble.GARBLED


def crc16(data: bytes | bytearray) -> int:
    """Return the CRC-16 of ``data`` (polynomial 0xA001 reflected, from 0xFFFF; section 6.2.2)."""
    crc = 0xFFFF
    for byte in data:
        crc = (crc >> 8) ^ _CRC_TABLE[(crc ^ byte) & 0xFF]
    return crc


def _checks(frame: bytearray) -> bool:
    return crc16(frame[:-2]) == int.from_bytes(frame[-2:], "little")


def _crc_of(byte: int) -> int:
    for _ in range(8):
        byte = (byte >> 1) ^ (0xA001 if byte & 1 else 0)
    return byte


_CRC_TABLE: Final = tuple(_crc_of(byte) for byte in range(256))
