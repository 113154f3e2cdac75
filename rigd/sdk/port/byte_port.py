"""Opens a serial port or a TCP port; sends and receives bytes without waiting."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import os
import select
import socket
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import serial

from rigd.model.errors import DeviceError, LinkError
from rigd.sdk.peers import connect, last_address, note
from rigd.sdk.port.config import PortConfig

_PARITIES: Final = {
    "none": serial.PARITY_NONE, "even": serial.PARITY_EVEN, "odd": serial.PARITY_ODD,
}  # fmt: skip
_READ_BYTES: Final = 4096
#: How long a TCP port may take to accept, in s.
CONNECT_S: Final = 3.0
_STREAM: Final = socket.SOCK_STREAM


class BytePort:
    """A port of bytes. Only :meth:`open` waits, at most :data:`CONNECT_S`, and :meth:`open_again`.

    A serial port is this process's alone (``flock``): a second opening is refused.
    """

    def __init__(self, config: PortConfig) -> None:
        self._config = config
        self._port: serial.Serial | socket.socket | None = None
        self._lost: OSError | None = None
        #: The port, for messages.
        self.where = config.port

    @property
    def is_open(self) -> bool:
        """Whether it was opened, and not closed since; a port that is lost is still open."""
        return self._port is not None

    def open(self) -> None:
        """Open the port.

        Raises:
            LinkError: there is no such port, it is not ours to open, or open already.

        """
        self._open(CONNECT_S)

    def open_again(self, connect_s: float) -> None:
        """Open the port as it was; a TCP port must accept within ``connect_s``, in s.

        It is at the address that it had: see :mod:`rigd.sdk.peers`.

        Raises:
            LinkError: see :meth:`open`.

        """
        self._open(connect_s, again=True)

    def _open(self, connect_s: float, *, again: bool = False) -> None:
        self._check_closed()
        if not self._config.is_tcp:
            self._port = self._serial()
            return
        try:
            host, port = self._config.address
            opened = connect(host, int(port), connect_s, again=again)
        except OSError as error:
            raise self._unanswered(error) from error
        self._set_up(opened)
        self._port = opened

    async def open_on_loop(self, *, again: bool = False) -> None:
        """Open the port without blocking the event loop; raises what :meth:`open` does.

        ``again``: at the address that it had; see :mod:`rigd.sdk.peers`.
        """
        self._check_closed()
        if not self._config.is_tcp:
            self._port = self._serial()
            return
        loop = asyncio.get_running_loop()
        host, port = self._config.address
        where = last_address(host, int(port)) if again else host
        try:
            async with asyncio.timeout(CONNECT_S):
                found = await loop.getaddrinfo(where, port, type=_STREAM)
                own = await _connect_first(found)
            note(host, int(port), own)
        except OSError as error:  # TimeoutError is one
            raise self._unanswered(error) from error
        self._set_up(own)
        self._port = own

    def fileno(self) -> int:
        """Return the descriptor to wait on.

        Raises:
            DeviceError: the port is gone.
            LinkError: it is not open.

        """
        if self._port is None:
            raise LinkError(f"{self.where} is not open")
        if self._lost is not None:
            raise self._gone(self._lost)
        return int(self._port.fileno())

    def send(self, data: bytes) -> None:
        """Hand ``data`` to the kernel, whole.

        Raises:
            DeviceError: the port is gone.
            LinkError: it is not open, or takes no bytes.

        """
        fd = self.fileno()
        try:
            sent = os.write(fd, data)
        except BlockingIOError:
            sent = 0
        except OSError as error:
            self._lost = error
            raise self._gone(error) from error
        if sent != len(data):
            raise LinkError(
                f"{self.where} takes no more bytes",
                hint="check the cable, and that handshake is off at the device",
            )

    def receive(self) -> bytes:
        """Return what has arrived, at most 4096 bytes; nothing if there is none.

        Raises:
            DeviceError: the port is gone; from then on every call raises it.
            LinkError: it is not open.

        """
        fd = self.fileno()
        try:
            data = os.read(fd, _READ_BYTES)
        except BlockingIOError:
            return b""
        except OSError as error:
            self._lost = error
            raise self._gone(error) from error
        # A serial port without bytes may read as empty (VMIN 0): it is lost only if it hung up.
        if not data and (self._config.is_tcp or _hung_up(fd)):
            self._lost = OSError(errno.EIO, os.strerror(errno.EIO))
            raise self._gone(self._lost)
        return data

    def close(self) -> None:
        """Close the port; closing twice is silent."""
        port, self._port, self._lost = self._port, None, None
        if port is not None:
            with contextlib.suppress(OSError):  # the adapter may have been pulled out
                port.close()

    def _check_closed(self) -> None:
        if self._port is not None:
            raise LinkError(f"{self.where} is open already", hint="close it first")

    @staticmethod
    def _set_up(port: socket.socket) -> None:
        port.setblocking(False)
        port.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def _serial(self) -> serial.Serial:
        import termios  # Windows has none

        config = self._config
        try:
            return serial.Serial(
                config.port, config.baud, bytesize=config.data_bits,
                parity=_PARITIES[config.parity], stopbits=config.stop_bits,
                timeout=0, write_timeout=0, exclusive=True,
            )  # fmt: skip
        except serial.SerialException as error:
            raise cannot_open(config.port, error) from error
        except (termios.error, ValueError) as error:
            raise LinkError(
                f"{config.port} cannot be set to {config.baud} baud, {config.data_bits} data bits, "
                f"parity {config.parity}, {config.stop_bits} stop bits: {error}",
                hint="choose what the adapter can do, and set the device to the same",
            ) from error

    def _unanswered(self, error: OSError) -> LinkError:
        return LinkError(
            f"nothing answers at {self.where} ({str(error) or 'no reply'})",
            hint="check address and port, that the device is on, and that no other program is "
            "connected: most take one connection",
        )

    def _gone(self, error: OSError) -> DeviceError:
        return DeviceError(
            f"the port {self.where} is gone ({error.strerror or error})",
            hint="check its network, and start again"
            if self._config.is_tcp
            else "plug the adapter in again and start again; it may come back under another "
            "number: name the port by its path below /dev/serial/by-id",
        )


async def _connect_first(found: Sequence[tuple[Any, ...]]) -> socket.socket:
    """Return a connection to the first of the addresses of a name that accepts.

    Each has its share of :data:`CONNECT_S`: one that does not answer must leave time for the next.

    Raises:
        OSError: none accepts; that of the last.
    """
    loop, refused = asyncio.get_running_loop(), OSError("the name has no address")
    for family, *_, address in found:
        own = socket.socket(family, _STREAM)
        own.setblocking(False)
        try:
            async with asyncio.timeout(CONNECT_S / len(found)):
                await loop.sock_connect(own, address)
        except OSError as error:
            own.close()
            refused = error
        except BaseException:
            own.close()
            raise
        else:
            return own
    raise refused


def _hung_up(fd: int) -> bool:
    poll = select.poll()
    poll.register(fd, 0)
    return bool(poll.poll(0))


def cannot_open(path: str, error: OSError) -> LinkError:
    """Return why the serial port ``path`` cannot be opened, and what to do."""
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
