"""Sends and receives bytes for Modbus over a TCP socket or a serial port, without blocking."""

from __future__ import annotations

import contextlib
import os
import socket
from typing import Final, Protocol

import serial

from rigd.sdk import LinkError
from rigd.sdk.peers import connect
from rigd.sdk.port.byte_port import cannot_open

#: More than the largest frame of either kind (260 bytes on TCP, 256 on a serial line).
_CHUNK: Final = 1024


class Transport(Protocol):
    """An opened connection; ``where`` names it for a person."""

    where: str

    def open(self, timeout_s: float, *, again: bool = False) -> None:
        """Open it, within ``timeout_s``; ``again``: at the address that it had last.

        Raises:
            LinkError: it cannot be opened.

        """

    def fileno(self) -> int:
        """Return the descriptor to wait on."""

    def send(self, frame: bytes) -> None:
        """Hand ``frame`` to the kernel, whole; never waits.

        Raises:
            LinkError: the connection is lost.

        """

    def receive(self) -> bytes:
        """Return what has arrived, perhaps nothing; never waits.

        Raises:
            LinkError: the connection is lost.

        """

    def close(self) -> None:
        """Close it; closing twice is silent."""


class TcpTransport:
    """A TCP connection to a Modbus server."""

    def __init__(self, host: str, port: int) -> None:
        self.where = f"{host}:{port}"
        self._address = (host, port)
        self._socket: socket.socket | None = None

    def open(self, timeout_s: float, *, again: bool = False) -> None:
        """See :class:`Transport`."""
        try:
            self._socket = connect(*self._address, timeout_s, again=again)
        except OSError as error:
            raise LinkError(
                f"cannot connect to {self.where}: {error}",
                hint="check the address, the cable, and that the device allows one more connection",
            ) from error
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def fileno(self) -> int:
        """See :class:`Transport`."""
        return self._opened().fileno()

    def send(self, frame: bytes) -> None:
        """See :class:`Transport`."""
        try:
            sent = self._opened().send(frame)
        except OSError as error:  # also if the buffer is full: the device has not read for minutes
            raise LinkError(f"the connection to {self.where} is lost: {error}") from error
        if sent != len(frame):
            raise LinkError(f"the connection to {self.where} takes no more bytes")

    def receive(self) -> bytes:
        """See :class:`Transport`."""
        try:
            data = self._opened().recv(_CHUNK)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise LinkError(f"the connection to {self.where} is lost: {error}") from error
        if not data:
            raise LinkError(f"{self.where} closed the connection")
        return data

    def close(self) -> None:
        """See :class:`Transport`."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _opened(self) -> socket.socket:
        if self._socket is None:
            raise LinkError(f"the connection to {self.where} is not open")
        return self._socket


class SerialTransport:
    """A serial port, held by this process alone (a second opening is refused)."""

    def __init__(self, port: str, baud: int, parity: str, stop_bits: int) -> None:
        self.where = port
        self._baud, self._parity, self._stop_bits = baud, parity, stop_bits
        self._serial: serial.Serial | None = None

    def open(self, timeout_s: float, *, again: bool = False) -> None:
        """See :class:`Transport`; opening a port takes no time."""
        try:
            self._serial = serial.Serial(
                self.where,
                self._baud,
                stopbits=self._stop_bits,
                timeout=0,
                write_timeout=0,
                exclusive=True,
            )
            self._set_parity(self._serial)
            self._serial.reset_input_buffer()
        except OSError as error:  # SerialException is one
            self.close()
            raise cannot_open(self.where, error) from error
        except ValueError as error:
            self.close()
            raise LinkError(
                f"cannot open {self.where}: {error}", hint="give another 'baud' or 'stop_bits'"
            ) from error

    def fileno(self) -> int:
        """See :class:`Transport`."""
        return int(self._opened().fileno())

    def send(self, frame: bytes) -> None:
        """See :class:`Transport`."""
        try:
            sent = os.write(self.fileno(), frame)
        except OSError as error:
            raise self._lost(error) from error
        if sent != len(frame):
            raise LinkError(f"{self.where} takes no more bytes")

    def receive(self) -> bytes:
        """See :class:`Transport`."""
        try:
            return os.read(self.fileno(), _CHUNK)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise self._lost(error) from error

    def close(self) -> None:
        """See :class:`Transport`."""
        if self._serial is not None:
            with contextlib.suppress(OSError):  # the adapter may have been pulled out
                self._serial.close()
            self._serial = None

    def _set_parity(self, port: serial.Serial) -> None:
        """Set the parity by itself, so that a port without one is reported every time."""
        import termios  # Windows has none

        try:
            port.parity = self._parity
        except termios.error as error:
            self.close()
            raise LinkError(
                f"{self.where} does not take parity {self._parity}: {error}",
                hint="a simulated port (a pseudo terminal) has none: set 'parity: none'",
            ) from error

    def _opened(self) -> serial.Serial:
        if self._serial is None:
            raise LinkError(f"{self.where} is not open")
        return self._serial

    def _lost(self, error: OSError) -> LinkError:
        return LinkError(
            f"{self.where} is lost: {error}", hint="check the cable and the USB adapter"
        )
