"""Defines the options of a driver for its connection to a Modbus device."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Final, Literal, Self

from annotated_types import Ge, Gt, Le
from pydantic import model_validator

from rigd.sdk import DriverConfig, In, wrong_entry
from rigd_drivers.device_file import own_files
from rigd_drivers.modbus.client import Client
from rigd_drivers.modbus.exchange import Exchange, Timing
from rigd_drivers.modbus.framing import RtuFraming, TcpFraming
from rigd_drivers.modbus.transport import SerialTransport, TcpTransport

#: Silence between RTU frames: 3.5 characters, but 1.75 ms above 19200 baud (MODBUS over Serial
#: Line V1.02, section 2.5.1.1).
_GAP_CHARACTERS: Final = 3.5
_GAP_FIXED_S: Final = 1.75e-3
_FAST_BAUD: Final = 19200
_PARITIES: Final = {"none": "N", "even": "E", "odd": "O"}


class ConnectionConfig(DriverConfig):
    """Either ``host`` (Modbus TCP) or ``serial_port`` (Modbus RTU), and the unit behind it."""

    host: str | None = None
    """Address of the device, or of the gateway before it: Modbus TCP."""
    port: Annotated[int, Gt(0), Le(65535)] = 502
    """TCP port (with ``host``)."""
    serial_port: str | None = None
    """Path of the serial port: Modbus RTU. Use the stable name below /dev/serial/by-id."""
    baud: Annotated[int, Ge(1200), Le(4_000_000)] = 19200
    """Baud rate (with ``serial_port``), as set in the device."""
    parity: Literal["none", "even", "odd"] = "even"
    """Parity (with ``serial_port``), as set in the device."""
    stop_bits: Literal[1, 2] = 1
    """Stop bits (with ``serial_port``); the standard requires 2 without parity."""
    unit: Annotated[int, Ge(0), Le(255)] = 1
    """Unit (slave) address of the device."""
    timeout: Annotated[float, In("s"), Gt(0), Le(1)] = 0.05
    """The device answers within; a request that takes longer is given up and counted."""
    longest_reply: Annotated[float, In("s"), Gt(0), Le(5)] = 0.2
    """The device answers within this or never (with ``serial_port``): after a failure the line
    is left alone for so long, as a late reply looks like the answer to another request."""

    @model_validator(mode="after")
    def _one_connection(self) -> Self:
        given = self.model_fields_set
        if (self.host is None) == (self.serial_port is None):
            raise wrong_entry(
                "give either 'host' (Modbus TCP) or 'serial_port' (Modbus RTU)", "serial_port"
            )
        serial_only = {"baud", "parity", "stop_bits", "longest_reply"}
        misplaced = given & (serial_only if self.host is not None else {"port"})
        if misplaced:
            other = "serial_port" if self.host is not None else "host"
            raise wrong_entry(
                f"'{min(misplaced)}' belongs to '{other}'; remove it here", min(misplaced)
            )
        if self.serial_port is not None and self.longest_reply < self.timeout:
            raise wrong_entry(
                "'longest_reply' must be at least 'timeout'",
                "longest_reply" if "longest_reply" in given else "timeout",
            )
        if self.serial_port is not None and self.unit == 0:
            raise wrong_entry(
                "unit 0 is the broadcast address: no device on a serial line answers", "unit"
            )
        return self

    def files(self) -> Mapping[Path, str]:
        """Return the lab's own register map; see :class:`DriverConfig`."""
        return own_files(self)

    def lost_reply_s(self) -> float:
        """Return how long the device cannot be asked after a reply was lost, at most, in s."""
        return self.timeout if self.host is not None else self.longest_reply

    def client(self, gap_s: float) -> Client:
        """Return a client, not yet open; ``gap_s`` is the silence the device itself asks for."""
        timeout_ns, gap_ns = round(self.timeout * 1e9), round(gap_s * 1e9)
        if self.serial_port is None:
            tcp = TcpTransport(self.host or "", self.port)
            timing = Timing(timeout_ns, gap_ns=gap_ns)
            return Client(tcp, Exchange(TcpFraming(), self.unit, timing))
        parity = _PARITIES[self.parity]
        byte_s = (9 + (parity != "N") + self.stop_bits) / self.baud
        silence_s = _GAP_FIXED_S if self.baud > _FAST_BAUD else _GAP_CHARACTERS * byte_s
        timing = Timing(
            timeout_ns,
            settle_ns=round(self.longest_reply * 1e9),
            gap_ns=max(gap_ns, round(silence_s * 1e9)),
            byte_ns=round(byte_s * 1e9),
        )
        line = SerialTransport(self.serial_port, self.baud, parity, self.stop_bits)
        return Client(line, Exchange(RtuFraming(), self.unit, timing))
