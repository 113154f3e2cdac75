"""Packs Modbus requests into frames and unpacks replies, with pymodbus's framers; it does no I/O.

The framers alone are not sufficient. The TCP framer waits for ever after a header that is not
Modbus. The RTU framer searches noise for a frame and drops the bytes before and behind the frame.
So this module decides which frame is the answer, and names the reason if a frame is not.

Sources: MODBUS Messaging on TCP/IP Implementation Guide V1.0b, section 3.1.3 (MBAP header);
MODBUS over Serial Line V1.02, sections 2.5.1 (RTU frame) and 6.2.2 (CRC).
"""

from __future__ import annotations

from enum import IntEnum
from typing import Final, Protocol

from pymodbus.framer import FramerRTU, FramerSocket

from rigd.sdk import ProtocolError
from rigd_drivers.modbus.pdu import DECODER, Request


class Trouble(IntEnum):
    """Reasons why received bytes, or silence, are not the answer; bits of a status word."""

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
        """Describe the bytes in ``buffer`` when the time for an answer is over."""


class TcpFraming:
    """Frames with an MBAP header: transaction, protocol 0, length, unit."""

    #: The header up to its length field: how many bytes follow it.
    _HEAD: Final = 6
    #: Length field of the shortest and the longest frame: unit and a PDU of 2 to 253 bytes.
    _LENGTHS: Final = range(3, 255)

    def __init__(self) -> None:
        self._framer = FramerSocket(DECODER)
        self._transaction = 0
        self._sent = 0

    def wrap(self, unit: int, request: Request) -> bytes:
        """See :class:`Framing`; each frame has the next transaction number."""
        self._transaction = (self._transaction + 1) & 0xFFFF
        self._sent += 1
        return self._framer.encode(request.pdu, unit, self._transaction)

    def unwrap(self, buffer: bytearray, unit: int, request: Request) -> bytes | Trouble | None:
        """See :class:`Framing`."""
        if len(buffer) <= self._HEAD:
            return None
        protocol, length = (int.from_bytes(buffer[i : i + 2], "big") for i in (2, 4))
        if protocol != 0 or length not in self._LENGTHS:
            raise ProtocolError(
                f"received {bytes(buffer[:8]).hex(' ')}: protocol {protocol}, length {length}; "
                "expected protocol 0 and a length of 3 to 254",
                hint="the server at this address and port does not speak Modbus TCP, or lost bytes",
            )
        size = self._HEAD + length
        if len(buffer) < size:
            return None
        _, got_unit, transaction, pdu = self._framer.decode(bytes(buffer[:size]))
        del buffer[:size]
        if transaction != self._transaction:
            age = (self._transaction - transaction) & 0xFFFF
            return Trouble.LATE if age < self._sent else Trouble.WRONG_TRANSACTION
        return pdu if got_unit == unit else Trouble.WRONG_UNIT

    def leftover(self, buffer: bytearray, unit: int, request: Request) -> Trouble:
        """See :class:`Framing`; what has begun to come is kept, to stay in step with the stream."""
        return Trouble.GARBLED if buffer else Trouble.TIMEOUT


class RtuFraming:
    """Frames on a serial line: unit, PDU, CRC; its end shows by silence or by its length.

    A reply is taken only when everything since the request is exactly one whole frame, from the
    unit, of the length asked for or that of a refusal, with a right check sum.
    """

    #: Unit and check sum: what a frame has beside its PDU.
    _AROUND: Final = 3
    _REFUSAL_SIZE: Final = 2

    def __init__(self) -> None:
        self._framer = FramerRTU(DECODER)

    def wrap(self, unit: int, request: Request) -> bytes:
        """See :class:`Framing`."""
        return self._framer.encode(request.pdu, unit, 0)

    def unwrap(self, buffer: bytearray, unit: int, request: Request) -> bytes | Trouble | None:
        """See :class:`Framing`; what is wrong is named by :meth:`leftover`, once it has ended."""
        size = len(buffer) - self._AROUND
        if size not in (request.reply_size, self._REFUSAL_SIZE):
            return None
        _, got_unit, _, pdu = self._framer.decode(bytes(buffer))
        if len(pdu) != size or got_unit != unit:
            return None  # a shorter one: found within what came
        buffer.clear()
        return pdu

    def leftover(self, buffer: bytearray, unit: int, request: Request) -> Trouble:
        """See :class:`Framing`."""
        if not buffer:
            return Trouble.TIMEOUT
        if len(buffer) > self._AROUND and _checks(buffer):
            return Trouble.WRONG_REPLY if buffer[0] == unit else Trouble.WRONG_UNIT
        sized = len(buffer) == request.reply_size + self._AROUND
        return Trouble.CRC if sized else Trouble.GARBLED


def _checks(frame: bytearray) -> bool:
    return FramerRTU.check_CRC(bytes(frame[:-2]), int.from_bytes(frame[-2:], "big"))
