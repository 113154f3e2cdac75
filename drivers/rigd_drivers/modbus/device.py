"""Provides the base class of Modbus drivers, which opens a device and polls its register blocks.

The driver reads the blocks in turn and keeps the poll rate.
"""

from __future__ import annotations

import time
from abc import abstractmethod
from collections.abc import Iterable
from typing import ClassVar, Final, TypeVar

from rigd.sdk import Driver, LinkError, ProtocolError
from rigd_drivers.modbus.client import Client, refusal
from rigd_drivers.modbus.connection import ConnectionConfig
from rigd_drivers.modbus.exchange import Answer, Failure
from rigd_drivers.modbus.framing import Trouble
from rigd_drivers.modbus.pdu import PASSING, read_registers
from rigd_drivers.modbus.registers import Access, Expect, Read

#: So many rows in a row may be lost before the device has failed.
_LOST_ROWS: Final = 3


def silent_s(config: ConnectionConfig, rate_hz: float) -> float:
    """Return after how long without a row, in s, a device asked at ``rate_hz`` has failed."""
    return _LOST_ROWS * (1.0 / rate_hz + config.lost_reply_s())


ConnectionConfigT = TypeVar("ConnectionConfigT", bound=ConnectionConfig)


class ModbusDevice(Driver[ConnectionConfigT, None]):
    """A device with its own connection, which the driver polls at a given rate without waiting.

    A reply is seen in the cycle after it arrived; the row belongs to that cycle. What the device
    measured is older by its own reply time, which Modbus does not report.

    Status bits 8 to 15 report what went wrong since the last row (see :class:`Trouble`), bits 16 to
    23 count it, modulo 256; bits 0 to 7 are the device's.
    """

    unshared: ClassVar[tuple[str, ...]] = ("serial_port",)
    reads_when_safe: ClassVar[bool] = True  # it reads registers

    def __init__(
        self, config: ConnectionConfigT, link: None, access: Access, rate_hz: float
    ) -> None:
        super().__init__(config, link)
        self._access = access
        self._period_ns = round(1e9 / rate_hz)
        self._client: Client | None = None
        self._due_ns = 0

    @property
    def client(self) -> Client:
        """The opened connection.

        Raises:
            LinkError: it is not open.

        """
        if self._client is None:
            raise LinkError(f"{self.title}: the connection is not open")
        return self._client

    def open(self) -> None:
        """Connect, and :meth:`prove` the device; see :class:`~rigd.sdk.Driver`."""
        self.close()
        client = self.config.client(self._access.silence)
        client.open()
        self._client = client
        try:
            self.prove()
        except BaseException:
            self.close()
            raise

    @abstractmethod
    def prove(self) -> None:
        """Make sure over the opened connection that the device is the one expected.

        Raises:
            LinkError: no answer.
            ProtocolError: it is another device, or another setting than the map describes.
            DeviceError: the device refused, or reports a fault.

        """

    def close(self) -> None:
        """Close the connection; closing twice is silent."""
        if self._client is not None:
            self._client.close()
            self._client = None

    def fetch(self, reads: Iterable[Read]) -> dict[int, int]:
        """Wait for all of ``reads``; return the words by their addresses.

        Raises:
            LinkError: no answer.
            DeviceError: the device refused.

        """
        words: dict[int, int] = {}
        for read in reads:
            words |= read.words(self.client.ask(read.request))
        return words

    def fetch_word(self, address: int) -> int:
        """Wait for one register; raises what :meth:`fetch` does."""
        (word,) = self.client.ask(read_registers(address, 1, self._access.read_function))
        return word

    def check(self, expected: Iterable[Expect]) -> None:
        """Read the settings that the device must have.

        Raises:
            ProtocolError: one of them is another; names the parameter and its value.

        """
        for each in expected:
            word = self.fetch_word(each.address)
            if word & each.mask != each.value:
                raise ProtocolError(
                    f"{self.client.where}: {each.name} is {word & each.mask:#06x}, "
                    f"expected {each.value:#06x} (register {each.address})",
                    hint=f"set it at the device, or check that it is a {self._access.title}",
                )

    def take(self) -> Answer | None:
        """Return the answer that has come, if one has; what did not come is counted.

        Raises:
            LinkError: the connection is lost.
            DeviceError: the device refuses what it must do.

        """
        outcome = self.client.poll()
        if isinstance(outcome, Failure):
            if outcome.trouble is not Trouble.REFUSED or outcome.code in PASSING:
                self.failed(outcome)
            elif not self.refused(outcome):
                raise refusal(self.client.where, outcome)
            return None
        return outcome

    def failed(self, failure: Failure) -> None:
        """Note a request without an answer; called by :meth:`take`."""

    def refused(self, failure: Failure) -> bool:
        """Handle a refusal; return False if the device is then unusable (the default)."""
        return False

    def due(self) -> bool:
        """Return whether the next row is to be asked for; rows that are late are not caught up."""
        now_ns = time.monotonic_ns()
        if now_ns < self._due_ns:
            return False
        self._due_ns += self._period_ns
        if self._due_ns <= now_ns:
            self._due_ns = now_ns + self._period_ns
        return True
