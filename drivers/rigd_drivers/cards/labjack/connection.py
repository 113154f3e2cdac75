"""Asks a LabJack with one packet at a time over TCP, and takes only the answer to that packet."""

from __future__ import annotations

import select
import time
from typing import Final

from rigd.sdk import DeviceError, LinkError, ProtocolError
from rigd_drivers.cards.labjack.registers import FEEDBACK, LAST_ERROR, Packet, packet
from rigd_drivers.modbus.transport import TcpTransport
from rigd_drivers.wait import looks

#: Header up to its length field (transaction, protocol, length), and what the length counts before
#: the data: unit and function.
_HEAD: Final = 6
_BEFORE: Final = 2
#: LabJack's unit address, and the longest packet of a T7 or T4 on Ethernet, in bytes.
_UNIT: Final = 1
_LONGEST: Final = 1040
_REFUSED: Final = 0x80
#: What an author of a rig file can meet; from the list of errors in LabJack's constants.
_ERRORS: Final = {
    2370: "AIN_RANGE_INVALID",
    2373: "AIN_NEGATIVE_CHANNEL_INVALID",
    2375: "AIN_RESOLUTION_INVALID",
    2377: "AIN_CHN_DISABLED",
    2500: "HW_DIO_NOT_AVAILABLE",
    2501: "DIO_SET_TO_ANALOG",
    2551: "EF_INVALID_TYPE",
    2552: "EF_TYPE_NOT_SUPPORTED",
    2553: "EF_PIN_TYPE_MISMATCH",
    2560: "EF_PIN_RESERVED",
    2561: "EF_INVALID_DIO_NUMBER",
    2720: "I2C_BUS_BUSY",
    2760: "TDAC_SDA_SCL_INVALID",
    2762: "TDAC_INVALID_CHANNEL",
    2763: "TDAC_CAL_READ_FAILURE",
    2764: "TDAC_NOT_FOUND",
}
_ERROR_DETAIL: Final = packet(LAST_ERROR)


class Connection:
    """One TCP connection to one device; for one thread.

    Args:
        host: its address.
        port: its port.
    """

    def __init__(self, host: str, port: int) -> None:
        self.where = f"LabJack at {host}:{port}"
        self._transport = TcpTransport(host, port)
        self._buffer = bytearray()
        self._transaction = 0
        self._sent = 0

    def open(self, timeout_s: float, *, again: bool = False) -> None:
        """Connect within ``timeout_s``; ``again``: at the address that it had.

        Raises:
            LinkError: it cannot be reached.
        """
        self._buffer.clear()
        self._transport.open(timeout_s, again=again)

    def close(self) -> None:
        """Close it; closing twice is silent."""
        self._transport.close()

    def ask(self, asked: Packet, until_s: float) -> tuple[float, ...]:
        """Send a packet and return what its reads gave, at ``until_s`` (time.monotonic) at last.

        Raises:
            LinkError: no answer by then, or the connection is lost.
            ProtocolError: what comes is not Modbus TCP, or not the answer to anything asked.
            DeviceError: the device refuses.
        """
        data = self._exchange(asked, until_s)
        if data is None:
            raise self._refusal(asked, until_s)
        if len(data) != asked.answer.size:
            raise ProtocolError(
                f"{self.where} answered a packet of {', '.join(asked.names)} with {len(data)} "
                f"bytes; expected {asked.answer.size}",
                hint="the device at this address does not know function 76 as a T7 or T4 does",
            )
        return asked.answer.unpack(data)

    def _exchange(self, asked: Packet, until_s: float) -> bytes | None:
        """Return the data of the answer; None if the device refuses."""
        self._transaction = (self._transaction + 1) & 0xFFFF
        self._sent += 1
        length = _BEFORE + len(asked.data)
        self._transport.send(
            self._transaction.to_bytes(2, "big")
            + length.to_bytes(4, "big")  # protocol 0 before it
            + bytes((_UNIT, FEEDBACK))
            + asked.data
        )
        began_s = time.monotonic()
        poll = select.poll()
        poll.register(self._transport.fileno(), select.POLLIN)
        for left_s in looks(until_s - began_s):
            poll.poll(left_s * 1e3)
            self._buffer += self._transport.receive()
            while (answer := self._taken()) is not None:
                function, data = answer
                if function == FEEDBACK:
                    return data
                if function == FEEDBACK | _REFUSED:
                    return None
                raise ProtocolError(
                    f"{self.where} answered with function {function}; expected {FEEDBACK}",
                    hint="the device at this address is no T7 or T4",
                )
        raise LinkError(
            f"{self.where} has not answered within {max(until_s - began_s, 0.0) * 1e3:.0f} ms",
            hint="check its power and cable, and that no other program floods it",
        )

    def _taken(self) -> tuple[int, bytes] | None:
        """Take frames off the buffer: function and data of the answer asked for, or None yet.

        A late answer to an earlier packet is dropped.
        """
        buffer = self._buffer
        while len(buffer) >= _HEAD:
            transaction, protocol, length = (
                int.from_bytes(buffer[at : at + 2], "big") for at in (0, 2, 4)
            )
            if protocol != 0 or not _BEFORE <= length <= _LONGEST - _HEAD:
                raise ProtocolError(
                    f"{self.where} sent {bytes(buffer[:8]).hex(' ')}: protocol {protocol}, "
                    f"length {length}; expected protocol 0 and a length of {_BEFORE} to "
                    f"{_LONGEST - _HEAD}",
                    hint="what answers at this address is no LabJack, or bytes were lost",
                )
            if len(buffer) < _HEAD + length:
                return None
            frame = bytes(buffer[_HEAD : _HEAD + length])
            del buffer[: _HEAD + length]
            age = (self._transaction - transaction) & 0xFFFF
            if age == 0:
                return frame[1], frame[_BEFORE:]
            if age >= self._sent:
                raise ProtocolError(
                    f"{self.where} sent an answer with transaction {transaction}, which was "
                    "never asked",
                    hint="what answers at this address is no LabJack, or bytes were lost",
                )
        return None

    def _refusal(self, asked: Packet, until_s: float) -> DeviceError:
        """Return the error that names what the device refuses, and why."""
        data = self._exchange(_ERROR_DETAIL, until_s)
        code = 0 if data is None else int.from_bytes(data, "big")
        named = _ERRORS.get(code, "see LabJack's list of errors")
        return DeviceError(
            f"{self.where} refuses a packet of {', '.join(asked.names)}: error {code}, {named}",
            hint="compare the lines, inputs and outputs in the rig file with what this device has",
        )
