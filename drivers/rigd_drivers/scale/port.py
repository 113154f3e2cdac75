"""Receives lines from a serial port, or a TCP port, and sends commands to it, on an event loop."""

from __future__ import annotations

import asyncio
import errno
import os
import socket
import termios
from collections import deque
from pathlib import Path
from typing import Final, Literal

import serial

from rigd.sdk import DeviceError, LinkError
from rigd_drivers.scale.lines import LineBuffer

Parity = Literal["none", "even", "odd"]

_PARITIES: Final = {
    "none": serial.PARITY_NONE, "even": serial.PARITY_EVEN, "odd": serial.PARITY_ODD,
}  # fmt: skip
_READ_BYTES: Final = 4096
#: How a TCP port is named: that of the scale itself, or of a device server that it is plugged into.
TCP: Final = "tcp://"
_CONNECT_S: Final = 3.0
_STREAM: Final = socket.SOCK_STREAM
#: Lines kept for a reader that does not come; a scale sends at most 92 a second.
_MAX_LINES: Final = 256


class LinePort:
    """A port that is read when bytes arrive, never blocking; ``tcp://HOST:PORT`` is one on TCP.

    A serial port is this process's alone (``flock``).
    """

    def __init__(self, path: str) -> None:
        self.path = path
        self._port: serial.Serial | socket.socket | None = None
        self._buffer = LineBuffer()
        self._lines: deque[bytes] = deque(maxlen=_MAX_LINES)
        self._arrived = asyncio.Event()
        self._lost: OSError | None = None
        #: Bytes that arrived since :meth:`open`, readable or not.
        self.received = 0

    async def open(self, baud: int, parity: Parity, data_bits: Literal[7, 8]) -> None:
        """Open the port and begin to read; a TCP port has no baud rate.

        Raises:
            LinkError: there is no such port, it is not ours to open, or open already.

        """
        if self._port is not None:
            raise LinkError(f"{self.path} is open already", hint="close it first")
        if self.path.startswith(TCP):
            self._port = await self._connected()
        else:
            self._port = self._serial(baud, parity, data_bits)
        self.received = 0
        self._lost = None
        self.flush()
        asyncio.get_running_loop().add_reader(self._port.fileno(), self._on_bytes)

    async def _connected(self) -> socket.socket:
        loop = asyncio.get_running_loop()
        host, _, port = self.path.removeprefix(TCP).rpartition(":")
        own = None
        try:
            async with asyncio.timeout(_CONNECT_S):
                family, *_, address = (await loop.getaddrinfo(host, port, type=_STREAM))[0]
                own = socket.socket(family, _STREAM)
                own.setblocking(False)
                await loop.sock_connect(own, address)
        except BaseException as error:
            if own is not None:
                own.close()
            if not isinstance(error, OSError):  # TimeoutError is one
                raise
            raise LinkError(
                f"nothing answers at {self.path} ({str(error) or 'no reply'})",
                hint="check address and port, that the scale is on, and that no other program is "
                "connected: most take one connection",
            ) from error
        return own

    def _serial(self, baud: int, parity: Parity, data_bits: Literal[7, 8]) -> serial.Serial:
        try:
            return serial.Serial(
                self.path, baud, bytesize=data_bits, parity=_PARITIES[parity],
                timeout=0, write_timeout=0, exclusive=True,
            )  # fmt: skip
        except serial.SerialException as error:
            raise _cannot_open(self.path, error) from error
        except (termios.error, ValueError) as error:
            raise LinkError(
                f"{self.path} cannot be set to {baud} baud, {data_bits} data bits, "
                f"parity {parity}: {error}",
                hint="choose what the adapter can do, and set the scale to the same",
            ) from error

    def close(self) -> None:
        """Close the port; closing twice is silent."""
        port, self._port = self._port, None
        if port is not None:
            asyncio.get_running_loop().remove_reader(port.fileno())
            port.close()

    def flush(self) -> None:
        """Discard the lines that have arrived, and the one that has begun."""
        self._lines.clear()
        self._buffer.clear()

    def send(self, command: bytes) -> None:
        """Send ``command``.

        Raises:
            DeviceError: the port is gone.
            LinkError: it is not open, or takes no bytes.

        """
        port = self._opened()
        try:
            sent = os.write(port.fileno(), command)
        except BlockingIOError:
            sent = 0
        except OSError as error:
            raise self._gone(error) from error
        if sent != len(command):
            raise LinkError(
                f"{self.path} takes no more bytes",
                hint="check the cable, and that handshake is off at the scale",
            )

    async def line(self, timeout_s: float) -> bytes | None:
        """Return the next line, or None if none is complete within ``timeout_s``.

        Raises:
            DeviceError: the port is gone.
            LinkError: it is not open.

        """
        if not await self._has_line(timeout_s):
            return None
        return self._lines.popleft()

    async def quiet(self, quiet_s: float, timeout_s: float) -> bool:
        """Throw away what arrives until nothing has for ``quiet_s``; False at ``timeout_s``."""
        loop = asyncio.get_running_loop()
        deadline = loop.time() + timeout_s
        while loop.time() < deadline:
            before = self.received
            await self._has_line(quiet_s)
            self.flush()
            if self.received == before:
                return True
        return False

    async def _has_line(self, timeout_s: float) -> bool:
        self._opened()
        if not self._lines:
            self._arrived.clear()
            try:
                await asyncio.wait_for(self._arrived.wait(), timeout_s)
            except TimeoutError:
                return False
            self._opened()
        return True

    def _on_bytes(self) -> None:
        port = self._port
        if port is None:
            return
        try:
            data = os.read(port.fileno(), _READ_BYTES)
            if not data:
                raise OSError(errno.EIO, os.strerror(errno.EIO))
        except BlockingIOError:
            return
        except OSError as error:  # unplugged: the reader would be called for ever
            asyncio.get_running_loop().remove_reader(port.fileno())
            self._lost = error
            self._arrived.set()
            return
        self.received += len(data)
        self._lines.extend(self._buffer.feed(data))
        if self._lines:
            self._arrived.set()

    def _opened(self) -> serial.Serial | socket.socket:
        if self._port is None:
            raise LinkError(f"{self.path} is not open")
        if self._lost is not None:
            raise self._gone(self._lost)
        return self._port

    def _gone(self, error: OSError) -> DeviceError:
        return DeviceError(
            f"the port {self.path} is gone ({error.strerror or error})",
            hint="check its network, and start again"
            if self.path.startswith(TCP)
            else "plug the adapter in again and start again; it may come back under another "
            "number: name the port by its path below /dev/serial/by-id",
        )


def _cannot_open(path: str, error: serial.SerialException) -> LinkError:
    if error.errno == errno.ENOENT:
        present = sorted(str(item) for item in Path("/dev/serial/by-id").glob("*"))
        hint = f"present: {', '.join(present)}" if present else "no serial adapter is plugged in"
        return LinkError(f"there is no serial port {path}", hint=hint)
    if error.errno in (errno.EACCES, errno.EPERM):
        return LinkError(
            f"this user may not open {path}",
            hint="add the user to the group that owns it: usermod -aG dialout USER",
        )
    if error.errno in (errno.EAGAIN, errno.EBUSY):
        return LinkError(
            f"another program holds {path}", hint="end it: lsof or fuser name the program"
        )
    return LinkError(f"cannot open {path}: {error}", hint="check that it is a serial port")
