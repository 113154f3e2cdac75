"""Defines the options of a driver whose device is on a serial port or a TCP port."""

from __future__ import annotations

from typing import Annotated, Final, Literal, Self

from annotated_types import Ge, Le
from pydantic import model_validator

from rigd.sdk.driver import DriverConfig
from rigd.sdk.options.documented_model import wrong_entry

#: How a TCP port is named: that of the device, or of a device server that it is plugged into.
TCP: Final = "tcp://"

Parity = Literal["none", "even", "odd"]


class PortConfig(DriverConfig):
    """The port of a device; a TCP port has no use for baud rate, parity and bits."""

    port: str
    """Serial port; best its path below /dev/serial/by-id, which stays the same after
    reconnection. Or `tcp://HOST:PORT`: a device with a network, or a serial device server.
    """
    baud: Annotated[int, Ge(50), Le(4_000_000)] = 9600
    """Baud rate set at the device."""
    parity: Parity = "none"
    """Parity set at the device."""
    data_bits: Literal[7, 8] = 8
    """Data bits set at the device."""
    stop_bits: Literal[1, 2] = 1
    """Stop bits set at the device."""

    @model_validator(mode="after")
    def _port_is_whole(self) -> Self:
        if self.port.startswith(TCP):
            host, port = self.address
            if not host or not port.isdecimal() or not 0 < int(port) < 65536:
                raise wrong_entry(f"port '{self.port}' is not of the form tcp://HOST:PORT", "port")
        return self

    @property
    def address(self) -> tuple[str, str]:
        """Host and port of a TCP port; an IPv6 address without its brackets."""
        host, _, port = self.port.removeprefix(TCP).rpartition(":")
        return host.removeprefix("[").removesuffix("]"), port

    @property
    def is_tcp(self) -> bool:
        """Whether it is a TCP port."""
        return self.port.startswith(TCP)
